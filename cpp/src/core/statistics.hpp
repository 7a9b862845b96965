// Sums that tell how numbers vary.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <numeric>
#include <span>
#include <vector>

namespace ocisac {

inline double mean_of(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

inline std::vector<double> without_mean(std::span<const double> values) {
  const double mean = mean_of(values);
  std::vector<double> rest(values.begin(), values.end());
  for (double& value : rest) value -= mean;
  return rest;
}

inline double squares_about_mean(std::span<const double> values) {
  const double mean = mean_of(values);
  double squares = 0;
  for (const double value : values) squares += (value - mean) * (value - mean);
  return squares;
}

inline double variance_of(std::span<const double> values) {
  return squares_about_mean(values) / static_cast<double>(values.size());
}

inline double scalar_product(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

// Correlation of two signals of mean 0; 0 where one does not vary.
inline double likeness(std::span<const double> a, std::span<const double> b) {
  const double energy = scalar_product(a, a) * scalar_product(b, b);
  return energy > 0 ? scalar_product(a, b) / std::sqrt(energy) : 0;
}

// a − b.
inline std::vector<double> difference(std::span<const double> a, std::span<const double> b) {
  std::vector<double> result(a.begin(), a.end());
  for (std::size_t n = 0; n < result.size(); ++n) result[n] -= b[n];
  return result;
}

// Leaves the residual of the least-squares straight line.
inline void remove_line(std::span<double> values) {
  const double mean = mean_of(values), middle = 0.5 * (static_cast<double>(values.size()) - 1);
  const auto along = [&](std::size_t n) { return static_cast<double>(n) - middle; };
  double product = 0, square = 0;
  for (std::size_t n = 0; n < values.size(); ++n) {
    product += along(n) * values[n];
    square += along(n) * along(n);
  }
  const double slope = product / std::max(square, 1.0);
  for (std::size_t n = 0; n < values.size(); ++n) values[n] -= mean + slope * along(n);
}

// Probability that noise exceeds some of its standard deviations.
inline double normal_tail(double deviations) { return 0.5 * std::erfc(deviations / std::numbers::sqrt2); }

// Σ x(n − lag)·x(n).
inline double product_at_lag(std::span<const double> values, std::size_t lag) {
  double sum = 0;
  for (std::size_t n = lag; n < values.size(); ++n) sum += values[n - lag] * values[n];
  return sum;
}

}  // namespace ocisac
