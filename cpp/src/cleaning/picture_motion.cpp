#include "cleaning/picture_motion.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <utility>

#include "cleaning/merged_blocks.hpp"
#include "core/levels.hpp"
#include "core/spectrum.hpp"
#include "core/statistics.hpp"
#include "ocisac/core/require.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;
using Spectrum = std::vector<std::complex<double>>;

constexpr std::size_t kWindow = 8;  // side of a part that is compared, pixels
constexpr std::size_t kMinSide = 4;
constexpr int kRounds = 2;
constexpr double kMaxStep = 2;  // pixels, of what the peak leaves

// The window of Hann, not 0 at its ends.
Values bell(std::size_t length) {
  Values result(length);
  for (std::size_t n = 0; n < length; ++n)
    result[n] = 0.5 - 0.5 * std::cos(kTwoPi * static_cast<double>(n + 1) / static_cast<double>(length + 1));
  return result;
}

// (rows × columns) transformed along the columns, then along the rows.
Spectrum transformed(Transform direction, Spectrum values, std::size_t rows, std::size_t columns) {
  for (const std::size_t length : {columns, rows}) {
    const std::size_t count = values.size() / length;
    const Spectrum lines = transformed_rows(direction, values, length);
    for (std::size_t i = 0; i < lines.size(); ++i) values[i % length * count + i / length] = lines[i];
  }
  return values;
}

// Transforms a picture without its mean, windowed.
Spectrum spectrum_of(const Blocks& picture) {
  const double mean = mean_of(picture.light);
  const Values down = bell(picture.rows), across = bell(picture.columns);
  Spectrum windowed(picture.light.size());
  for (std::size_t i = 0; i < windowed.size(); ++i)
    windowed[i] = (picture.light[i] - mean) * down[i / picture.columns] * across[i % picture.columns];
  return transformed(Transform::forward, std::move(windowed), picture.rows, picture.columns);
}

// Correlation of the phases at every displacement, C order, of any scale; a negative displacement is at rows or columns
// less it.
Values phase_correlation(const Blocks& before, const Blocks& after) {
  const Spectrum one = spectrum_of(before);
  Spectrum cross = spectrum_of(after);
  for (std::size_t i = 0; i < cross.size(); ++i) {
    cross[i] *= std::conj(one[i]);
    cross[i] /= std::abs(cross[i]) + std::numeric_limits<double>::min();
  }
  Values result;
  for (const auto& value : transformed(Transform::inverse, std::move(cross), after.rows, after.columns))
    result.push_back(value.real());
  return result;
}

// The peak at `place` of a circular line, refined by a parabola; from −length/2 to length/2.
template <class Line>
double refined_peak(Line line, std::size_t place, std::size_t length) {
  const double left = line((place + length - 1) % length), middle = line(place), right = line((place + 1) % length);
  const double bend = left - 2 * middle + right;
  const std::size_t half = length / 2;
  return static_cast<double>((place + half) % length) - static_cast<double>(half) +
         (bend < 0 ? 0.5 * (left - right) / bend : 0);
}

void check(const Blocks& before, const Blocks& after) {
  require(after.rows > 0 && after.columns > 0, "after", after.light.size(), "at least one pixel");
  require(after.light.size() == after.rows * after.columns, "after", after.light.size(), "rows x columns values");
  require(before.rows == after.rows && before.columns == after.columns && before.light.size() == after.light.size(),
          "before", before.light.size(), "a picture of the shape of after");
  for (const double value : before.light) require_finite("before", value);
  for (const double value : after.light) require_finite("after", value);
}

// True for a place more than half a pixel outside of a line.
bool is_outside(double place, std::size_t length) { return place < -0.5 || place > static_cast<double>(length) - 0.5; }

