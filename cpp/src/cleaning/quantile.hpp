// Quantiles, interpolated linearly between the sorted values.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

inline double quantile(std::span<const double> values, double share) {
  std::vector<double> sorted(values.begin(), values.end());
  const double place = share * static_cast<double>(sorted.size() - 1);
  const auto before = static_cast<std::size_t>(place);
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(before);
  std::nth_element(sorted.begin(), middle, sorted.end());
  if (before + 1 >= sorted.size()) return *middle;
  const double after = *std::min_element(middle + 1, sorted.end());
  return *middle + (place - static_cast<double>(before)) * (after - *middle);
}

constexpr double kBrightRows = 0.95;  // quantile: a fully lit row, or column

// Light above which a row is an outlier.
inline double most_of_rows(std::span<const double> rows) { return 1.5 * quantile(rows, kBrightRows); }

}  // namespace ocisac
