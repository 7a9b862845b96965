// Dense linear algebra by Eigen, compiled once: its products and decompositions cost seconds of compile time in every
// source that instantiates them. Sources that use these functions include no more of Eigen than its Core.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

namespace ocisac {

using ConstMatrix = Eigen::Ref<const Eigen::MatrixXd, 0, Eigen::OuterStride<>>;

// Values as vectors of Eigen, and back.
inline std::span<const double> span_of(const Eigen::MatrixXd& matrix) {
  return {matrix.data(), static_cast<std::size_t>(matrix.size())};
}

inline Eigen::Map<const Eigen::VectorXd> vector_of(std::span<const double> values) {
  return {values.data(), static_cast<Eigen::Index>(values.size())};
}

inline std::vector<double> values_of(const Eigen::MatrixXd& matrix) {
  return {matrix.data(), matrix.data() + matrix.size()};
}

Eigen::MatrixXd product(const ConstMatrix& a, const ConstMatrix& b);             // a·b
Eigen::MatrixXd transposed_product(const ConstMatrix& a, const ConstMatrix& b);  // aᵀ·b
Eigen::MatrixXd gram(const ConstMatrix& a);                                      // a·aᵀ
Eigen::MatrixXd inverse(const ConstMatrix& matrix);                              // (n × n)

// QR factors of A (rows × columns): column order[j] of A is column j of basis·triangle.
struct OrthogonalFactors {
  Eigen::MatrixXd basis;     // (rows × rank), orthonormal
  Eigen::MatrixXd triangle;  // (rank × columns), upper
  std::vector<Eigen::Index> order;

  [[nodiscard]] Eigen::Index rank() const { return basis.cols(); }
};

OrthogonalFactors orthogonal_factors(const ConstMatrix& matrix);  // in order; rows ≥ columns, which are independent
OrthogonalFactors pivoted_orthogonal_factors(const ConstMatrix& matrix);  // by descending norm, finds the rank

// Eigenvalues, ascending, and eigenvectors (columns) of a symmetric matrix (n × n).
struct EigenFactors {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
EigenFactors symmetric_factors(const ConstMatrix& matrix);

// x with triangle·x = right and with triangleᵀ·x = right, for an upper triangle (n × n).
Eigen::MatrixXd solve_upper(const ConstMatrix& triangle, const ConstMatrix& right);
Eigen::MatrixXd solve_upper_transposed(const ConstMatrix& triangle, const ConstMatrix& right);

// x that minimises |matrix·x − right| for a matrix (rows × columns), by QR with column pivoting. x is 0 for columns
// whose pivot is at most min_pivot times the largest.
Eigen::MatrixXd least_squares(const ConstMatrix& matrix, const ConstMatrix& right, double min_pivot = 0);

// x with matrix·x = right for a positive definite matrix (n × n), by LLᵀ.
Eigen::MatrixXd solve_positive_definite(const ConstMatrix& matrix, const ConstMatrix& right);

// The upper triangle R of matrix = Rᵀ·R (n × n); empty unless every diagonal element of R exceeds min_pivot times the
// largest.
std::optional<Eigen::MatrixXd> cholesky_factor(const ConstMatrix& matrix, double min_pivot);

// x with matrix·x = right for a symmetric matrix (n × n), by LDLᵀ; empty unless all pivots exceed min_pivot.
std::optional<Eigen::MatrixXd> solve_symmetric(const ConstMatrix& matrix, const ConstMatrix& right, double min_pivot);

}  // namespace ocisac
