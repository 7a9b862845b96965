#include "receiver/rows_of_noise.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/statistics.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr double kSlowTerms = 4;    // cosines along the frame
constexpr double kRounding = 1e-9;  // relative to the mean: rows that deviate by no more are constant

}  // namespace

bool is_noise(std::span<const double> signal) {
  const auto fit = remove_nuisance(signal, {0.5 * kSlowTerms / static_cast<double>(signal.size()), {}});
  if (!fit) return false;
  std::vector<double> rest = fit->rest;
  const double mean = mean_of(rest);
  for (double& value : rest) value -= mean;
  const auto varies = [&](double value) { return std::abs(value) > kRounding * std::abs(mean); };
  return std::ranges::none_of(rest, varies) || is_white(rest);
}

}  // namespace ocisac
