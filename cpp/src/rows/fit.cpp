#include "rows/fit.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "core/levels.hpp"
#include "ocisac/core/constants.hpp"
#include "rows/normal_factors.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kReach = 0.25;    // bins of the rows: the longest step of a frequency
constexpr double kSettled = 1e-3;  // bins; a smaller step is the last

MatrixXd waves_of(const RowSampling& rows, std::span<const double> frequencies) {
  std::vector<double> basis;
  append_tones(basis, rows, frequencies);
  return matrix_of(basis, rows);
}

}  // namespace

Eigen::Map<const MatrixXd> matrix_of(const std::vector<double>& basis, const RowSampling& rows) {
  const auto height = static_cast<Index>(rows.times.size());
  return {basis.data(), height, static_cast<Index>(basis.size()) / height};
}

MatrixXd tone_design(const RowSampling& rows, std::span<const double> frequencies, std::size_t trend_degree,
                     std::size_t tone_degree) {
  std::vector<double> basis;
  append_trend(basis, rows, trend_degree);
  append_tones(basis, rows, frequencies, tone_degree);
  return matrix_of(basis, rows);
}

LinearFit linear_fit(const ConstMatrix& design, Index wanted) {
  if (design.cols() == 0) return {MatrixXd(design.rows(), 0), MatrixXd(design.rows(), 0), MatrixXd(0, 0)};
  OrthogonalFactors factors = pivoted_orthogonal_factors(design);
  const Index rank = factors.rank();
  const auto triangle = factors.triangle.leftCols(rank);
  // Coefficient p is column j of R after pivoting: its row of the pseudo-inverse is Q·R^{-T}·e_j.
  MatrixXd selected = MatrixXd::Zero(rank, wanted);
  for (Index j = 0; j < rank; ++j) {
    const Index coefficient = factors.order[static_cast<std::size_t>(j)];
    if (coefficient < wanted) selected(j, coefficient) = 1;
  }
  const MatrixXd solved = solve_upper_transposed(triangle, selected);
  LinearFit fit{std::move(factors.basis), {}, transposed_product(solved, solved)};
  fit.weights = product(fit.basis, solved);
  if (rank < design.cols())
    fit.condition = kInfinity;
  else if (rank > 0)
    fit.condition = std::abs(triangle(0, 0) / triangle(rank - 1, rank - 1));
  return fit;
}

VectorXd frequency_slope(const RowSampling& rows, const ConstMatrix& waves, const ConstMatrix& amplitudes) {
  const Eigen::Map<const VectorXd> times(rows.times.data(), waves.rows());
  VectorXd slope = VectorXd::Zero(waves.rows());
  for (Index k = 0; k < waves.cols(); k += 2)
    slope += std::numbers::pi * static_cast<double>(k + 2) *
             times.cwiseProduct(amplitudes(k + 1, 0) * waves.col(k) - amplitudes(k, 0) * waves.col(k + 1));
  return slope;
}

MatrixXd beside(const ConstMatrix& basis, const ConstMatrix& vectors) {
  return vectors - product(basis, transposed_product(basis, vectors));
}

VectorXd coefficients_of(const ConstMatrix& design, const VectorXd& values) {
  return least_squares(design, values, 1 / kIllConditioned);
}

std::optional<NormalSolution> solve_normal(const MatrixXd& normal, const VectorXd& right) {
  const auto diagonal = normal.diagonal().array();
  if (!normal.allFinite()) return std::nullopt;
  const VectorXd scale = (diagonal > 0).select(diagonal.max(1e-300).sqrt().inverse(), 0.0);
  const MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  MatrixXd sides(normal.rows(), normal.rows() + 1);
  sides << MatrixXd::Identity(normal.rows(), normal.rows()), scale.cwiseProduct(right);
  const auto solved = solve_symmetric(scaled, sides, kMinPivot);
  if (!solved) return std::nullopt;
  return NormalSolution{scale.cwiseProduct(solved->rightCols(1)),
                        scale.asDiagonal() * solved->leftCols(normal.rows()) * scale.asDiagonal()};
}

FrequencyFit refine_frequencies(const RowSampling& rows, std::vector<double> frequencies, const MatrixXd& others,
                                const VectorXd& values) {
  const auto height = static_cast<double>(values.size());
  const auto count = static_cast<Index>(frequencies.size());
  const double bin = (height - 1) / (height * (rows.times.back() - rows.times.front()));
  VectorXd amplitudes;
  for (int step = 0; step < kMaxIterations; ++step) {
    const MatrixXd waves = waves_of(rows, frequencies);
    MatrixXd both(waves.rows(), 3 * count), slopes(waves.rows(), count);
    both.leftCols(2 * count) = beside(others, waves);
    if (step == 0) amplitudes = coefficients_of(both.leftCols(2 * count), values);
    for (Index k = 0; k < count; ++k)
      slopes.col(k) = frequency_slope(rows, waves.middleCols(2 * k, 2), amplitudes.segment(2 * k, 2));
    both.rightCols(count) = beside(others, slopes);
    const VectorXd solved = coefficients_of(both, values), moves = solved.tail(count);
    amplitudes = solved.head(2 * count);
    for (Index k = 0; k < count; ++k) {
      double& frequency = frequencies[static_cast<std::size_t>(k)];
      frequency = std::clamp(frequency + std::clamp(moves(k), -kReach * bin, kReach * bin), bin, 0.5 - bin);
    }
    if (moves.cwiseAbs().maxCoeff() < kSettled * bin) break;
  }
  const MatrixXd own = beside(others, waves_of(rows, frequencies));
  amplitudes = coefficients_of(own, values);
  VectorXd rest = values - own * amplitudes;
  return {std::move(frequencies), std::move(amplitudes), std::move(rest)};
}

}  // namespace ocisac
