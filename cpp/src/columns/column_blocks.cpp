#include "ocisac/columns/column_blocks.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <type_traits>

#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

namespace {

constexpr std::size_t max_blocks = 64;     // per frame; a light of 1/64 of the frame's width fills one
constexpr std::size_t max_signals = 1024;  // over all frames

struct Sum {
  double light = 0;
  std::size_t saturated = 0;
};

// 2^16 samples of 16 bits fit into the integer sum.
template <class T>
Sum sum_run(const T* samples, std::size_t count, std::ptrdiff_t stride, double saturation) {
  if constexpr (std::is_integral_v<T>) {
    const double level_or_more = saturation <= sample_maximum<T>() ? saturation : sample_maximum<T>() + 1;
    const auto level = static_cast<std::uint32_t>(std::ceil(std::max(level_or_more, 0.0)));
    Sum total;
    for (std::size_t first = 0; first < count; first += 65536) {
      const std::size_t last = std::min(count, first + 65536);
      std::uint32_t light = 0, saturated = 0;
      for (std::size_t i = first; i < last; ++i) {
        const std::uint32_t value = samples[static_cast<std::ptrdiff_t>(i) * stride];
        light += value;
        saturated += value >= level;
      }
      total.light += light;
      total.saturated += saturated;
    }
    return total;
  } else {
    Sum total;
    for (std::size_t i = 0; i < count; ++i) {
      const auto value = static_cast<double>(samples[static_cast<std::ptrdiff_t>(i) * stride]);
      total.light += value;
      total.saturated += value >= saturation;
    }
    return total;
  }
}

template <class T>
void add_blocks(const FramesView<const T>& view, double saturation, ColumnBlocks& out) {
  for (std::size_t frame = 0; frame < view.frames; ++frame)
    for (std::size_t row = 0; row < view.rows; ++row)
      for (std::size_t block = 0; block < out.blocks; ++block) {
        const std::size_t first = block * out.width;
        const std::size_t count = std::min(out.width, view.columns - first);
        const T* samples = view.at(frame, row, first);
        // The constant stride lets the compiler vectorise the usual case.
        const Sum sum = view.column_stride == 1 ? sum_run(samples, count, 1, saturation)
                                                : sum_run(samples, count, view.column_stride, saturation);
        out.signals[(frame * out.blocks + block) * view.rows + row] = sum.light;
        out.saturated_share[block] += static_cast<double>(sum.saturated);
      }
}

// Removes the mean; exact zeros where a signal is constant up to rounding.
void remove_mean(std::span<double> signal) {
  double mean = 0, largest = 0;
  for (const double v : signal) {
    mean += v / static_cast<double>(signal.size());
    largest = std::max(largest, std::abs(v));
  }
  bool varies = false;
  for (double& v : signal) {
    v -= mean;
    varies = varies || std::abs(v) > 1e-13 * largest;
  }
  if (!varies) std::fill(signal.begin(), signal.end(), 0.0);
}

}  // namespace

ColumnBlocks column_blocks(const AnyFramesView& frames, double saturation) {
  check(frames);
  const Shape shape = shape_of(frames);
  const std::size_t most = std::clamp<std::size_t>(max_signals / std::max<std::size_t>(shape.frames, 1), 1, max_blocks);
  const std::size_t width = (shape.columns + most - 1) / most;
  const std::size_t blocks = (shape.columns + width - 1) / width;
  ColumnBlocks out{shape.frames,
                   shape.rows,
                   shape.columns,
                   blocks,
                   width,
                   std::vector<double>(shape.frames * blocks * shape.rows),
                   std::vector<double>(blocks)};
  std::visit([&](const auto& view) { add_blocks(view, saturation, out); }, frames);
  for (std::size_t first = 0; first < out.signals.size(); first += shape.rows)
    remove_mean(std::span(out.signals).subspan(first, shape.rows));
  for (std::size_t block = 0; block < blocks; ++block) {
    const std::size_t columns = std::min(width, shape.columns - block * width);
    out.saturated_share[block] /= static_cast<double>(columns * shape.rows * shape.frames);
  }
  return out;
}

}  // namespace ocisac
