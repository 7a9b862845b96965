#include "ocisac/tones/periodic_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "core/linear_algebra.hpp"
#include "ocisac/core/require.hpp"
#include "tones/design_matrix.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Signals = Eigen::Map<const MatrixXd>;  // (rows × signals)

Signals as_matrix(std::span<const double> signals, std::size_t rows) {
  require(rows > 0 && signals.size() % rows == 0, "rows", rows, "a divisor of the number of samples");
  return {signals.data(), static_cast<Index>(rows), static_cast<Index>(signals.size() / rows)};
}

Index trend_columns(const PeriodicModel& model) { return static_cast<Index>(model.trend_degree) + 1; }

// The model's columns: trend, then cosine and sine of each harmonic.
MatrixXd model_matrix(const PeriodicModel& model, Index rows, double frequency) {
  return design_matrix(model.design(static_cast<std::size_t>(rows), frequency));
}

// The tones times 2πhu: with the coefficients (b, −a) they give ∂y/∂f up to a tone, which the fit absorbs.
MatrixXd slope_matrix(const PeriodicModel& model, const MatrixXd& matrix) {
  const Index rows = matrix.rows(), first = trend_columns(model);
  const double middle = static_cast<double>(rows - 1) / 2;
  const VectorXd time = 2 * std::numbers::pi * VectorXd::LinSpaced(rows, -middle, middle);
  MatrixXd slopes(rows, matrix.cols() - first);
  for (Index j = 0; j < slopes.cols(); ++j)
    slopes.col(j) = static_cast<double>(model.harmonics[static_cast<std::size_t>(j / 2)]) *
                    time.cwiseProduct(matrix.col(first + j));
  return slopes;
}

struct Projection {
  MatrixXd q;             // (rows × parameters) orthonormal
  MatrixXd coordinates;   // qᵀ·signals
  MatrixXd coefficients;  // of the model's columns
};

Projection project(const MatrixXd& matrix, const Signals& signals) {
  OrthogonalFactors factors = orthogonal_factors(matrix);
  const MatrixXd coordinates = transposed_product(factors.basis, signals);
  return {std::move(factors.basis), coordinates, solve_upper(factors.triangle, coordinates)};
}

// Coefficients of the slopes: b for a cosine, −a for a sine.
MatrixXd slope_coefficients(const PeriodicModel& model, const MatrixXd& coefficients) {
  const Index first = trend_columns(model);
  MatrixXd slopes(coefficients.rows() - first, coefficients.cols());
  for (Index j = 0; j < slopes.rows(); j += 2) {
    slopes.row(j) = coefficients.row(first + j + 1);
    slopes.row(j + 1) = -coefficients.row(first + j);
  }
  return slopes;
}

std::vector<double> as_vector(const VectorXd& v) { return {v.begin(), v.end()}; }

// Lag of the Bartlett window for a first-order autoregressive score (Andrews 1991, eqs. 5.3 and 6.4).
Index bartlett_lag(double rho, Index rows) {
  const double alpha = 4 * rho * rho / std::pow(1 - rho * rho, 2);
  const double lag = 1.1447 * std::cbrt(alpha * static_cast<double>(rows));
  return static_cast<Index>(std::min(lag, static_cast<double>(rows) / 4));
}

double autocovariance(const MatrixXd& scores, Index lag) {
  const Index rows = scores.rows() - lag;
  return scores.topRows(rows).cwiseProduct(scores.bottomRows(rows)).sum();
}

// Variance of the sum of all scores (rows × groups); groups are independent.
double variance_of_sum(const MatrixXd& scores) {
  const double power = autocovariance(scores, 0);
  if (!(power > 0)) return 0;
  const double rho = std::clamp(autocovariance(scores, 1) / power, -0.97, 0.97);
  const Index lags = bartlett_lag(rho, scores.rows());
  double variance = power;
  for (Index lag = 1; lag <= lags; ++lag)
    variance += 2 * (1 - static_cast<double>(lag) / static_cast<double>(lags + 1)) * autocovariance(scores, lag);
  return std::max(variance, 0.0);
}

}  // namespace

PeriodicModel periodic_model(double frequency, std::size_t rows, std::size_t max_harmonics) {
  const double cycles = frequency * static_cast<double>(rows);
  PeriodicModel model;
  model.trend_degree = cycles < 2 ? 0 : cycles < 4 ? 1 : 2;
  const double below = 0.5 - 0.5 / static_cast<double>(rows);  // closer to half the row rate, sine or cosine vanish
  for (std::size_t h = 2; h <= max_harmonics && static_cast<double>(h) * frequency <= below; ++h)
    model.harmonics.push_back(h);
  while (model.harmonics.size() > 1 && rows < 2 * model.parameters()) model.harmonics.pop_back();
  return model;
}

ToneDesign PeriodicModel::design(std::size_t rows, double frequency) const {
  ToneDesign design{rows, {}, trend_degree};
  for (const std::size_t harmonic : harmonics)
    design.cycles_per_row.push_back(static_cast<double>(harmonic) * frequency);
  return design;
}

