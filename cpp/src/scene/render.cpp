#include "ocisac/scene/render.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>
#include <vector>

#include "ocisac/parallel.hpp"
#include "ocisac/require.hpp"

namespace ocisac {

namespace {

constexpr std::size_t rows_per_block = 32;

bool uniform(const ScenePart& part) { return !part.gains && !part.phase; }

bool reaches(const ScenePart& part, std::size_t row) { return row >= part.top && row - part.top < part.height; }

float uniform_value(const ScenePart& part, std::size_t row) {
  return part.gain * part.table[(row - part.top) * part.phases];
}

template <class T>
T stored(float value, float white) {
  if constexpr (std::is_floating_point_v<T>) {
    return static_cast<T>(value);
  } else {
    const float above = std::clamp(value, 0.0F, white) + 0.5F;  // not negative, so cutting rounds
    return static_cast<T>(static_cast<int>(above));
  }
}

// Pixels of a part in one row, numbered within the frame.
struct Run {
  std::size_t begin, end;
};

Run run_of(const ScenePart& part, std::size_t row) {
  if (!part.spans) return {part.left, part.left + part.width};
  const std::uint32_t* span = part.spans + 2 * (row - part.top);
  return {part.left + span[0], part.left + span[1]};
}

void add_row(const ScenePart& part, std::size_t row, float* values) {
  const std::size_t inside = row - part.top;
  const float* table = part.table + inside * part.phases;
  const Run run = run_of(part, row);
  float* out = values + run.begin;
  const std::size_t count = run.end - run.begin;
  const std::size_t first = inside * part.width + (run.begin - part.left);
  const float* gains = part.gains ? part.gains + first : nullptr;
  if (part.phase) {
    const std::uint16_t* phase = part.phase + first;
    for (std::size_t x = 0; x < count; ++x) out[x] += (gains ? gains[x] : part.gain) * table[phase[x]];
  } else if (gains) {
    const float value = table[0];
    for (std::size_t x = 0; x < count; ++x) out[x] += gains[x] * value;
  } else {
    const float value = uniform_value(part, row);
    for (std::size_t x = 0; x < count; ++x) out[x] += value;
  }
}

// What one row needs: the parts that reach it.
struct Row {
  std::size_t number = 0;
  std::vector<const ScenePart*> parts;
  std::vector<std::size_t> edges;
  std::vector<float> values;
};

// Runs of equal value between the edges of the parts.
template <class T>
void fill_runs(Row& row, float level, float white, const FramesView<T>& frame) {
  row.edges = {0, frame.columns};
  for (const ScenePart* part : row.parts) {
    const Run run = run_of(*part, row.number);
    row.edges.insert(row.edges.end(), {run.begin, run.end});
  }
  std::sort(row.edges.begin(), row.edges.end());
  T* out = frame.at(0, row.number, 0);
  for (std::size_t i = 1; i < row.edges.size(); ++i) {
    const std::size_t begin = row.edges[i - 1];
    const std::size_t end = row.edges[i];
    float value = level;
    for (const ScenePart* part : row.parts) {
      const Run run = run_of(*part, row.number);
      if (begin >= run.begin && end <= run.end) value += uniform_value(*part, row.number);
    }
    std::fill(out + begin, out + end, stored<T>(value, white));
  }
}

template <class T>
void sum_parts(Row& row, const SceneBase& base, float white, const FramesView<T>& frame) {
  if (base.image)
    row.values.assign(base.image + row.number * frame.columns, base.image + (row.number + 1) * frame.columns);
  else
    row.values.assign(frame.columns, base.level);
  for (const ScenePart* part : row.parts) add_row(*part, row.number, row.values.data());
  T* out = frame.at(0, row.number, 0);
  for (std::size_t x = 0; x < frame.columns; ++x) out[x] = stored<T>(row.values[x], white);
}

template <class T>
void render_row(std::span<const ScenePart> parts, const SceneBase& base, float white, Row& row,
                const FramesView<T>& frame) {
  row.parts.clear();
  for (const ScenePart& part : parts)
    if (reaches(part, row.number)) row.parts.push_back(&part);
  const bool runs = !base.image && std::all_of(row.parts.begin(), row.parts.end(),
                                               [](const ScenePart* part) { return uniform(*part); });
  if (runs)
    fill_runs(row, base.level, white, frame);
  else
    sum_parts(row, base, white, frame);
}

}  // namespace

void check(const ScenePart& part, std::size_t rows, std::size_t columns) {
  require(part.height <= rows && part.top <= rows - part.height, "parts", part.top, "rows within the frame");
  require(part.width <= columns && part.left <= columns - part.width, "parts", part.left, "columns within the frame");
  require(part.phases >= 1, "phases", part.phases, "1 or more");
  if (part.phase)
    for (std::size_t i = 0; i < part.height * part.width; ++i)
      require(part.phase[i] < part.phases, "phase", part.phase[i], "below the phases of the table");
  if (part.spans)
    for (std::size_t y = 0; y < part.height; ++y)
      require(part.spans[2 * y] <= part.spans[2 * y + 1] && part.spans[2 * y + 1] <= part.width, "spans",
              part.spans[2 * y + 1], "first <= last <= the width of the part");
}

template <class T>
void render_parts(std::span<const ScenePart> parts, const SceneBase& base, float white, int threads,
                  const FramesView<T>& frame) {
  require_finite("base", base.level);
  require(frame.column_stride == 1, "frame", frame.column_stride, "columns next to each other");
  if constexpr (!std::is_floating_point_v<T>)
    require(white >= 0 && white <= static_cast<float>(std::numeric_limits<T>::max()), "white", white,
            "a level that the samples can hold");
  const std::size_t blocks = (frame.rows + rows_per_block - 1) / rows_per_block;
  for_each_block(blocks, threads, [&](std::size_t block) {
    Row row;
    const std::size_t end = std::min(frame.rows, (block + 1) * rows_per_block);
    for (row.number = block * rows_per_block; row.number < end; ++row.number)
      render_row(parts, base, white, row, frame);
  });
}

template void render_parts(std::span<const ScenePart>, const SceneBase&, float, int, const FramesView<std::uint8_t>&);
template void render_parts(std::span<const ScenePart>, const SceneBase&, float, int, const FramesView<std::uint16_t>&);
template void render_parts(std::span<const ScenePart>, const SceneBase&, float, int, const FramesView<float>&);

}  // namespace ocisac
