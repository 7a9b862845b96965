// Fits of the model of a row signal: linear, and with frequencies.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "core/linear_algebra.hpp"
#include "ocisac/rows/basis.hpp"

namespace ocisac {

// A basis as (rows × columns).
Eigen::Map<const Eigen::MatrixXd> matrix_of(const std::vector<double>& basis, const RowSampling& rows);

// Constant, polynomials and tones in one matrix, the most frequent one.
Eigen::MatrixXd tone_design(const RowSampling& rows, std::span<const double> frequencies, std::size_t trend_degree = 0,
                            std::size_t tone_degree = 0);

inline constexpr double kIllConditioned = 1e6;  // condition number above which noise dominates the result

// Least squares of a design (rows × columns) as weights of the rows: by QR, which does not square the condition number
// as normal equations do.
struct LinearFit {
  Eigen::MatrixXd basis;       // (rows × rank), orthonormal
  Eigen::MatrixXd weights;     // (rows × wanted): coefficient k of values y is weights.col(k)·y; 0 beyond the rank
  Eigen::MatrixXd covariance;  // (wanted × wanted) of the coefficients, for noise of variance 1 in every row
  double condition = 1;        // infinite where columns depend on each other
};
LinearFit linear_fit(const ConstMatrix& design, Eigen::Index wanted);  // `wanted`: of the columns, the first ones

// What an orthonormal basis leaves of vectors (rows × vectors).
Eigen::MatrixXd beside(const ConstMatrix& basis, const ConstMatrix& vectors);

// Coefficients of the columns of a design; 0 for those nearly collinear with others.
Eigen::VectorXd coefficients_of(const ConstMatrix& design, const Eigen::VectorXd& values);

// Solution of normal equations (n × n), scaled to a unit diagonal; absent where columns are dependent.
struct NormalSolution {
  Eigen::VectorXd values;
  Eigen::MatrixXd inverse;
};
std::optional<NormalSolution> solve_normal(const Eigen::MatrixXd& normal, const Eigen::VectorXd& right);

// Derivative by f of the tones f, 2f, … whose cosines and sines are `waves` (rows × 2·tones).
Eigen::VectorXd frequency_slope(const RowSampling& rows, const ConstMatrix& waves, const ConstMatrix& amplitudes);

// Tones beside other terms: y = others + Σ a·cos(2πft) + b·sin(2πft).
struct FrequencyFit {
  std::vector<double> frequencies;
  Eigen::VectorXd amplitudes;  // a and b of each in turn
  Eigen::VectorXd rest;        // of the values, which is orthogonal to the others
};
// Steps of all frequencies together by Gauss–Newton with all else refitted (variable projection), each damped to
// a quarter of a bin, from a peak of a periodogram on. `others`: orthonormal.
FrequencyFit refine_frequencies(const RowSampling& rows, std::vector<double> frequencies, const Eigen::MatrixXd& others,
                                const Eigen::VectorXd& values);

}  // namespace ocisac
