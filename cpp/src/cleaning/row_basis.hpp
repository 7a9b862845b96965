// Courses of rows as linear combinations of terms.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <span>
#include <vector>

#include "core/linear_algebra.hpp"

namespace ocisac {

// (rows × terms).
using Basis = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

inline std::span<const double> span_of(const Basis& basis) {
  return {basis.data(), static_cast<std::size_t>(basis.size())};
}

inline Eigen::Map<const Eigen::VectorXd> vector_of(std::span<const double> values) {
  return {values.data(), static_cast<Eigen::Index>(values.size())};
}

inline std::vector<double> values_of(const Eigen::VectorXd& vector) {
  return {vector.data(), vector.data() + vector.size()};
}

// The terms whose combination is nearest to the values.
inline Eigen::VectorXd fitted_terms(const Basis& basis, const Eigen::VectorXd& values) {
  const double min_pivot = std::numeric_limits<double>::epsilon() * static_cast<double>(basis.rows());
  return least_squares(Eigen::MatrixXd(basis), values, min_pivot);
}

}  // namespace ocisac
