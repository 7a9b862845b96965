// Displaced rows: the smoother against the dense solution, and rows displaced there and back.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "ocisac/chips/row_warp.hpp"

namespace {

constexpr std::size_t kRows = 60;

using Matrix = std::vector<std::vector<double>>;

// Solution of a symmetric positive definite system, by elimination.
std::vector<double> solve(Matrix a, std::vector<double> b) {
  const std::size_t size = b.size();
  for (std::size_t k = 0; k < size; ++k)
    for (std::size_t row = k + 1; row < size; ++row) {
      const double share = a[row][k] / a[k][k];
      for (std::size_t column = k; column < size; ++column) a[row][column] -= share * a[k][column];
      b[row] -= share * b[k];
    }
  for (std::size_t k = size; k-- > 0;) {
    for (std::size_t column = k + 1; column < size; ++column) b[k] -= a[k][column] * b[column];
    b[k] /= a[k][k];
  }
  return b;
}

// Covariance of rows i and j before the rows are seen: a step of the rate after row k moves row n by n − 1 − k.
double prior(std::size_t i, std::size_t j) {
  const auto a = static_cast<double>(i), b = static_cast<double>(j);
  double sum = std::pow(ocisac::kWarpStd, 2) + a * b * std::pow(ocisac::kWarpRateStd, 2);
  for (double k = 0; k + 1 < std::min(a, b); ++k) sum += (a - 1 - k) * (b - 1 - k) * std::pow(ocisac::kWarpStep, 2);
  return sum;
}

}  // namespace

TEST_CASE("the smoother of a displacement equals the dense solution") {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::vector<double> observed(kRows), slopes(kRows), noise(kRows);
  for (std::size_t n = 0; n < kRows; ++n) {
    observed[n] = normal(random);
    slopes[n] = normal(random);
    noise[n] = 0.1 + std::abs(normal(random));
  }
  Matrix seen(kRows, std::vector<double>(kRows));  // covariance of the observations
  for (std::size_t i = 0; i < kRows; ++i)
    for (std::size_t j = 0; j < kRows; ++j)
      seen[i][j] = slopes[i] * prior(i, j) * slopes[j] + (i == j ? noise[i] * noise[i] : 0.0);
  const auto weights = solve(seen, observed);
  const auto got = ocisac::smooth_displacement(observed, slopes, noise);
  for (std::size_t n = 0; n < kRows; ++n) {
    double want = 0;
    for (std::size_t j = 0; j < kRows; ++j) want += prior(n, j) * slopes[j] * weights[j];
    CHECK(std::abs(got[n] - want) < 1e-8);
  }
}

TEST_CASE("displaced rows come back, and rows without a warp stay") {
  std::vector<double> even(400);
  ocisac::RowWarp warp(even.size());
  for (std::size_t n = 0; n < even.size(); ++n) {
    const double turn = 2 * std::numbers::pi * static_cast<double>(n);
    even[n] = std::sin(turn / 40);
    warp[n] = 2 * std::sin(turn / 300);
  }
  CHECK(ocisac::unwarped(even, {}) == even);
  CHECK(ocisac::warped(even, {}) == even);
  const auto back = ocisac::unwarped(ocisac::warped(even, warp), warp);
  for (std::size_t n = 4; n + 4 < even.size(); ++n) CHECK(std::abs(back[n] - even[n]) < 3e-3);
}
