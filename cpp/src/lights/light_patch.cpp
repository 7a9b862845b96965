#include "lights/light_patch.hpp"

#include <cmath>
#include <functional>
#include <numeric>
#include <type_traits>
#include <utility>

#include "columns/dense_rows.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_blocks.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/rows/basis.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

using Complex = std::complex<double>;

constexpr std::size_t kMaxColumns = 32;  // evaluated for a mean

template <class T>
void read_light(const FramesView<const T>& view, const LitFrame& frame, Patch& patch) {
  using Sum =
      std::conditional_t<std::is_integral_v<T>, std::uint32_t, double>;  // a group is narrower than 2^16 columns
  const double share = 1 / static_cast<double>(patch.group);
  DenseRows<T, T> source(view, frame.index, {});
  const auto rows =
      source.read(patch.first_row, patch.rows, {patch.first_column, patch.first_column + patch.groups * patch.group});
  for (std::size_t n = 0; n < patch.rows; ++n) {
    const T* row = rows.samples + static_cast<std::ptrdiff_t>(n) * rows.stride;
    for (std::size_t g = 0; g < patch.groups; ++g, row += patch.group)
      patch.light[n * patch.stride + g] =
          static_cast<double>(std::accumulate(row, row + patch.group, Sum{0})) * share - frame.dark;
  }
}

// Mean of at most kMaxColumns columns evenly spaced, in each of the rows: light above dark.
std::vector<double> mean_light(const LitFrame& frame, const IndexRange& columns, const IndexRange& rows) {
  const std::size_t step = (columns.size() + kMaxColumns - 1) / kMaxColumns;
  const std::size_t count = (columns.size() + step - 1) / step;
  std::vector<double> mean(rows.size(), -frame.dark);
  const double share = 1 / static_cast<double>(count);
  std::visit(
      [&](const auto& view) {
        for (std::size_t n = 0; n < mean.size(); ++n)
          for (std::size_t c = 0; c < count; ++c)
            mean[n] += static_cast<double>(view(frame.index, rows.begin + n, columns.begin + c * step)) * share;
      },
      frame.frames);
  return mean;
}

}  // namespace

Region Patch::range(const Region& box) const {
  const auto from = [](std::size_t a, std::size_t b) { return a - std::min(a, b); };
  const std::size_t top = std::min(from(box.y, first_row), rows), end = std::min(from(box.bottom(), first_row), rows),
                    left = std::min(from(box.x, first_column) / group, groups),
                    last = std::min((from(box.right(), first_column) + group - 1) / group, groups);
  return {left, top, from(last, left), from(end, top)};
}

LitFrame lit_frame(const AnyFramesView& frames, std::size_t index, const ToneCurve& curve) {
  const double dark = curve.dark_level;
  const double full = std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        ToneCurve stored;
        stored.dark_level = dark, stored.white_level = curve.white_level;
        if (std::is_integral_v<T> || curve.white_level != 0) return white_level(stored, sample_maximum<T>()) - dark;
        double top = 0;  // floating-point samples without a stated range
        for (std::size_t f = 0; f < view.frames; ++f)
          for (std::size_t n = 0; n < view.rows; ++n)
            for (std::size_t c = 0; c < view.columns; ++c)
              top = std::max(top, static_cast<double>(view(f, n, c)) - dark);
        return top > 0 ? top : 64;
      },
      frames);
  return {frames, index, dark, full / 64, holds_integers(frames) ? 1.0 : 0.0};
}

Patch patch_of(const LitFrame& frame, const Region& box, std::size_t columns_beside, std::size_t rows_beyond) {
  const Shape shape = shape_of(frame.frames);
  const std::size_t left = box.x - std::min(box.x, columns_beside);
  const std::size_t right = std::min(shape.columns, box.right() + columns_beside);
  const std::size_t top = box.y - std::min(box.y, rows_beyond);
  const std::size_t bottom = std::min(shape.rows, box.bottom() + rows_beyond);
  const std::size_t wanted = std::max<std::size_t>((right - left + kMaxBlocks - 1) / kMaxBlocks,
                                                   std::clamp<std::size_t>(box.width / 16, 1, kWidestGroup));
  const std::size_t group = std::min(wanted, right - left);
  const std::size_t groups = (right - left) / group;
  const std::size_t stride = (groups + kernels::kPatchPadding - 1) / kernels::kPatchPadding * kernels::kPatchPadding;
  Patch patch{left, top, bottom - top, groups, group, stride, {}, {}};
  patch.light.resize(patch.rows * stride);
  patch.logs.resize(patch.rows * stride);
  std::visit([&](const auto& view) { read_light(view, frame, patch); }, frame.frames);
  kernels::logarithms(patch.light.data(), patch.light.size(), frame.floor, patch.logs.data());
  return patch;
}

