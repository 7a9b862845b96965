// Least squares and products of matrices that are not Eigen's: dense, row by row.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

// a (rows × n) times b (n × columns).
std::vector<double> dense_product(std::span<const double> a, std::size_t rows, std::span<const double> b,
                                  std::size_t columns);

// Least squares of a design (rows × parameters), by QR. `weights`: (parameters × rows), its pseudo-inverse;
// `covariance`: (parameters × parameters), for noise of variance 1 in every row. Returns the condition, infinite where
// parameters depend on each other.
double dense_fit(std::span<const double> design, std::size_t rows, std::vector<double>& weights,
                 std::vector<double>& covariance);

}  // namespace ocisac
