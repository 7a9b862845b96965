#include "ocisac/cleaning/judge_cleaning.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "cleaning/block_shares.hpp"
#include "cleaning/cleaned_picture.hpp"
#include "cleaning/merged_blocks.hpp"
#include "core/statistics.hpp"
#include "ocisac/core/constants.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

constexpr double kMostLeft = 0.25;  // of the row light; of a texture 0.28 and more
constexpr double kMinPart = 0.8;    // of a group's pixels, of rows that count

using Values = std::vector<double>;

// Some columns of a picture before and after cleaning.
std::array<Blocks, 2> compared(const BandedPicture& picture, std::span<const double> row_light,
                               const BlockShares& shares) {
  const std::size_t every = std::max<std::size_t>(1, picture.columns / kEnoughColumns);
  Blocks before{picture.rows, blocks_of(picture.columns, every), {}, {}};
  for (std::size_t n = 0; n < picture.rows; ++n)
    for (std::size_t k = 0; k < picture.columns; k += every) {
      before.light.push_back(picture.light[n * picture.columns + k]);
      before.variance.push_back(picture.variance[n * picture.columns + k]);
    }
  Blocks after = without_light(before.picture(), row_light, [&](std::size_t row, std::size_t column) {
    return share_at(shares, row, column * every, picture.columns);
  });
  return {std::move(before), std::move(after)};
}

// The row light and its gradient, which a shift adds, of standard deviation 1.
std::array<Values, 2> course_of(std::span<const double> row_light) {
  const std::size_t last = row_light.size() - 1;
  std::array<Values, 2> course{Values(row_light.begin(), row_light.end()), Values(row_light.size())};
  for (std::size_t n = 0; n <= last; ++n)
    course[1][n] = row_light[std::min(n + 1, last)] - row_light[n == 0 ? 0 : n - 1];
  for (Values& term : course) {
    const double mean = mean_of(term), deviation = std::sqrt(variance_of(term));
    for (double& value : term) value = deviation > 0 ? (value - mean) / deviation : 0;
  }
  return course;
}

// Terms of the course in the changes of some logarithms over `lag` rows. Edges count little, at first more, so that
// bands are not taken for edges.
Eigen::Vector2d swing_in(const Values& level, const std::array<Values, 2>& course, std::size_t lag) {
  Eigen::Vector2d terms = Eigen::Vector2d::Zero();
  for (const double texture : kRowTextures) {
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (std::size_t n = 0; n + lag < level.size(); ++n) {
      const Eigen::Vector2d slope(course[0][n + lag] - course[0][n], course[1][n + lag] - course[1][n]);
      const double change = level[n + lag] - level[n], rest = change - terms.dot(slope);
      if (!std::isfinite(rest)) continue;
      const double weight = 1 / (texture * texture + rest * rest);
      normal += weight * slope * slope.transpose();
      right += weight * change * slope;
    }
    if (const auto both = solve_normal(normal, right))
      terms = both->values;
    else
      terms << (normal(0, 0) > 0 ? right[0] / normal(0, 0) : 0), 0;
  }
  return terms;
}

// Logarithm of the mean light of columns [first, end) in each row; none in those that lack pixels.
Values group_levels(const Blocks& side, std::size_t first, std::size_t end, double floor) {
  Values means(side.rows), counts(side.rows);
  for (std::size_t n = 0; n < side.rows; ++n)
    for (std::size_t at = n * side.columns + first; at < n * side.columns + end; ++at)
      if (std::isfinite(side.variance[at])) {
        means[n] += side.light[at];
        counts[n] += 1;
      }
  const double enough = std::max(kMinPart * *std::max_element(counts.begin(), counts.end()), 1.0);
  for (std::size_t n = 0; n < side.rows; ++n)
    means[n] = counts[n] < enough ? NAN : std::log(std::max(means[n] / counts[n], floor));
  return means;
}

