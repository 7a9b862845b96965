#include "columns/streaks.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/levels.hpp"
#include "ocisac/core/constants.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kFarOff = 5;         // standard deviations
constexpr double kUsualShare = 0.75;  // of the squares, as the usual values say: 1 of normal noise
constexpr Index kParts = 8;           // of the rows

// A column as c + l·signal by least squares over the values that count.
VectorXd fitted_by(const VectorXd& column, const VectorXd& signal, const VectorXd& counts) {
  const double all = counts.sum();
  const double mean = counts.dot(signal) / all, level = counts.dot(column) / all;
  const VectorXd off = signal.array() - mean;
  const double squares = counts.dot(off.cwiseAbs2());
  const double loading = squares > 0 ? counts.cwiseProduct(off).dot(column) / squares : 0.0;
  return level + (loading * off).array();
}

double usual_deviation(const VectorXd& left) {
  const VectorXd magnitudes = left.cwiseAbs();
  return median({magnitudes.begin(), magnitudes.end()}) / kMedianMagnitude;
}

// Beside rows without the lamp its own rows would be far off what is usual.
bool is_lit_throughout(const VectorXd& signal) {
  const Index rows = signal.size() / kParts;
  double least = std::numeric_limits<double>::infinity(), largest = 0;
  for (Index part = 0; part < kParts; ++part) {
    const auto of_part = signal.segment(part * rows, rows);
    const double span = of_part.maxCoeff() - of_part.minCoeff();
    least = std::min(least, span);
    largest = std::max(largest, span);
  }
  return least >= kSmallShare * largest;
}

}  // namespace

bool has_streaks(const ColumnLight& columns, const VectorXd& weights, Index every) {
  const Index rows = columns.rows() / every;
  if (rows < every) return false;  // too few to tell
  const ColumnLight few = Eigen::Map<const ColumnLight, 0, Eigen::OuterStride<>>(
      columns.data(), rows, columns.cols(), Eigen::OuterStride<>(every * columns.cols()));
  const VectorXd signal = few * weights, counts = VectorXd::Ones(rows);
  if (!is_lit_throughout(signal)) return false;
  double usual = 0, squares = 0;
  for (Index k = 0; k < weights.size(); ++k) {
    if (!(weights(k) > 0)) continue;
    const VectorXd left = few.col(k) - fitted_by(few.col(k), signal, counts);
    usual += std::pow(weights(k) * usual_deviation(left), 2);
    squares += std::pow(weights(k), 2) * left.squaredNorm() / static_cast<double>(rows);
  }
  return usual < kUsualShare * squares;
}

VectorXd without_streaks(const ColumnLight& columns, const VectorXd& weights) {
  ColumnLight now = columns;
  VectorXd signal = now * weights;
  ColumnLight counts = ColumnLight::Ones(columns.rows(), columns.cols());
  for (int round = 0; round < kMaxIterations; ++round) {
    for (Index k = 0; k < weights.size(); ++k) {
      if (!(weights(k) > 0)) continue;
      const VectorXd fitted = fitted_by(columns.col(k), signal, counts.col(k)), left = columns.col(k) - fitted;
      counts.col(k) = (left.array().abs() <= kFarOff * usual_deviation(left)).cast<double>();
      now.col(k) = (counts.col(k).array() > 0).select(columns.col(k), fitted);
    }
    signal = now * weights;
  }
  return signal;
}

}  // namespace ocisac
