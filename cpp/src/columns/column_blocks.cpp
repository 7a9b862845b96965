#include "ocisac/columns/column_blocks.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <type_traits>

#include "columns/row_kernels.hpp"
#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kMaxSignals = 1024;  // over all frames

// The smallest integer that is saturated, above all samples if none is.
template <class T>
std::uint32_t saturated_from(double saturation) {
  const double level_or_more = saturation <= sample_maximum<T>() ? saturation : sample_maximum<T>() + 1;
  return static_cast<std::uint32_t>(std::ceil(std::max(level_or_more, 0.0)));
}

// Adds samples to `light`, and those at the saturation level to `saturated`.
template <class T>
void add_run(const T* samples, std::size_t count, std::ptrdiff_t stride, double saturation, double& light,
             double& saturated) {
  std::conditional_t<std::is_integral_v<T>, std::uint64_t, double> sum = 0;
  std::size_t reaching = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const T value = samples[static_cast<std::ptrdiff_t>(i) * stride];
    sum += value;
    reaching += static_cast<double>(value) >= saturation;
  }
  light += static_cast<double>(sum);
  saturated += static_cast<double>(reaching);
}

// Adds the blocks of one frame to `signals`, (blocks × rows), and their sums over the rows to `totals`.
template <class T>
void add_frame(const FramesView<const T>& view, double saturation, ColumnBlocks& out, std::span<double> signals,
               std::span<double> totals) {
  std::vector<std::uint32_t> light(out.blocks), saturated(out.blocks);
  for (std::size_t row = 0; row < view.rows; ++row) {
    const T* samples = view.at(0, row, 0);
    if constexpr (std::is_same_v<T, std::uint8_t>)
      if (view.column_stride == 1) {
        kernels::sum_runs(samples, view.columns, out.width, saturated_from<T>(saturation), light.data(),
                          saturated.data());
        for (std::size_t block = 0; block < out.blocks; ++block) {
          totals[block] += signals[block * view.rows + row] = light[block];
          out.saturated_share[block] += saturated[block];
        }
        continue;
      }
    for (std::size_t block = 0; block < out.blocks; ++block) {
      const std::size_t first = block * out.width;
      double& sum = signals[block * view.rows + row];
      add_run(samples + static_cast<std::ptrdiff_t>(first) * view.column_stride,
              std::min(out.width, view.columns - first), view.column_stride, saturation, sum,
              out.saturated_share[block]);
      totals[block] += sum;
    }
  }
}

// Removes the mean; exact zeros where a signal is constant up to rounding.
void remove_mean(std::span<double> signal, double mean) {
  for (double& v : signal) v -= mean;
  const auto varies = [&](double v) { return std::abs(v) > 1e-13 * std::abs(mean); };
  if (std::none_of(signal.begin(), signal.end(), varies)) std::fill(signal.begin(), signal.end(), 0.0);
}

}  // namespace

ColumnBlocks column_blocks(const AnyFramesView& frames, double saturation) {
  check(frames, kMostLight);
  const Shape shape = shape_of(frames);
  const std::size_t most = std::clamp<std::size_t>(kMaxSignals / std::max<std::size_t>(shape.frames, 1), 1, kMaxBlocks);
  const std::size_t width = (shape.columns + most - 1) / most;
  const std::size_t blocks = (shape.columns + width - 1) / width;
  ColumnBlocks out{shape.frames,
                   shape.rows,
                   shape.columns,
                   blocks,
                   width,
                   std::vector<double>(shape.frames * blocks * shape.rows),
                   std::vector<double>(blocks)};
  std::vector<double> totals(shape.frames * blocks);
  std::visit(
      [&](const auto& view) {
        for (std::size_t frame = 0; frame < shape.frames; ++frame)
          add_frame(view.frame(frame), saturation, out,
                    std::span(out.signals).subspan(frame * blocks * shape.rows, blocks * shape.rows),
                    std::span(totals).subspan(frame * blocks, blocks));
      },
      frames);
  for (std::size_t signal = 0; signal < totals.size(); ++signal)
    remove_mean(std::span(out.signals).subspan(signal * shape.rows, shape.rows),
                totals[signal] / static_cast<double>(shape.rows));
  for (std::size_t block = 0; block < blocks; ++block) {
    const std::size_t columns = std::min(width, shape.columns - block * width);
    out.saturated_share[block] /= static_cast<double>(columns * shape.rows * shape.frames);
  }
  return out;
}

}  // namespace ocisac