std::vector<double> local_means(const std::vector<double>& values, std::size_t rows, std::size_t stride,
                                std::size_t length) {
  std::vector<double> means(values.size()), unused(values.size());
  kernels::hann_demodulate({values.data(), rows, stride}, std::vector<double>(stride).data(),
                           hann_window(0, rows, length), means.data(), unused.data());
  return means;
}

std::vector<double> local_means(std::span<const double> signal, std::size_t length) {
  std::vector<double> padded(signal.size() * kernels::kPatchPadding), means(signal.size());
  for (std::size_t n = 0; n < signal.size(); ++n) padded[n * kernels::kPatchPadding] = signal[n];
  padded = local_means(padded, signal.size(), kernels::kPatchPadding, length);
  for (std::size_t n = 0; n < signal.size(); ++n) means[n] = padded[n * kernels::kPatchPadding];
  return means;
}

std::vector<double> mean_swing(const LitFrame& frame, const IndexRange& columns, const IndexRange& rows,
                               std::size_t length) {
  std::vector<double> logs = mean_light(frame, columns, rows);
  for (double& value : logs) value = std::log(std::max(value, 0.0) + frame.floor);
  const auto slow = local_means(logs, length);
  std::ranges::transform(logs, slow, logs.begin(), std::minus{});
  return logs;
}

std::vector<double> fast_logs(const Patch& patch, std::size_t length) {
  std::vector<double> slow = local_means(patch.logs, patch.rows, patch.stride, length);
  std::ranges::transform(patch.logs, slow, slow.begin(), std::minus{});
  return slow;
}

double variance_by_median(std::vector<double> magnitudes) {
  return std::pow(median(std::move(magnitudes)) / kMedianMagnitude, 2);
}

double noise_variance(const Patch& patch, const Region& core) {
  const std::size_t end_row = std::min(core.bottom() + 1, patch.rows), end = std::min(core.right() + 1, patch.groups);
  const bool one_group = end - core.x < 2;
  std::vector<double> differences;
  differences.reserve(core.pixels());
  for (std::size_t n = core.y; n + 1 < end_row; ++n)
    for (std::size_t g = core.x; g < (one_group ? end : end - 1); ++g) {
      const double* at = &patch.logs[n * patch.stride + g];
      const double down = at[0] - at[patch.stride], next = one_group ? 0 : at[1] - at[patch.stride + 1];
      if (std::isfinite(down - next)) differences.push_back(std::abs(down - next));
    }
  return differences.empty() ? 0 : variance_by_median(std::move(differences)) / (one_group ? 2 : 4);
}

Complex turned(double cycles) {
  const double angle = -kTwoPi * (cycles - std::floor(cycles));
  return {std::cos(angle), std::sin(angle)};
}

ComplexValues turns_of(double frequency, std::size_t rows, std::size_t reach) {
  std::vector<double> times(rows + 2 * reach);
  std::iota(times.begin(), times.end(), -static_cast<double>(reach));
  ComplexValues out{times, times};
  fill_wave(times, -frequency, out.real, out.imaginary);
  return out;
}

std::size_t hann_length(double frequency) { return static_cast<std::size_t>(std::lround(1 / frequency)) * 2 + 1; }

kernels::HannWindow hann_window(double frequency, std::size_t rows, std::size_t length) {
  const double bin = 1 / static_cast<double>(length);
  const auto carrier = [&](double at) { return turns_of(at, rows, length / 2); };
  return {carrier(frequency - bin), carrier(frequency), carrier(frequency + bin), turns_of(bin, rows), length};
}

ComplexValues swing_of(const Patch& patch, const std::vector<double>& values, const kernels::HannWindow& window) {
  ComplexValues map{std::vector<double>(values.size()), std::vector<double>(values.size())};
  const Eigen::ArrayXd means = patch.part_of(values, {0, 0, patch.stride, patch.rows}).colwise().mean();
  kernels::hann_demodulate({values.data(), patch.rows, patch.stride}, means.data(), window, map.real.data(),
                           map.imaginary.data());
  return map;
}

}  // namespace ocisac
