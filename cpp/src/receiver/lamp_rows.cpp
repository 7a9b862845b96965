#include "receiver/lamp_rows.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <variant>

#include "chips/edges.hpp"
#include "chips/lit_rows.hpp"
#include "ocisac/core/constants.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

constexpr double kMinTurn = 0.05;     // of the span of the signal
constexpr std::size_t kMinEdges = 6;  // of a lamp
constexpr double kLitShare = 0.25;    // of the brightest pixel: an isophote of a round lamp is round, too
constexpr std::size_t kMinWidths = 6;
constexpr double kMaxError = 0.03;  // of the largest width
constexpr double kFurthest = 0.25;  // of the measured rows, beyond them

// The smallest and the largest value.
template <class Values>
std::pair<double, double> span_of(const Values& values) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return {*low, *high};
}

// Columns brighter than `lit` from `begin` to `end`, and those beside them that follow without a gap: columns of a lamp
// that are too faint in all rows together have no weight.
std::ptrdiff_t lit_columns(std::span<const double> row, double lit, std::size_t begin, std::size_t end) {
  while (begin > 0 && row[begin] > lit) --begin;
  while (end < row.size() && row[end - 1] > lit) ++end;
  const auto lamp = row.subspan(begin, end - begin);
  return std::count_if(lamp.begin(), lamp.end(), [&](double value) { return value > lit; });
}

// Length from which on a dark run is a gap: the sorted dark runs leap there, and no bright run is nearly as long.
// Infinite without a leap. `runs`: between edges, the first one bright if `bright_first`.
double gap_length(std::span<const double> runs, bool bright_first) {
  std::array<std::vector<double>, 2> kinds;  // dark, bright
  for (std::size_t k = 0; k < runs.size(); ++k) kinds[(k % 2 == 0) == bright_first ? 1 : 0].push_back(runs[k]);
  auto& [dark, bright] = kinds;
  if (dark.empty() || bright.empty()) return kInfinity;
  std::ranges::sort(dark);
  const double least = std::max(kDarkRuns * *std::ranges::max_element(bright), kDarkChips * dark[dark.size() / 4]);
  for (std::size_t k = dark.size() / 2; k + 1 < dark.size(); ++k)
    if (dark[k + 1] > std::max(kDarkRuns * dark[k], least)) return dark[k + 1];
  return kInfinity;
}

}  // namespace

std::vector<RowRange> rows_of_lamps(std::span<const double> signal, double noise) {
  std::vector<RowRange> lamps{{0, signal.size()}};
  if (signal.size() < 2 || !std::isfinite(noise)) return lamps;
  const auto [darkest, brightest] = span_of(signal);
  const auto points = turning_points(signal, std::max(kTurnErrors * noise, kMinTurn * (brightest - darkest)));
  const Edges edges = edges_between(signal, points, 0.5);
  if (edges.rows.size() < 2 * kMinEdges) return lamps;
  std::vector<double> runs;
  for (std::size_t k = 1; k < edges.rows.size(); ++k) runs.push_back(edges.rows[k] - edges.rows[k - 1]);
  const double gap = gap_length(runs, edges.rising[0] != 0);
  std::size_t first = 0;
  for (std::size_t k = 1; k < edges.rows.size(); ++k) {
    if (runs[k - 1] < gap || !edges.rising[k] || k - first < kMinEdges || edges.rows.size() - k < kMinEdges) continue;
    const auto middle = static_cast<std::size_t>(0.5 * (edges.rows[k] + edges.rows[k - 1]));
    lamps.back().end = middle;
    lamps.push_back({middle, signal.size()});
    first = k;
  }
  return lamps;
}

double Outline::width(double row) const {
  return widest * std::sqrt(std::max(1 - std::pow((row - middle) / half, 2), 0.0));
}

std::optional<Outline> outline_of(const AnyFramesView& frames, std::size_t frame, std::span<const double> weights,
                                  std::span<const std::size_t> bright_rows) {
  if (bright_rows.size() < kMinWidths) return std::nullopt;
  std::size_t begin = 0, end = weights.size();
  while (begin < end && !(weights[begin] > 0)) ++begin;
  while (end > begin && !(weights[end - 1] > 0)) --end;
  if (begin == end) return std::nullopt;
  const auto columns = std::visit(
      [&](const auto& view) {
        std::vector<std::vector<double>> rows;
        for (const std::size_t row : bright_rows) {
          rows.emplace_back();
          for (std::size_t k = 0; k < weights.size(); ++k)
            rows.back().push_back(static_cast<double>(view(frame, row, k)));
        }
        return rows;
      },
      frames);
  double darkest = kInfinity, brightest = 0;
  for (const auto& row : columns) {
    const auto [low, high] = span_of(std::span(row).subspan(begin, end - begin));
    darkest = std::min(darkest, low);
    brightest = std::max(brightest, high);
  }
  const double lit = darkest + kLitShare * (brightest - darkest);
  // width² = a + b·row + c·row², rows from the middle of the measured ones, in their half lengths
  const auto first = static_cast<double>(bright_rows.front()), last = static_cast<double>(bright_rows.back());
  const double middle = 0.5 * (first + last), half = 0.5 * (last - first);
  Eigen::MatrixXd terms(static_cast<Eigen::Index>(columns.size()), 3);
  Eigen::VectorXd squares(terms.rows());
  for (Eigen::Index k = 0; k < terms.rows(); ++k) {
    const auto at = static_cast<std::size_t>(k);
    const double along = (static_cast<double>(bright_rows[at]) - middle) / half;
    terms.row(k) << 1, along, along * along;
    squares[k] = std::pow(lit_columns(columns[at], lit, begin, end), 2);
  }
  const auto solved = solve_normal(terms.transpose() * terms, terms.transpose() * squares);
  if (!solved) return std::nullopt;
  const Eigen::VectorXd& fit = solved->values;
  const double widest = squares.maxCoeff(), square = fit[1] * fit[1] - 4 * fit[2] * fit[0];
  const Eigen::ArrayXd errors = (terms * fit).cwiseMax(0).array().sqrt() - squares.array().sqrt();
  const double rounded = 1.0 / 3;  // variance of a width that both ends round alike
  if (fit[2] >= 0 || square <= 0 || errors.square().mean() > kMaxError * kMaxError * widest + rounded)
    return std::nullopt;
  const double centre = -0.5 * fit[1] / fit[2], reach = 0.5 * std::sqrt(square) / std::abs(fit[2]);
  const double furthest = 1 + 2 * kFurthest;
  if (centre - reach < -furthest || centre + reach > furthest) return std::nullopt;
  const double highest = fit[0] - 0.25 * fit[1] * fit[1] / fit[2];
  return Outline{middle + half * centre, half * reach, std::sqrt(highest)};
}

}  // namespace ocisac
