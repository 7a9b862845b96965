#include "ocisac/rows/dense_fit.hpp"

#include <Eigen/Core>

#include "core/linear_algebra.hpp"
#include "ocisac/core/require.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// Row by row a matrix is its transpose column by column.
Eigen::Map<const MatrixXd> transposed(std::span<const double> values, std::size_t rows) {
  require(rows > 0 && values.size() % rows == 0, "rows", rows, "a divisor of the number of values");
  return {values.data(), static_cast<Index>(values.size() / rows), static_cast<Index>(rows)};
}

}  // namespace

std::vector<double> dense_product(std::span<const double> a, std::size_t rows, std::span<const double> b,
                                  std::size_t columns) {
  const auto left = transposed(a, rows);
  require(columns > 0 && b.size() == static_cast<std::size_t>(left.rows()) * columns, "b", b.size(),
          "as many rows as a has columns");
  return values_of(product(transposed(b, b.size() / columns), left));
}

double dense_fit(std::span<const double> design, std::size_t rows, std::vector<double>& weights,
                 std::vector<double>& covariance) {
  const MatrixXd columns = transposed(design, rows).transpose();
  const LinearFit fit = linear_fit(columns, columns.cols());
  weights = values_of(fit.weights);
  covariance = values_of(fit.covariance);
  return fit.condition;
}

}  // namespace ocisac
