#include "ocisac/cleaning/judge_cleaning.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <vector>

#include "cleaning/block_shares.hpp"
#include "cleaning/cleaned_picture.hpp"
#include "cleaning/pair_misfit.hpp"
#include "cleaning/slow_changes.hpp"

namespace ocisac {

namespace {

constexpr std::size_t most_groups = 24;                  // of columns
constexpr double min_left = 0.125;                       // lower bound of a light that is a divisor
constexpr double floor_of_light = 0.01;                  // of the mean light, below which logarithms show noise
constexpr double min_gain = 0.03;                        // texture without a light gives less
constexpr double half_left = 0.5, much_left = 0.6;       // of the row light
constexpr double min_level = 0.25;                       // of a light on part of the picture 0.4 and more
constexpr double max_worse = 0.25;                       // share of the columns
constexpr double min_part = 0.8;                         // of a group's pixels, of rows that count
constexpr double smallest = 1e-300, independent = 1e-9;  // of a term that another one does not explain

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

Compared compared(const BandedPicture& picture, std::span<const double> row_light, const BlockShares& shares,
                  std::size_t max_columns) {
  const std::size_t every = std::max<std::size_t>(1, picture.columns / max_columns);
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

void judge_misfit(const Compared& picture, std::size_t lag, CleaningVerdict& verdict) {
  const std::size_t columns = picture.columns, groups = std::min(most_groups, columns);
  const std::vector<PairMisfit> before = misfit_of(picture.before, columns, lag);
  const std::vector<PairMisfit> after = misfit_of(picture.after, columns, lag);
  verdict.gain = total(before).mean() - total(after).mean();
  std::size_t grown = 0;
  for (std::size_t group = 0, first = 0; group < groups; ++group) {
    const std::size_t count = columns / groups + (group < columns % groups ? 1 : 0);
    const auto mean = [&](std::span<const PairMisfit> all) { return total(all.subspan(first, count)).mean(); };
    grown += mean(after) > mean(before) ? 1 : 0;
    first += count;
  }
  verdict.worse = static_cast<double>(grown) / static_cast<double>(groups);
}

double dot(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

void remove_along(std::span<const double> unit, std::span<double> values) {
  const double part = dot(unit, values);
  for (std::size_t n = 0; n < values.size(); ++n) values[n] -= part * unit[n];
}

Values gradient_of(std::span<const double> values) {
  const std::size_t last = values.size() - 1;
  Values result(values.size());
  for (std::size_t n = 0; n <= last; ++n) {
    const std::size_t before = n == 0 ? 0 : n - 1, after = std::min(n + 1, last);
    result[n] = (values[after] - values[before]) / static_cast<double>(std::max<std::size_t>(after - before, 1));
  }
  return result;
}

// Orthonormal course of the row light and its derivative, which a shift adds, without slow changes; fewer than two
// where they are not independent.
std::vector<Values> course_of(std::span<const double> row_light) {
  std::array<Values, 2> terms{Values(row_light.begin(), row_light.end()), gradient_of(row_light)};
  for (Values& term : terms) remove_slow_changes(term);
  if (dot(terms[0], terms[0]) < dot(terms[1], terms[1])) std::swap(terms[0], terms[1]);
  const double least = std::max(independent * std::sqrt(dot(terms[0], terms[0])), smallest);
  std::vector<Values> course;
  for (Values& term : terms) {
    for (int again = 0; again < 2; ++again)  // once more for what rounding left
      for (const Values& unit : course) remove_along(unit, term);
    const double size = std::sqrt(dot(term, term));
    if (!(size > least)) break;
    for (double& value : term) value /= size;
    course.push_back(std::move(term));
  }
  return course;
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

// Mean light of columns [first, end) in each row; the mean of all such rows in those that lack pixels.
Values group_means(const Side& side, std::size_t rows, std::size_t columns, std::size_t first, std::size_t end) {
  Values means(rows), counts(rows);
  for (std::size_t n = 0; n < rows; ++n) {
    for (std::size_t at = n * columns + first; at < n * columns + end; ++at)
      if (side.kept[at] != 0) {
        means[n] += side.light[at];
        counts[n] += 1;
      }
    means[n] /= std::max(counts[n], 1.0);
  }
  const double enough = std::max(min_part * *std::max_element(counts.begin(), counts.end()), 1.0);
  double sum = 0, whole = 0;
  for (std::size_t n = 0; n < rows; ++n)
    if (counts[n] >= enough) {
      sum += means[n];
      whole += 1;
    }
  for (std::size_t n = 0; n < rows; ++n)
    if (counts[n] < enough) means[n] = sum / std::max(whole, 1.0);
  return means;
}

void judge_swing(const Compared& picture, std::span<const double> row_light, CleaningVerdict& verdict) {
  const std::vector<Values> course = course_of(row_light);
  const std::vector<std::size_t> starts = group_starts(picture.columns);
  const auto groups = static_cast<double>(starts.size() - 1);
  std::array<double, 2> mean{};
  double left = 0;
  for (std::size_t group = 0; group + 1 < starts.size(); ++group) {
    const auto means = [&](const Side& side) {
      return group_means(side, picture.rows, picture.columns, starts[group], starts[group + 1]);
    };
    const Values before = means(picture.before), after = means(picture.after);
    for (std::size_t k = 0; k < course.size(); ++k) {
      const double swing = dot(course[k], before), swing_left = dot(course[k], after);
      verdict.energy += swing * swing;
      left += swing_left * swing_left;
      mean[k] += swing / groups;
    }
  }
  if (!(verdict.energy > 0)) return;
  verdict.light_left = std::sqrt(left / verdict.energy);
  verdict.level = dot(mean, mean) * groups / verdict.energy;
}

// Mean square of the mixed differences of log light over rows and columns, in which bands and gains cancel.
double texture_of(const Values& light, const std::vector<std::uint8_t>& kept, std::size_t columns) {
  const double mean = std::accumulate(light.begin(), light.end(), 0.0) / static_cast<double>(light.size());
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
                               const BlockShares& shares, std::size_t max_columns) {
  check(picture, row_light);
  require(picture.frames == 1, "frames", picture.frames, "1");
  require(max_columns > 0, "max_columns", max_columns, "1 or more");
  check(shares, picture.rows, picture.columns);
  const Compared sides = compared(picture, row_light, shares, max_columns);
  CleaningVerdict verdict;
  judge_misfit(sides, comparison_lag(row_light, picture.rows), verdict);
  judge_swing(sides, row_light, verdict);
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
    mean.worse += weight * one.worse;
    mean.level += weight * one.level;
    mean.slow_bands += weight * one.slow_bands;
    mean.energy += weight * one.energy;
  }
  return mean;
}

std::string objection_to(const CleaningVerdict& verdict) {
  if (!(verdict.energy > 0)) return "no bands: all rows have the same light";
  if (verdict.light_left > 1) return "the bands would be stronger than before";
  if (verdict.gain < min_gain && (verdict.light_left > half_left || verdict.gain < 0))
    return "no light of the rows: they would differ as much as before";
  if (verdict.light_left > much_left && verdict.level < min_level) return "bands that tilt or curve";
  if (verdict.light_left > much_left && verdict.worse > max_worse) return "some columns would get worse";
  return {};
}

}  // namespace ocisac