double PeriodicFit::total_residual() const {
  return std::accumulate(residual_energy.begin(), residual_energy.end(), 0.0);
}

PeriodicFit fit_periodic(std::span<const double> signals, std::size_t rows, const PeriodicModel& model,
                         double frequency) {
  require(rows > model.parameters(), "rows", rows, "more rows than the model has parameters");
  const Signals y = as_matrix(signals, rows);
  const Index first = trend_columns(model), parameters = static_cast<Index>(model.parameters());
  // One product for the model and its slopes; the residual energy follows from the projection.
  MatrixXd both(y.rows(), 2 * parameters - first);
  both.leftCols(parameters) = model_matrix(model, y.rows(), frequency);
  const MatrixXd slopes = slope_matrix(model, both.leftCols(parameters));
  const OrthogonalFactors factors = orthogonal_factors(both.leftCols(parameters));
  both.leftCols(parameters) = factors.basis;
  both.rightCols(slopes.cols()) = slopes;
  const MatrixXd products = transposed_product(both, y);
  const auto coordinates = products.topRows(parameters);
  const MatrixXd coefficients = solve_upper(factors.triangle, coordinates);

  PeriodicFit fit;
  fit.frequency = frequency;
  fit.residual_energy = as_vector((y.colwise().squaredNorm() - coordinates.colwise().squaredNorm()).cwiseMax(0.0));
  fit.periodic_energy = as_vector(coordinates.bottomRows(parameters - first).colwise().squaredNorm());
  for (Index j = first; j < parameters; j += 2)
    fit.harmonic_energy.push_back(static_cast<double>(rows) / 2 * coefficients.middleRows(j, 2).squaredNorm());

  for (Index j = first; j < first + 2; ++j)
    fit.amplitudes.insert(fit.amplitudes.end(), coefficients.row(j).begin(), coefficients.row(j).end());

  const MatrixXd turned = slope_coefficients(model, coefficients);
  const MatrixXd inside = transposed_product(factors.basis, slopes);  // projection of the slopes on the model
  const MatrixXd gram = transposed_product(slopes, slopes) - transposed_product(inside, inside);
  const MatrixXd against_residual = products.bottomRows(slopes.cols()) - transposed_product(inside, coordinates);
  const double gradient = against_residual.cwiseProduct(turned).sum();
  const double information = product(gram, turned).cwiseProduct(turned).sum();
  fit.step = information > 0 ? gradient / information : 0;
  return fit;
}

PeriodicFit refine_periodic(std::span<const double> signals, std::size_t rows, const PeriodicModel& model,
                            double frequency, double lower, double upper, int max_steps) {
  const double bin = 1 / static_cast<double>(rows);
  const double trusted = 1e-5 * bin;  // energies of such neighbours differ by rounding: the step needs no test
  const double converged = 1e-12 * bin;
  const double longest = 0.25 * bin / static_cast<double>(model.harmonics.back());
  PeriodicFit best = fit_periodic(signals, rows, model, std::clamp(frequency, lower, upper));
  for (int iteration = 0; iteration < max_steps; ++iteration) {
    double step = std::clamp(best.step, -longest, longest);
    PeriodicFit next;
    for (;; step /= 4) {
      next = fit_periodic(signals, rows, model, std::clamp(best.frequency + step, lower, upper));
      if (std::abs(step) <= trusted || next.total_residual() <= best.total_residual()) break;
    }
    const double moved = next.frequency - best.frequency;
    best = std::move(next);
    if (std::abs(moved) <= converged) break;
  }
  return best;
}

double frequency_std(std::span<const double> signals, std::size_t rows, std::size_t group, const PeriodicModel& model,
                     double frequency) {
  if (rows <= model.parameters() + 1) return std::numeric_limits<double>::quiet_NaN();
  const Signals y = as_matrix(signals, rows);
  const auto members = static_cast<Index>(group);
  require(group > 0 && y.cols() % members == 0, "group", group, "a divisor of the number of signals");
  const MatrixXd matrix = model_matrix(model, y.rows(), frequency);
  const Projection p = project(matrix, y);
  const MatrixXd residual = y - product(p.q, p.coordinates);
  MatrixXd derivative = product(slope_matrix(model, matrix), slope_coefficients(model, p.coefficients));
  derivative -= product(p.q, transposed_product(p.q, derivative));
  const double information = derivative.squaredNorm();
  if (!(information > 0)) return std::numeric_limits<double>::quiet_NaN();

  // Corrects for the share of each row's noise absorbed by the fit (its leverage).
  const VectorXd leverage = p.q.rowwise().squaredNorm() + derivative.rowwise().squaredNorm() / information;
  const VectorXd spare = (1 - leverage.array()).max(1e-3).sqrt().inverse();
  const MatrixXd products = residual.cwiseProduct(derivative);
  MatrixXd scores(y.rows(), y.cols() / members);
  for (Index g = 0; g < scores.cols(); ++g)
    scores.col(g) = products.middleCols(g * members, members).rowwise().sum().cwiseProduct(spare);
  return std::sqrt(variance_of_sum(scores)) / information;
}

}  // namespace ocisac
