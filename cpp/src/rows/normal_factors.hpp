// Normal equations of a few unknowns, the first of which are also solved without the others.
#pragma once

#include <array>
#include <cstddef>
#include <span>

namespace ocisac {

// Inner products of columns; the others explain column 0.
class NormalProducts {
 public:
  static constexpr std::size_t kMost = 17;  // unknowns: a clock, and levels of the highest degree
  static constexpr std::size_t kStride = kMost + 1;

  [[nodiscard]] double* data() { return values_.data(); }
  [[nodiscard]] double squares() const { return values_[0]; }
  // Element (i, j) of the normal matrix, and element i of its right-hand side.
  [[nodiscard]] double& normal(std::size_t i, std::size_t j) { return values_[(i + 1) * kStride + j + 1]; }
  [[nodiscard]] double normal(std::size_t i, std::size_t j) const { return values_[(i + 1) * kStride + j + 1]; }
  [[nodiscard]] double& right(std::size_t i) { return values_[(i + 1) * kStride]; }
  [[nodiscard]] double right(std::size_t i) const { return values_[(i + 1) * kStride]; }

 private:
  std::array<double, kStride * kStride> values_;
};

inline constexpr double kMinPivot = 1e-11;  // of normal equations scaled to a unit diagonal

using LastInverse = std::array<std::array<double, 3>, 3>;

// Cholesky factors of products scaled to a unit diagonal, in the order of the unknowns.
class NormalFactors {
 public:
  NormalFactors(const NormalProducts& products, std::size_t size);

  // Number of unknowns before the first whose column depends on those before it, or is not finite.
  [[nodiscard]] std::size_t solvable() const { return solvable_; }

  // Part of column 0's norm that unknown i explains beyond those before it.
  [[nodiscard]] double explained(std::size_t i) const { return explained_[i]; }

  // Solution for the first values.size() unknowns alone, at most solvable().
  void solve(std::span<double> values) const;

  // Inverse of the normal matrix of the solvable unknowns, at those from `first` on, at most three; else 0.
  [[nodiscard]] LastInverse inverse_from(std::size_t first) const;

 private:
  using Row = std::array<double, NormalProducts::kMost>;
  std::size_t solvable_ = 0;
  Row scale_;                                      // of each unknown
  std::array<Row, NormalProducts::kMost> factor_;  // lower; its diagonal inverted
  Row explained_;                                  // factor⁻¹·right
};

}  // namespace ocisac