void judge_swing(const Blocks& before, const Blocks& after, std::span<const double> row_light, std::size_t lag,
                 CleaningVerdict& verdict) {
  const std::array<Values, 2> course = course_of(row_light);
  const std::size_t groups = std::min(kMostGroups, before.columns);
  const double mean_light = std::max(mean_of(before.light), std::numeric_limits<double>::min());
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double left = 0, energy = 0;
  for (std::size_t group = 0; group < groups; ++group) {
    const auto swing = [&](const Blocks& side) {
      const std::size_t first = group * before.columns / groups, end = (group + 1) * before.columns / groups;
      return swing_in(group_levels(side, first, end, kLeastLight * mean_light), course, lag);
    };
    const Eigen::Vector2d then = swing(before);
    energy += then.squaredNorm();
    left += swing(after).squaredNorm();
    mean += then / static_cast<double>(groups);
  }
  if (!(energy > 0)) return;
  verdict.light_left = std::sqrt(left / energy);
  verdict.level = mean.squaredNorm() * static_cast<double>(groups) / energy;
  verdict.energy = energy * mean_light * mean_light;
}

// Mean square of the mixed differences of log light over rows and columns, in which bands and gains cancel, of pixels
// that are known after cleaning.
double texture_of(const Blocks& side, const Blocks& after) {
  const double floor = kLeastLight * std::max(mean_of(side.light), std::numeric_limits<double>::min());
  const auto step = [&](std::size_t i) {
    return (std::max(side.light[i + 1], 0.0) + floor) / (std::max(side.light[i], 0.0) + floor);
  };
  double sum = 0, count = 0;
  for (std::size_t first = 0; first + side.columns < side.light.size(); first += 2 * side.columns)  // pairs of rows
    for (std::size_t i = first, j = first + side.columns; i + 1 < first + side.columns; ++i, ++j) {
      if (!std::isfinite(after.variance[i] + after.variance[i + 1] + after.variance[j] + after.variance[j + 1]))
        continue;
      const double mixed = std::log(step(j) / step(i));
      sum += mixed * mixed;
      count += 1;
    }
  return count > 0 ? sum / count : 0;
}

}  // namespace

CleaningVerdict judge_cleaning(const BandedPicture& picture, std::span<const double> row_light,
                               const BlockShares& shares) {
  check(picture, row_light);
  require(picture.frames == 1, "frames", picture.frames, "1");
  check(shares, picture.rows, picture.columns);
  auto [before, after] = compared(picture, row_light, shares);
  CleaningVerdict verdict;
  const std::size_t lag = comparison_lag(row_light, picture.rows);
  verdict.gain = pair_misfit(before.picture(), lag) - pair_misfit(after.picture(), lag);
  for (std::size_t i = 0; i < after.variance.size(); ++i)  // too dark to be known
    if (!(after.variance[i] * kMinLight * kMinLight < before.variance[i])) after.variance[i] = kInfinity;
  judge_swing(before, after, row_light, lag, verdict);
  const double then = texture_of(before, after), now = texture_of(after, after);
  verdict.texture_change = then > 0 && now > 0 ? 10 * std::log10(now / then) : 0;
  return verdict;
}

CleaningVerdict mean_verdict(std::span<const CleaningVerdict> verdicts) {
  require(!verdicts.empty(), "verdicts", 0, "at least one");
  double energy = 0;
  for (const CleaningVerdict& one : verdicts) energy += one.energy;
  const auto count = static_cast<double>(verdicts.size());
  CleaningVerdict mean{.level = 0};
  for (const CleaningVerdict& one : verdicts) {
    const double weight = energy > 0 ? one.energy / energy : 1 / count;
    mean.light_left += weight * one.light_left;
    mean.texture_change += weight * one.texture_change;
    mean.gain += weight * one.gain;
    mean.level += weight * one.level;
    mean.slow_bands += weight * one.slow_bands;
    mean.energy += weight * one.energy;
  }
  return mean;
}

std::string objection_to(const CleaningVerdict& verdict) {
  if (!(verdict.energy > 0)) return "no bands: all rows have the same light";
  if (verdict.light_left > 1) return "the bands would be stronger than before";
  if (verdict.gain < 0) return "no light of the rows: they would differ as much as before";
  if (verdict.light_left < kMostLeft) return {};
  return verdict.level < kMinLevel ? "bands that tilt or curve" : "rows of the picture, or of light that is not even";
}

}  // namespace ocisac
