#include "cleaning/picture_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <numeric>

#include "core/check_interrupt.hpp"
#include "core/spectrum.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr std::size_t most_reach = 4;  // half width of a window, pixels
constexpr int rounds = 2;
constexpr std::size_t min_side = 4;  // pixels
constexpr double hold = 2e-4;        // mean squared gradient that halves a displacement: texture of 1.4 % a pixel
constexpr double max_step = 2;       // pixels, of what the mean displacement leaves
constexpr double whitened = 1e-3;    // of the mean spectrum, below which a frequency counts less
constexpr double unlike = 0.1;       // difference of the moved picture's logarithm, in a window
constexpr double half_pixel = 0.5;

// Dense (rows × columns).
struct Shape {
  std::size_t rows, columns;

  [[nodiscard]] std::size_t size() const { return rows * columns; }
};

// The window of Hann, not 0 at its ends.
Values bell(std::size_t length) {
  Values result(length);
  for (std::size_t n = 0; n < length; ++n)
    result[n] =
        0.5 - 0.5 * std::cos(2 * std::numbers::pi * static_cast<double>(n + 1) / static_cast<double>(length + 1));
  return result;
}

// Spectrum of a windowed picture: (columns/2 + 1) × rows.
std::vector<std::complex<double>> spectrum_of(const LogPicture& picture) {
  const std::size_t rows = picture.rows, columns = picture.columns, bins = columns / 2 + 1;
  const double mean =
      std::accumulate(picture.values.begin(), picture.values.end(), 0.0) / static_cast<double>(picture.values.size());
  const Values down = bell(rows), across = bell(columns);
  Values windowed(picture.values.size());
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t k = 0; k < columns; ++k)
      windowed[n * columns + k] = (picture.values[n * columns + k] - mean) * down[n] * across[k];
  const std::vector<std::complex<double>> of_rows = half_spectra(windowed, columns);
  std::vector<std::complex<double>> turned(of_rows.size()), result(of_rows.size());
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t k = 0; k < bins; ++k) turned[k * rows + n] = of_rows[n * bins + k];
  transform_rows(Transform::forward, turned.data(), result.data(), bins, rows, rows);
  return result;
}

// Correlation of the phases at every displacement, C order; a negative displacement is at rows or columns less it.
Values phase_correlation(const LogPicture& before, const LogPicture& after) {
  const std::size_t rows = after.rows, columns = after.columns, bins = columns / 2 + 1;
  const std::vector<std::complex<double>> one = spectrum_of(before);
  std::vector<std::complex<double>> cross = spectrum_of(after);
  double mean = 0;
  for (std::size_t i = 0; i < cross.size(); ++i) {
    cross[i] *= std::conj(one[i]);
    mean += std::abs(cross[i]) / static_cast<double>(cross.size());
  }
  for (std::complex<double>& value : cross) value /= std::abs(value) + whitened * mean + 1e-300;
  std::vector<std::complex<double>> turned(cross.size()), of_rows(cross.size());
  transform_rows(Transform::inverse, cross.data(), turned.data(), bins, rows, rows);
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t k = 0; k < bins; ++k) of_rows[n * bins + k] = turned[k * rows + n] / static_cast<double>(rows);
  return signals_of_half_spectra(of_rows, columns);
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

std::array<double, 2> mean_displacement(const LogPicture& before, const LogPicture& after) {
  const std::size_t columns = after.columns;
  const Values peaks = phase_correlation(before, after);
  const auto highest = static_cast<std::size_t>(std::max_element(peaks.begin(), peaks.end()) - peaks.begin());
  const std::size_t row = highest / columns, column = highest % columns;
  return {refined_peak([&](std::size_t n) { return peaks[n * columns + column]; }, row, after.rows),
          refined_peak([&](std::size_t k) { return peaks[row * columns + k]; }, column, columns)};
}

std::size_t held(std::size_t place, std::size_t offset, std::size_t reach, std::size_t length) {
  return std::clamp(place + offset, reach, length - 1 + reach) - reach;
}

// Means over windows of 9 × 9 pixels, those of the border repeated beyond it.
void take_window_means(Values& values, const Shape& shape) {
  check_interrupt();
  const std::size_t columns = shape.columns;
  const std::size_t down = std::min(most_reach, shape.rows - 1), across = std::min(most_reach, columns - 1);
  Values sums(values.size());
  for (std::size_t n = 0; n < shape.rows; ++n)
    for (std::size_t offset = 0; offset <= 2 * down; ++offset) {
      const double* const from = &values[held(n, offset, down, shape.rows) * columns];
      for (std::size_t k = 0; k < columns; ++k) sums[n * columns + k] += from[k];
    }
  const auto count = static_cast<double>((2 * down + 1) * (2 * across + 1));
  Values line(columns + 2 * across);  // with the border repeated
  for (std::size_t n = 0; n < shape.rows; ++n) {
    for (std::size_t k = 0; k < line.size(); ++k) line[k] = sums[n * columns + held(k, 0, across, columns)];
    for (std::size_t k = 0; k < columns; ++k) {
      double sum = 0;
      for (std::size_t offset = 0; offset <= 2 * across; ++offset) sum += line[k + offset];
      values[n * columns + k] = sum / count;
    }
  }
}

// Differences of the neighbours at a place of a line, per pixel; one-sided at its ends.
template <class Line>
double slope_of(Line line, std::size_t place, std::size_t length) {
  if (place == 0) return line(1) - line(0);
  if (place + 1 == length) return line(place) - line(place - 1);
  return 0.5 * (line(place + 1) - line(place - 1));
}

