#include "lights/merging.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <span>
#include <vector>

#include "lights/light_patch.hpp"

namespace ocisac {

namespace {

constexpr double min_beside = 0.8, min_above = 0.9;          // correlation of swings
constexpr double min_between = 0.4, min_rows_between = 0.7;  // swing between parts, relative to the fainter part's
constexpr std::size_t touching = 8;                          // columns apart

IndexRange columns_of(const LightPart& part) { return {part.box.x, part.box.right()}; }
IndexRange rows_of(const LightPart& part) { return {part.box.y, part.box.bottom()}; }
IndexRange common(const IndexRange& a, const IndexRange& b) {
  return {std::max(a.begin, b.begin), std::min(a.end, b.end)};
}

// Two cycles of the slower one, an odd number of rows.
std::size_t mean_length(const LightPart& a, const LightPart& b) {
  return 2 * static_cast<std::size_t>(std::floor(1 / std::min(a.frequency, b.frequency) + 0.5)) + 1;
}

// Logarithm of the mean light minus its running mean over `length` rows; the first and the last row are repeated beyond
// the ends.
std::vector<double> swing(const LitFrame& frame, const IndexRange& columns, const IndexRange& rows,
                          std::size_t length) {
  std::vector<double> logs = mean_light(frame, columns, rows);
  for (double& value : logs) value = std::log(std::max(value, 0.0) + frame.floor);
  const std::size_t reach = length / 2, count = logs.size();
  std::vector<double> sums(count + 2 * reach + 1);
  for (std::size_t i = 0; i + 1 < sums.size(); ++i)
    sums[i + 1] = sums[i] + logs[std::min(i - std::min(i, reach), count - 1)];
  for (std::size_t n = 0; n < count; ++n) logs[n] -= (sums[n + length] - sums[n]) / static_cast<double>(length);
  return logs;
}

double product(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

// Root of the mean square.
double extent(std::span<const double> a) {
  return a.empty() ? 0 : std::sqrt(product(a, a) / static_cast<double>(a.size()));
}

// Correlation without removal of means.
double likeness(std::span<const double> a, std::span<const double> b) {
  const double energy = product(a, a) * product(b, b);
  return energy > 0 ? product(a, b) / std::sqrt(energy) : 0;
}

bool beside(const LitFrame& frame, const LightPart& left, const LightPart& right) {
  const IndexRange rows = common(rows_of(left), rows_of(right));
  const IndexRange between{left.box.right(), right.box.x};
  const std::size_t overlap = between.begin > between.end ? between.begin - between.end : 0;
  if (2 * rows.size() < std::min(left.box.height, right.box.height) || rows.size() == 0 ||
      between.size() > std::max(left.box.width, right.box.width) ||
      2 * overlap > std::min(left.box.width, right.box.width))
    return false;
  const std::size_t length = mean_length(left, right);
  const auto one = swing(frame, columns_of(left), rows, length), other = swing(frame, columns_of(right), rows, length);
  if (likeness(one, other) < min_beside) return false;
  if (between.size() < touching) return true;
  const auto middle = swing(frame, between, rows, length);
  return likeness(one, middle) >= min_beside && extent(middle) >= min_between * std::min(extent(one), extent(other));
}

bool above(const LitFrame& frame, const LightPart& upper, const LightPart& lower) {
  const IndexRange columns = common(columns_of(upper), columns_of(lower));
  const IndexRange between{upper.box.bottom(), lower.box.y};
  if (10 * columns.size() < 8 * std::max(upper.box.width, lower.box.width) || columns.size() < 4 ||
      static_cast<double>(between.size()) * std::max(upper.frequency, lower.frequency) < 1 ||
      between.size() > upper.box.height + lower.box.height)
    return false;
  const std::size_t middle = (columns.begin + columns.end) / 2, length = mean_length(upper, lower);
  const IndexRange rows{upper.box.y, lower.box.bottom()};
  const auto left = swing(frame, {columns.begin, middle}, rows, length);
  const auto right = swing(frame, {middle, columns.end}, rows, length);
  std::vector<double> both(rows.size());
  std::ranges::transform(left, right, both.begin(), std::plus{});
  const std::size_t first = between.begin - rows.begin, count = between.size();
  const std::span<const double> all(both);
  const double least = min_rows_between * std::min(extent(all.first(first)), extent(all.subspan(first + count)));
  return likeness(std::span(left).subspan(first, count), std::span(right).subspan(first, count)) >= min_above &&
         extent(all.subspan(first, count)) >= least;
}

}  // namespace

bool one_light_across(const LitFrame& frame, const LightPart& a, const LightPart& b) {
  return a.box.x <= b.box.x ? beside(frame, a, b) : beside(frame, b, a);
}

bool one_light_down(const LitFrame& frame, const LightPart& a, const LightPart& b) {
  return a.box.y <= b.box.y ? above(frame, a, b) : above(frame, b, a);
}

double likeness_of_frames(LitFrame frame, std::size_t other, const LightPart& part) {
  const std::size_t length = mean_length(part, part);
  const auto here = swing(frame, columns_of(part), rows_of(part), length);
  frame.index = other;
  return likeness(here, swing(frame, columns_of(part), rows_of(part), length));
}

}  // namespace ocisac