// One step of the gradients' equation of the whole picture (Lucas and Kanade 1981).
void improve(std::array<double, 2>& way, const Blocks& before, const Blocks& after) {
  const std::size_t columns = after.columns;
  const Values there = moved_picture(before.light, columns, way[0], way[1]);
  const auto slope = [&](std::size_t i, std::size_t apart) {
    return 0.25 * (there[i + apart] - there[i - apart] + after.light[i + apart] - after.light[i - apart]);
  };
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  for (std::size_t n = 1; n + 1 < after.rows; ++n)
    for (std::size_t i = n * columns + 1; i + 1 < (n + 1) * columns; ++i) {
      const Eigen::Vector2d slopes(slope(i, columns), slope(i, 1));
      normal += slopes * slopes.transpose();
      right += (there[i] - after.light[i]) * slopes;
    }
  const auto step = solve_normal(normal, right);
  if (!step) return;  // lines show one displacement only
  for (std::size_t k = 0; k < 2; ++k)
    way[k] += std::clamp(step->values[static_cast<Eigen::Index>(k)], -kMaxStep, kMaxStep);
}

std::array<double, 2> displacement(const Blocks& before, const Blocks& after) {
  if (std::min(after.rows, after.columns) < kMinSide) return {};
  const std::size_t columns = after.columns;
  const Values peaks = phase_correlation(before, after);
  const auto highest = static_cast<std::size_t>(std::max_element(peaks.begin(), peaks.end()) - peaks.begin());
  const std::size_t row = highest / columns, column = highest % columns;
  std::array way{refined_peak([&](std::size_t n) { return peaks[n * columns + column]; }, row, after.rows),
                 refined_peak([&](std::size_t k) { return peaks[row * columns + k]; }, column, columns)};
  for (int round = 0; round < kRounds; ++round) improve(way, before, after);
  return way;
}

}  // namespace

std::vector<double> moved_picture(std::span<const double> values, std::size_t columns, double down, double right) {
  require(columns > 0 && !values.empty() && values.size() % columns == 0, "values", values.size(), "rows x columns");
  const std::size_t rows = values.size() / columns;
  const auto last_row = static_cast<double>(rows - 1), last_column = static_cast<double>(columns - 1);
  Values result(values.size());
  for (std::size_t n = 0, i = 0; n < rows; ++n)
    for (std::size_t k = 0; k < columns; ++k, ++i) {
      const double row = std::clamp(static_cast<double>(n) - down, 0.0, last_row);
      const double column = std::clamp(static_cast<double>(k) - right, 0.0, last_column);
      const auto top = static_cast<std::size_t>(row), left = static_cast<std::size_t>(column);
      const double lower = row - static_cast<double>(top), further = column - static_cast<double>(left);
      const std::size_t below = top + 1 < rows ? columns : 0, beside = left + 1 < columns ? 1 : 0;
      const double* const at = &values[top * columns + left];
      result[i] =
          std::lerp(std::lerp(at[0], at[beside], further), std::lerp(at[below], at[below + beside], further), lower);
    }
  return result;
}

PictureChange picture_change(const Blocks& before, const Blocks& after) {
  check(before, after);
  const auto [down, right] = displacement(before, after);
  PictureChange change{down, right, {}};
  Blocks difference{after.rows, after.columns, moved_picture(before.light, before.columns, down, right),
                    Values(after.light.size(), 1.0)};
  for (std::size_t i = 0; i < after.light.size(); ++i)
    difference.light[i] = std::abs(difference.light[i] - after.light[i]);
  const Blocks means = block_means(difference.picture(), kWindow, kWindow);
  for (std::size_t n = 0; n < after.rows; ++n)
    for (std::size_t k = 0; k < after.columns; ++k) {
      const bool outside = is_outside(static_cast<double>(n) - down, after.rows) ||
                           is_outside(static_cast<double>(k) - right, after.columns);
      const double unlikeness = means.light[n / kWindow * means.columns + k / kWindow];
      change.is_new.push_back(outside || unlikeness > kSmallShare ? 1 : 0);
    }
  return change;
}

}  // namespace ocisac
