#include "columns/continuation.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "core/linear_algebra.hpp"

namespace ocisac {

namespace {

using Eigen::Index;

constexpr double kSmoothShare = 100;
constexpr double kNoiseShare = 0.001;
constexpr double kLongestReach = 1024;  // rows; bounds the run time for very long exposures
constexpr double kLeftOut = 1e-16;      // of the smooth component's variance

double exposed_together(double rows_apart, double exposure_rows) {
  return std::max(0.0, 1 - rows_apart / std::max(exposure_rows, 1.0));
}

template <class T>
T smooth_covariance(T rows_apart, T exposure_rows) {
  const T reach = rows_apart / (2 * exposure_rows + 16);
  return T{kSmoothShare} / (1 + reach * reach);
}

// Rounding errors of double are larger than what is left out, and each would be one more term.
using Precise = Eigen::Vector<long double, Eigen::Dynamic>;

// value(i, j) ≈ left·right, by adaptive cross approximation: each term takes the largest value of a row exactly.
struct Cross {
  std::vector<Precise> left, right;
};

template <class Value>
Cross cross_approximation(Index rows, Index columns, long double left_out, Value value) {
  Cross cross;
  std::vector<bool> taken(static_cast<std::size_t>(rows), false);
  for (Index row = 0; cross.left.size() < static_cast<std::size_t>(rows);) {
    taken[static_cast<std::size_t>(row)] = true;
    Precise along = Precise::NullaryExpr(columns, [&](Index j) { return value(row, j); });
    for (std::size_t k = 0; k < cross.left.size(); ++k) along -= cross.left[k](row) * cross.right[k];
    Index pivot = 0;
    if (!(along.cwiseAbs().maxCoeff(&pivot) > left_out)) break;
    Precise across = Precise::NullaryExpr(rows, [&](Index i) { return value(i, pivot); });
    for (std::size_t k = 0; k < cross.left.size(); ++k) across -= cross.right[k](pivot) * cross.left[k];
    cross.right.push_back(along / along(pivot));
    cross.left.push_back(across);
    long double largest = -1;
    for (Index i = 0; i < rows; ++i)
      if (!taken[static_cast<std::size_t>(i)] && std::abs(across(i)) > largest) largest = std::abs(across(row = i));
    if (largest <= left_out) break;
  }
  return cross;
}

}  // namespace

Continuation continuation(std::size_t rows, double exposure_rows) {
  const auto reach = [&](double beyond) {
    return static_cast<Index>(
        std::min({std::ceil(4 * exposure_rows) + beyond, kLongestReach, static_cast<double>(rows)}));
  };
  const Index used = reach(16), predicted = reach(32);
  const auto shared = [&](Index distance) { return exposed_together(static_cast<double>(distance), exposure_rows); };
  const auto smooth = [&](Index distance) { return smooth_covariance(static_cast<double>(distance), exposure_rows); };
  Index near = 0;
  while (near < predicted && shared(near + 1) > 0) ++near;
  const Cross ahead = cross_approximation(predicted, used, kLeftOut * kSmoothShare, [&](Index i, Index j) {
    return smooth_covariance<long double>(static_cast<long double>(i + j + 1), exposure_rows);
  });
  const auto terms = static_cast<Index>(ahead.left.size());

  const Eigen::MatrixXd seen = Eigen::MatrixXd::NullaryExpr(used, used, [&](Index i, Index j) {
    const Index distance = std::abs(i - j);
    return shared(distance) + smooth(distance) + (i == j ? kNoiseShare * std::max(exposure_rows, 1.0) : 0);
  });
  Eigen::MatrixXd of_terms(used, near + terms);
  of_terms.leftCols(near) =
      Eigen::MatrixXd::NullaryExpr(used, near, [&](Index j, Index i) { return shared(i + j + 1); });
  for (Index k = 0; k < terms; ++k) of_terms.col(near + k) = ahead.right[static_cast<std::size_t>(k)].cast<double>();

  Continuation result{static_cast<std::size_t>(used), static_cast<std::size_t>(predicted),
                      static_cast<std::size_t>(near), solve_positive_definite(seen, of_terms).transpose(),
                      Continuation::Matrix(predicted, terms)};
  for (Index i = 0; i < predicted; ++i) {
    const double fade =
        0.5 + 0.5 * std::cos(std::numbers::pi * static_cast<double>(i + 1) / static_cast<double>(predicted + 1));
    if (i < near) result.terms.row(i) *= fade;
    for (Index k = 0; k < terms; ++k)
      result.smooth(i, k) = fade * static_cast<double>(ahead.left[static_cast<std::size_t>(k)](i));
  }
  return result;
}

}  // namespace ocisac
