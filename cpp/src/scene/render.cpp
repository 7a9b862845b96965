#include "ocisac/scene/render.hpp"

#include <algorithm>
#include <limits>
#include <type_traits>
#include <vector>

#include "core/parallel.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kRowsPerBlock = 32;

bool uniform(const ScenePart& part) { return !part.gains && !part.phase; }

bool reaches(const ScenePart& part, std::size_t row) {
  return row >= part.region.y && row - part.region.y < part.region.height;
}

float uniform_value(const ScenePart& part, std::size_t row) {
  return part.gain * part.table[(row - part.region.y) * part.phases];
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
  bool operator==(const Run&) const = default;
};

Run run_of(const ScenePart& part, std::size_t row) {
  if (!part.spans) return {part.region.x, part.region.x + part.region.width};
  const std::uint32_t* span = part.spans + 2 * (row - part.region.y);
  return {part.region.x + span[0], part.region.x + span[1]};
}

void add_row(const ScenePart& part, const Run& run, std::size_t row, float* values) {
  const std::size_t inside = row - part.region.y;
  const float* table = part.table + inside * part.phases;
  float* out = values + run.begin;
  const std::size_t count = run.end - run.begin;
  const std::size_t first = inside * part.region.width + (run.begin - part.region.x);
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

// State of one row: the parts that reach it and their pixels; the edges of runs of equal value, and the parts of each
// run. `found`: the parts and pixels of the row for which the runs were computed.
struct Row {
  struct Reach {
    const ScenePart* part;
    Run run;
    bool operator==(const Reach&) const = default;
  };
  std::size_t number = 0;
  std::vector<Reach> parts, found;
  std::vector<std::size_t> edges;
  std::vector<std::vector<const ScenePart*>> inside;
  std::vector<float> values;
};

void find_runs(Row& row, std::size_t columns) {
  row.edges = {0, columns};
  for (const auto& [part, run] : row.parts) row.edges.insert(row.edges.end(), {run.begin, run.end});
  std::sort(row.edges.begin(), row.edges.end());
  row.edges.erase(std::unique(row.edges.begin(), row.edges.end()), row.edges.end());
  row.inside.assign(row.edges.size() - 1, {});
  for (std::size_t i = 0; i < row.inside.size(); ++i)
    for (const auto& [part, run] : row.parts)
      if (row.edges[i] >= run.begin && row.edges[i + 1] <= run.end) row.inside[i].push_back(part);
  row.found = row.parts;
}

// Runs of equal value between the edges of the parts; most rows reuse those of the previous row.
template <class T>
void fill_runs(Row& row, float level, float white, const FramesView<T>& frame) {
  if (row.edges.empty() || row.parts != row.found) find_runs(row, frame.columns);
  T* out = frame.at(0, row.number, 0);
  for (std::size_t i = 0; i < row.inside.size(); ++i) {
    float value = level;
    for (const ScenePart* part : row.inside[i]) value += uniform_value(*part, row.number);
    std::fill(out + row.edges[i], out + row.edges[i + 1], stored<T>(value, white));
  }
}

template <class T>
void sum_parts(Row& row, const SceneBase& base, float white, const FramesView<T>& frame) {
  if (base.image)
    row.values.assign(base.image + row.number * frame.columns, base.image + (row.number + 1) * frame.columns);
  else
    row.values.assign(frame.columns, base.level);
  for (const auto& [part, run] : row.parts) add_row(*part, run, row.number, row.values.data());
  T* out = frame.at(0, row.number, 0);
  for (std::size_t x = 0; x < frame.columns; ++x) out[x] = stored<T>(row.values[x], white);
}

template <class T>
void render_row(std::span<const ScenePart> parts, const SceneBase& base, float white, Row& row,
                const FramesView<T>& frame) {
  row.parts.clear();
  for (const ScenePart& part : parts)
    if (reaches(part, row.number)) row.parts.push_back({&part, run_of(part, row.number)});
  const bool runs = !base.image && std::all_of(row.parts.begin(), row.parts.end(),
                                               [](const Row::Reach& reach) { return uniform(*reach.part); });
  if (runs)
    fill_runs(row, base.level, white, frame);
  else
    sum_parts(row, base, white, frame);
}

}  // namespace

void check(const ScenePart& part, std::size_t rows, std::size_t columns) {
  require(part.region.height <= rows && part.region.y <= rows - part.region.height, "parts", part.region.y,
          "rows within the frame");
  require(part.region.width <= columns && part.region.x <= columns - part.region.width, "parts", part.region.x,
          "columns within the frame");
  require(part.phases >= 1, "phases", part.phases, "1 or more");
  if (part.phase)
    for (std::size_t i = 0; i < part.region.height * part.region.width; ++i)
      require(part.phase[i] < part.phases, "phase", part.phase[i], "below the phases of the table");
  if (part.spans)
    for (std::size_t y = 0; y < part.region.height; ++y)
      require(part.spans[2 * y] <= part.spans[2 * y + 1] && part.spans[2 * y + 1] <= part.region.width, "spans",
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
  const std::size_t blocks = (frame.rows + kRowsPerBlock - 1) / kRowsPerBlock;
  for_each_block(blocks, threads, [&](std::size_t block) {
    Row row;
    const std::size_t end = std::min(frame.rows, (block + 1) * kRowsPerBlock);
    for (row.number = block * kRowsPerBlock; row.number < end; ++row.number) render_row(parts, base, white, row, frame);
  });
}

template void render_parts(std::span<const ScenePart>, const SceneBase&, float, int, const FramesView<std::uint8_t>&);
template void render_parts(std::span<const ScenePart>, const SceneBase&, float, int, const FramesView<std::uint16_t>&);
template void render_parts(std::span<const ScenePart>, const SceneBase&, float, int, const FramesView<float>&);

}  // namespace ocisac
