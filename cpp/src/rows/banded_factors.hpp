// Cholesky factors of positive definite matrices with few diagonals, as of rows that see their neighbours alone.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

// The factors have `band` diagonals beside the main one, as the matrix.
class BandedFactors {
 public:
  BandedFactors(std::size_t size, std::size_t band) : size_(size), band_(band), values_(size * (band + 1), 0.0) {}

  // Element (row, row − back): of the matrix A, and after factor() of L, with A = LLᵀ.
  [[nodiscard]] double& at(std::size_t row, std::size_t back) { return values_[row * (band_ + 1) + back]; }
  [[nodiscard]] double at(std::size_t row, std::size_t back) const { return values_[row * (band_ + 1) + back]; }
  void factor();
  // x becomes L⁻¹x, its first element being that of row `first`, before which it is 0.
  void forward(std::span<double> x, std::size_t first = 0) const;
  void backward(std::span<double> x) const;  // (size) L⁻ᵀx

 private:
  std::size_t size_, band_;
  std::vector<double> values_;
};

}  // namespace ocisac
