#include "core/linear_algebra.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <numeric>

namespace ocisac {

using Eigen::Index;
using Eigen::MatrixXd;

MatrixXd product(const ConstMatrix& a, const ConstMatrix& b) { return a * b; }

MatrixXd transposed_product(const ConstMatrix& a, const ConstMatrix& b) { return a.transpose() * b; }

MatrixXd gram(const ConstMatrix& a) {
  MatrixXd result = MatrixXd::Zero(a.rows(), a.rows());
  result.selfadjointView<Eigen::Lower>().rankUpdate(a);
  result.triangularView<Eigen::StrictlyUpper>() = result.transpose();
  return result;
}

MatrixXd inverse(const ConstMatrix& matrix) {
  return least_squares(matrix, MatrixXd::Identity(matrix.rows(), matrix.cols()));
}

OrthogonalFactors orthogonal_factors(const ConstMatrix& matrix) {
  const Eigen::HouseholderQR<MatrixXd> qr(matrix);
  OrthogonalFactors factors{qr.householderQ() * MatrixXd::Identity(matrix.rows(), matrix.cols()),
                            qr.matrixQR().topRows(matrix.cols()).triangularView<Eigen::Upper>(),
                            std::vector<Index>(static_cast<std::size_t>(matrix.cols()))};
  std::iota(factors.order.begin(), factors.order.end(), Index{0});
  return factors;
}

OrthogonalFactors pivoted_orthogonal_factors(const ConstMatrix& matrix) {
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(matrix);
  const auto& order = qr.colsPermutation().indices();
  return {qr.householderQ() * MatrixXd::Identity(matrix.rows(), qr.rank()),
          qr.matrixR().topRows(qr.rank()).triangularView<Eigen::Upper>(),
          {order.begin(), order.end()}};
}

EigenFactors symmetric_factors(const ConstMatrix& matrix) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(matrix);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

MatrixXd solve_upper(const ConstMatrix& triangle, const ConstMatrix& right) {
  return triangle.triangularView<Eigen::Upper>().solve(right);
}

MatrixXd solve_upper_transposed(const ConstMatrix& triangle, const ConstMatrix& right) {
  return triangle.triangularView<Eigen::Upper>().transpose().solve(right);
}

MatrixXd least_squares(const ConstMatrix& matrix, const ConstMatrix& right, double min_pivot) {
  Eigen::ColPivHouseholderQR<MatrixXd> qr(matrix);
  if (min_pivot > 0) qr.setThreshold(min_pivot);
  const Index rank = qr.rank();
  const MatrixXd turned = qr.householderQ().adjoint() * right;
  MatrixXd solved = MatrixXd::Zero(matrix.cols(), right.cols());
  solved.topRows(rank) =
      qr.matrixR().topLeftCorner(rank, rank).triangularView<Eigen::Upper>().solve(turned.topRows(rank));
  return qr.colsPermutation() * solved;
}

MatrixXd solve_positive_definite(const ConstMatrix& matrix, const ConstMatrix& right) {
  return matrix.llt().solve(right);
}

std::optional<MatrixXd> cholesky_factor(const ConstMatrix& matrix, double min_pivot) {
  const Eigen::LLT<MatrixXd> factors(matrix);
  MatrixXd upper = factors.matrixU();
  if (factors.info() != Eigen::Success || !(upper.diagonal().minCoeff() > min_pivot * upper.diagonal().maxCoeff()))
    return std::nullopt;
  return upper;
}

std::optional<MatrixXd> solve_symmetric(const ConstMatrix& matrix, const ConstMatrix& right, double min_pivot) {
  const Eigen::LDLT<MatrixXd> factors(matrix);
  if (!(factors.vectorD().minCoeff() > min_pivot)) return std::nullopt;
  return factors.solve(right);
}

}  // namespace ocisac
