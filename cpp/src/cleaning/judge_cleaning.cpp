#include "ocisac/cleaning/judge_cleaning.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "cleaning/block_shares.hpp"
#include "cleaning/cleaned_picture.hpp"
#include "cleaning/pair_misfit.hpp"
#include "core/statistics.hpp"

namespace ocisac {

namespace {

constexpr std::size_t most_groups = 24;                  // of columns
constexpr std::size_t enough_columns = 96;               // evenly spaced, that are judged
constexpr double min_left = 0.125;                       // lower bound of a light that is a divisor
constexpr double floor_of_light = 0.01;                  // of the mean light, below which logarithms show noise
constexpr double most_left = 0.25;                       // of the row light; of a texture 0.28 and more
constexpr double min_level = 0.25;                       // of a light on part of the picture 0.4 and more
constexpr double min_part = 0.8;                         // of a group's pixels, of rows that count
constexpr double smallest = 1e-100, independent = 1e-9;  // of a term that another one does not explain

using Values = std::vector<double>;

// Some columns of a picture before or after cleaning; a pixel that is not kept was saturated or too dark.
struct Side {
  Values light, variance;
  std::vector<std::uint8_t> kept;

  explicit Side(std::size_t size) : light(size), variance(size), kept(size) {}
};

struct Compared {
  std::size_t rows, columns;
  Side before, after;
};

Compared compared(const BandedPicture& picture, std::span<const double> row_light, const BlockShares& shares) {
  const std::size_t every = std::max<std::size_t>(1, picture.columns / enough_columns);
  const std::size_t columns = blocks_of(picture.columns, every), pixels = picture.rows * columns;
  const std::size_t blocks = blocks_of(picture.columns, shares.block_columns);
  Compared result{picture.rows, columns, Side(pixels), Side(pixels)};
  for (std::size_t n = 0, at = 0; n < picture.rows; ++n)
    for (std::size_t k = 0; k < picture.columns; k += every, ++at) {
      const double light = picture.light[n * picture.columns + k], variance = picture.variance[n * picture.columns + k];
      const double share = shares.share[n / shares.block_rows * blocks + k / shares.block_columns];
      const double left = std::max(1 + share * (row_light[n] - 1), min_left);
      result.before.light[at] = light;
      result.before.variance[at] = variance;
      result.before.kept[at] = std::isfinite(variance) ? 1 : 0;
      result.after.light[at] = light / left;
      result.after.variance[at] = variance / (left * left);
      result.after.kept[at] = result.before.kept[at] != 0 && left > min_left ? 1 : 0;
    }
  return result;
}

std::vector<PairMisfit> misfit_of(const Side& side, std::size_t columns, std::size_t lag) {
  std::vector<PairMisfit> of_columns(columns);
  add_misfit(side.light, side.variance, lag, of_columns);
  return of_columns;
}

PairMisfit total(std::span<const PairMisfit> of_columns) {
  PairMisfit sum;
  for (const PairMisfit& one : of_columns) sum += one;
  return sum;
}

double decrease_of_misfit(const Compared& picture, std::size_t lag) {
  const auto mean = [&](const Side& side) { return total(misfit_of(side, picture.columns, lag)).mean(); };
  return mean(picture.before) - mean(picture.after);
}

// The row light and its gradient, which a shift adds, of standard deviation 1.
std::array<Values, 2> course_of(std::span<const double> row_light) {
  const std::size_t last = row_light.size() - 1;
  std::array<Values, 2> course{Values(row_light.begin(), row_light.end()), Values(row_light.size())};
  for (std::size_t n = 0; n <= last; ++n)
    course[1][n] = row_light[std::min(n + 1, last)] - row_light[n == 0 ? 0 : n - 1];
  for (Values& term : course) {
    const auto count = static_cast<double>(term.size());
    const double mean = mean_of(term);
    const double squares = smallest + squares_about_mean(term);
    for (double& value : term) value = (value - mean) / std::sqrt(squares / count);
  }
  return course;
}

// Terms of the course in the changes of some logarithms over `lag` rows. Edges count little, at first more, so that
// bands are not taken for edges.
std::array<double, 2> swing_in(const Values& level, const std::array<Values, 2>& course, std::size_t lag) {
  std::array<double, 2> terms{};
  for (const double texture : row_textures) {
    double aa = smallest, ab = 0, bb = smallest, right_a = 0, right_b = 0;
    for (std::size_t n = 0; n + lag < level.size(); ++n) {
      const double change = level[n + lag] - level[n], a = course[0][n + lag] - course[0][n],
                   b = course[1][n + lag] - course[1][n], rest = change - terms[0] * a - terms[1] * b;
      if (!std::isfinite(rest)) continue;
      const double weight = 1 / (texture * texture + rest * rest);
      aa += weight * a * a;
      ab += weight * a * b;
      bb += weight * b * b;
      right_a += weight * a * change;
      right_b += weight * b * change;
    }
    const double determinant = aa * bb - ab * ab;
    const bool are_two = determinant > independent * aa * bb;
    terms = are_two
                ? std::array{(bb * right_a - ab * right_b) / determinant, (aa * right_b - ab * right_a) / determinant}
                : std::array{right_a / aa, 0.0};
  }
  return terms;
}

// First columns of the groups, and the number of columns last.
std::vector<std::size_t> group_starts(std::size_t columns) {
  std::vector<std::size_t> starts;
  const double width = static_cast<double>(columns) / static_cast<double>(most_groups);
  for (std::size_t group = 0; group < most_groups; ++group) {
    const auto start = static_cast<std::size_t>(static_cast<double>(group) * width);
    if (starts.empty() || start != starts.back()) starts.push_back(start);
  }
  starts.push_back(columns);
  return starts;
}

// Logarithm of the mean light of columns [first, end) in each row; none in those that lack pixels.
Values group_levels(const Side& side, std::size_t rows, std::size_t columns, std::size_t first, std::size_t end,
                    double floor) {
  Values means(rows), counts(rows);
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t at = n * columns + first; at < n * columns + end; ++at)
      if (side.kept[at] != 0) {
        means[n] += side.light[at];
        counts[n] += 1;
      }
  const double enough = std::max(min_part * *std::max_element(counts.begin(), counts.end()), 1.0);
  for (std::size_t n = 0; n < rows; ++n)
    means[n] = counts[n] < enough ? NAN : std::log(std::max(means[n] / counts[n], floor));
  return means;
}

void judge_swing(const Compared& picture, std::span<const double> row_light, std::size_t lag,
                 CleaningVerdict& verdict) {
  const std::array<Values, 2> course = course_of(row_light);
  const std::vector<std::size_t> starts = group_starts(picture.columns);
  const auto groups = static_cast<double>(starts.size() - 1);
  const double mean_light = std::max(mean_of(picture.before.light), smallest);
  std::array<double, 2> mean{};
  double left = 0, energy = 0;
  for (std::size_t group = 0; group + 1 < starts.size(); ++group) {
    const auto swing = [&](const Side& side) {
      return swing_in(group_levels(side, picture.rows, picture.columns, starts[group], starts[group + 1],
                                   floor_of_light * mean_light),
                      course, lag);
    };
    const std::array<double, 2> before = swing(picture.before), after = swing(picture.after);
    for (std::size_t k = 0; k < mean.size(); ++k) {
      energy += before[k] * before[k];
      left += after[k] * after[k];
      mean[k] += before[k] / groups;
    }
  }
  if (!(energy > smallest)) return;
  verdict.light_left = std::sqrt(left / energy);
  verdict.level = (mean[0] * mean[0] + mean[1] * mean[1]) * groups / energy;
  verdict.energy = energy * mean_light * mean_light;
}

// Mean square of the mixed differences of log light over rows and columns, in which bands and gains cancel.
double texture_of(const Values& light, const std::vector<std::uint8_t>& kept, std::size_t columns) {
  const double mean = mean_of(light);
  Values level(light.size());
  for (std::size_t i = 0; i < level.size(); ++i)
    level[i] = std::log(std::max(light[i], 0.0) + floor_of_light * std::max(mean, smallest));
  double sum = 0, count = 0;
  for (std::size_t first = 0; first + columns < level.size(); first += columns)
    for (std::size_t i = first, j = first + columns; i + 1 < first + columns; ++i, ++j) {
      if ((kept[i] & kept[i + 1] & kept[j] & kept[j + 1]) == 0) continue;
      const double mixed = (level[j + 1] - level[j]) - (level[i + 1] - level[i]);
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
  const Compared sides = compared(picture, row_light, shares);
  CleaningVerdict verdict;
  const std::size_t lag = comparison_lag(row_light, picture.rows);
  verdict.gain = decrease_of_misfit(sides, lag);
  judge_swing(sides, row_light, lag, verdict);
  const double before = texture_of(sides.before.light, sides.after.kept, sides.columns);
  const double after = texture_of(sides.after.light, sides.after.kept, sides.columns);
  verdict.texture_change = before > 0 && after > 0 ? 10 * std::log10(after / before) : 0;
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
  if (verdict.light_left < most_left) return {};
  return verdict.level < min_level ? "bands that tilt or curve" : "rows of the picture, or of light that is not even";
}

}  // namespace ocisac