// Sums of the gradients' equation in the window of each pixel: products of the slopes down (d) and right (r) and the
// change (c) from `there` to `after`.
struct GradientSums {
  Values dd, dr, rr, dc, rc;
};

GradientSums gradient_sums(const Values& there, const LogPicture& after, const Shape& shape) {
  const std::size_t size = shape.size(), columns = shape.columns;
  Values mean(size);
  for (std::size_t i = 0; i < size; ++i) mean[i] = 0.5 * (there[i] + after.values[i]);
  GradientSums sums{Values(size), Values(size), Values(size), Values(size), Values(size)};
  for (std::size_t n = 0, i = 0; n < shape.rows; ++n)
    for (std::size_t k = 0; k < columns; ++k, ++i) {
      const double down = slope_of([&](std::size_t at) { return mean[at * columns + k]; }, n, shape.rows);
      const double right = slope_of([&](std::size_t at) { return mean[n * columns + at]; }, k, columns);
      const double change = there[i] - after.values[i];
      sums.dd[i] = down * down;
      sums.dr[i] = down * right;
      sums.rr[i] = right * right;
      sums.dc[i] = down * change;
      sums.rc[i] = right * change;
    }
  for (Values* each : {&sums.dd, &sums.dr, &sums.rr, &sums.dc, &sums.rc}) take_window_means(*each, shape);
  return sums;
}

void improve(PictureMotion& motion, const LogPicture& before, const LogPicture& after) {
  const Values there = moved_picture(before.values, before.columns, motion);
  const GradientSums sums = gradient_sums(there, after, {after.rows, after.columns});
  for (std::size_t i = 0; i < there.size(); ++i) {
    const double dd = sums.dd[i] + hold, rr = sums.rr[i] + hold, dr = sums.dr[i];
    const double scale = dd * rr - dr * dr;
    motion.down[i] += std::clamp((rr * sums.dc[i] - dr * sums.rc[i]) / scale, -max_step, max_step);
    motion.right[i] += std::clamp((dd * sums.rc[i] - dr * sums.dc[i]) / scale, -max_step, max_step);
  }
}

void check(const LogPicture& before, const LogPicture& after) {
  require(after.rows > 0 && after.columns > 0, "after", after.values.size(), "at least one pixel");
  require(after.values.size() == after.rows * after.columns, "after", after.values.size(), "rows x columns values");
  require(before.rows == after.rows && before.columns == after.columns && before.values.size() == after.values.size(),
          "before", before.values.size(), "a picture of the shape of after");
  for (const double value : before.values) require_finite("before", value);
  for (const double value : after.values) require_finite("after", value);
}

// Whether a place is more than half a pixel outside of a line.
bool is_outside(double place, std::size_t length) {
  return place < -half_pixel || place > static_cast<double>(length) - half_pixel;
}

}  // namespace

PictureMotion picture_motion(const LogPicture& before, const LogPicture& after) {
  check(before, after);
  const std::size_t size = after.values.size();
  if (std::min(after.rows, after.columns) < min_side) return {Values(size), Values(size)};
  const auto [down, right] = mean_displacement(before, after);
  PictureMotion motion{Values(size, down), Values(size, right)};
  for (int round = 0; round < rounds; ++round) improve(motion, before, after);
  return motion;
}

std::vector<double> moved_picture(std::span<const double> values, std::size_t columns, const PictureMotion& motion) {
  require(columns > 0 && !values.empty() && values.size() % columns == 0, "values", values.size(), "rows x columns");
  require(motion.down.size() == values.size() && motion.right.size() == values.size(), "motion", motion.down.size(),
          "one way a pixel");
  for (const auto* ways : {&motion.down, &motion.right})
    for (const double way : *ways) require_finite("motion", way);
  const std::size_t rows = values.size() / columns;
  const std::size_t below = rows > 1 ? columns : 0, beside = columns > 1 ? 1 : 0;
  const auto last_row = static_cast<double>(rows - 1), last_column = static_cast<double>(columns - 1);
  Values result(values.size());
  for (std::size_t n = 0, i = 0; n < rows; ++n)
    for (std::size_t k = 0; k < columns; ++k, ++i) {
      const double down = std::clamp(static_cast<double>(n) - motion.down[i], 0.0, last_row);
      const double right = std::clamp(static_cast<double>(k) - motion.right[i], 0.0, last_column);
      const std::size_t top = std::min(static_cast<std::size_t>(down), rows > 1 ? rows - 2 : 0);
      const std::size_t left = std::min(static_cast<std::size_t>(right), columns > 1 ? columns - 2 : 0);
      const double lower = down - static_cast<double>(top), further = right - static_cast<double>(left);
      const double* const at = &values[top * columns + left];
      const double above = at[0] * (1 - further) + at[beside] * further;
      const double under = at[below] * (1 - further) + at[below + beside] * further;
      result[i] = above * (1 - lower) + under * lower;
    }
  return result;
}

PictureChange picture_change(const LogPicture& before, const LogPicture& after) {
  PictureChange change{picture_motion(before, after), {}};
  Values difference = moved_picture(before.values, before.columns, change.motion);
  for (std::size_t i = 0; i < difference.size(); ++i) difference[i] = std::abs(difference[i] - after.values[i]);
  take_window_means(difference, {after.rows, after.columns});
  for (std::size_t n = 0, i = 0; n < after.rows; ++n)
    for (std::size_t k = 0; k < after.columns; ++k, ++i) {
      const bool outside = is_outside(static_cast<double>(n) - change.motion.down[i], after.rows) ||
                           is_outside(static_cast<double>(k) - change.motion.right[i], after.columns);
      change.is_new.push_back(outside || difference[i] > unlike ? 1 : 0);
    }
  return change;
}

}  // namespace ocisac
