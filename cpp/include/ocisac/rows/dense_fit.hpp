// Least squares and products of matrices that are not Eigen's: dense, row by row.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

// a (rows × n) times b (n × columns).
std::vector<double> dense_product(std::span<const double> a, std::size_t rows, std::span<const double> b,
                                  std::size_t columns);

// Least squares of a design (rows × parameters), by QR.
struct DenseFit {
  std::vector<double> weights;     // (parameters × rows), its pseudo-inverse
  std::vector<double> covariance;  // (parameters × parameters), for noise of variance 1 in every row
  double condition;                // infinite where parameters depend on each other
};
DenseFit dense_fit(std::span<const double> design, std::size_t rows);

}  // namespace ocisac
