#include "chips/lit_rows.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "chips/edges.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"

namespace ocisac {

namespace {

constexpr double kNoiseErrors = 4.5;  // standard deviations of a row that is lit
constexpr double kNoiseKept = 2;      // standard deviations
constexpr double kMinTurn = 0.15;     // of the span of the signal
constexpr double kMinDarkRuns =
    1.5;  // times the longest run of the light, of a preamble: rows that are dark if as long
constexpr std::size_t kMinTurns = 8;

// The value at an index of the sorted ones.
double quantile(std::span<const double> values, std::size_t index) {
  std::vector<double> sorted(values.begin(), values.end());
  const auto at = sorted.begin() + static_cast<std::ptrdiff_t>(index);
  std::ranges::nth_element(sorted, at);
  return *at;
}

// Standard deviation about a straight line.
double unsteadiness(std::span<const double> part) {
  std::vector<double> rest(part.begin(), part.end());
  remove_line(rest);
  return std::sqrt(product_at_lag(rest, 0) / static_cast<double>(rest.size()));
}

// Rows from the end of `signal` on that stay near the level of its steady part, which is `steady` rows long; none where
// that varies by more than noise and texture do. `span`: of the light, `spread`: noise.
std::size_t dark_rows(std::span<const double> signal, std::size_t steady, double span, double spread,
                      const DarkRows& dark) {
  const auto part = signal.last(steady);
  const double level = quantile(part, part.size() / 2);
  const double uneven = std::hypot(spread, dark.texture * level);
  if (unsteadiness(part) > std::max(kNextToNone * span, kNoiseKept * std::min(uneven, 0.5 * dark.most_noise * span)))
    return 0;
  const double departure =
      std::max(kNoiseErrors * std::min(uneven, dark.most_noise * span), dark.least_departure * span);
  // A row is lit if the next one is on the same side by half as much: noise departs in single rows.
  const auto off = [&](std::size_t from_end) { return signal[signal.size() - 1 - from_end] - level; };
  const auto is_lit = [&](std::size_t from_end) {
    if (!(std::abs(off(from_end)) > departure)) return false;
    return from_end + 1 < signal.size() && std::copysign(1.0, off(from_end)) * off(from_end + 1) > 0.5 * departure;
  };
  std::size_t count = 0;
  while (count < signal.size() && !is_lit(count)) ++count;
  return count;
}

}  // namespace

LitRows lit_rows(std::span<const double> signal, double noise, const RowRange& seen, const DarkRows& dark) {
  LitRows lit{seen, 0};
  if (signal.size() < 2) return lit;
  const std::size_t tail = signal.size() / 50;
  const double span = quantile(signal, signal.size() - 1 - tail) - quantile(signal, tail);
  const double spread = std::isfinite(noise) ? std::min(noise, dark.most_noise * span) : 0.0;
  const auto points = turning_points(signal, std::max(kTurnErrors * spread, kMinTurn * span));
  if (points.size() < kMinTurns + 2) return lit;
  // The first point is row 0; the second and the last one lie anywhere in steady rows.
  std::vector<std::size_t> runs;
  for (std::size_t k = 3; k + 1 < points.size(); ++k) runs.push_back(points[k] - points[k - 1]);
  std::ranges::sort(runs);
  lit.shortest = runs[runs.size() / 4];  // noise moves single turning points
  const auto longest = static_cast<double>(runs.back());
  const auto second = static_cast<double>(runs[runs.size() - 2]);
  const double many = std::max(kDarkRuns * second, kDarkChips * static_cast<double>(lit.shortest));
  // Runs of chips have geometric lengths; one dark ring of a lamp is longer. Chips like the one before, by the rule of
  // succession
  const double chips = std::accumulate(runs.begin(), runs.end(), 0.0) / static_cast<double>(lit.shortest);
  const double alike =
      1 - (static_cast<double>(runs.size()) + 1) / (std::max(chips, static_cast<double>(runs.size())) + 2);
  const double rare = static_cast<double>(lit.shortest) * std::log(kNextToNone) / std::log(alike);
  const auto enough = [&](bool expected, std::size_t known) {
    if (known > 0) return kMostly * static_cast<double>(known);
    const double more = kMinDarkRuns * longest;
    if (dark.expected) return std::min(more, std::max(rare, longest));
    return expected ? more : std::max(more, many);
  };
  const std::size_t after = signal.size() - 1 - points[points.size() - 2], before = points[2];
  RowRange rows{0, signal.size()};
  if (static_cast<double>(after) > enough(seen.end < signal.size(), dark.after))
    rows.end -= dark_rows(signal, after / 2, span, spread, dark);
  if (static_cast<double>(before) > enough(seen.begin > 0, dark.before)) {
    const std::vector<double> reversed(signal.rbegin(), signal.rend());
    rows.begin += dark_rows(reversed, before / 2, span, spread, dark);
  }
  if (rows.begin == 0) rows.begin = seen.begin;
  if (rows.end == signal.size()) rows.end = seen.end;
  if (rows.begin < rows.end) lit.rows = rows;
  return lit;
}

}  // namespace ocisac
