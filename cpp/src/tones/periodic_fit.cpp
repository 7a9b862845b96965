#include "ocisac/tones/periodic_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>

#include "columns/equalizer_kernels.hpp"
#include "core/legendre.hpp"
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

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// The model's functions and their slopes (times 2πhu: with the coefficients (b, −a) they give ∂y/∂f up to a tone, which
// the fit absorbs) at the rows from the middle on, by their parity.
struct HalfBasis {
  struct Place {
    bool odd;
    Index row;
  };
  RowMajor even, odd;         // (functions × half)
  std::vector<Place> places;  // of the parameters, then of the slopes
  bool has_middle;            // the first row is the middle of the column: it counts once
};

// cos and sin of 2πfu, by a rotation from row to row that starts anew every 16 rows: exact to some 10⁻¹⁵.
void fill_waves(double frequency, double first, RowMajor& cosines, RowMajor& sines) {
  constexpr Index kAnchors = 16;
  const Phasor turn = phasor(frequency, 1);
  Phasor at{1, 0};
  for (Index i = 0; i < cosines.cols(); ++i) {
    at = i % kAnchors == 0
             ? phasor(frequency, first + static_cast<double>(i))
             : Phasor{at.cosine * turn.cosine - at.sine * turn.sine, at.sine * turn.cosine + at.cosine * turn.sine};
    cosines(0, i) = at.cosine;
    sines(0, i) = at.sine;
  }
  for (Index h = 1; h < cosines.rows(); ++h) {
    const auto c = cosines.row(0).array(), s = sines.row(0).array();
    cosines.row(h) = cosines.row(h - 1).array() * c - sines.row(h - 1).array() * s;
    sines.row(h) = sines.row(h - 1).array() * c + cosines.row(h - 1).array() * s;
  }
}

HalfBasis half_basis(const PeriodicModel& model, std::size_t rows, double frequency) {
  const auto half = static_cast<Index>((rows + 1) / 2), count = static_cast<Index>(model.harmonics.size());
  const double first = rows % 2 == 0 ? 0.5 : 0.0;
  RowMajor cosines(static_cast<Index>(model.harmonics.back()), half), sines(cosines.rows(), half);
  fill_waves(frequency, first, cosines, sines);
  const Index even_trend = model.trend_degree / 2 + 1, odd_trend = (model.trend_degree + 1) / 2;
  HalfBasis basis{RowMajor(even_trend + 2 * count, half), RowMajor(odd_trend + 2 * count, half), {}, rows % 2 == 1};
  std::vector<double> polynomials(model.trend_degree + 1);
  for (Index i = 0; i < half; ++i) {
    legendre(2 * (first + static_cast<double>(i)) / static_cast<double>(rows), polynomials);
    for (std::size_t d = 0; d < polynomials.size(); ++d)
      (d % 2 == 0 ? basis.even : basis.odd)(static_cast<Index>(d / 2), i) = polynomials[d];
  }
  for (std::size_t d = 0; d < polynomials.size(); ++d) basis.places.push_back({d % 2 == 1, static_cast<Index>(d / 2)});
  const Eigen::RowVectorXd time =
      2 * std::numbers::pi * Eigen::RowVectorXd::LinSpaced(half, first, first + static_cast<double>(half - 1));
  for (Index h = 0; h < count; ++h) {
    const auto order = static_cast<Index>(model.harmonics[static_cast<std::size_t>(h)]);
    basis.even.row(even_trend + h) = cosines.row(order - 1);
    basis.odd.row(odd_trend + h) = sines.row(order - 1);
    basis.odd.row(odd_trend + count + h) = static_cast<double>(order) * time.cwiseProduct(cosines.row(order - 1));
    basis.even.row(even_trend + count + h) = static_cast<double>(order) * time.cwiseProduct(sines.row(order - 1));
    basis.places.push_back({false, even_trend + h});
    basis.places.push_back({true, odd_trend + h});
  }
  for (Index h = 0; h < count; ++h) {
    basis.places.push_back({true, odd_trend + count + h});
    basis.places.push_back({false, even_trend + count + h});
  }
  return basis;
}

// Inner products of all functions over all rows; those of different parity are 0.
MatrixXd inner_products(const HalfBasis& basis) {
  const auto of_half = [&](const RowMajor& functions) {
    MatrixXd weighted = functions * std::numbers::sqrt2;
    if (basis.has_middle) weighted.col(0) = functions.col(0);
    return gram(weighted);
  };
  const MatrixXd even = of_half(basis.even), odd = of_half(basis.odd);
  const auto size = static_cast<Index>(basis.places.size());
  return MatrixXd::NullaryExpr(size, size, [&](Index a, Index b) {
    const auto& one = basis.places[static_cast<std::size_t>(a)];
    const auto& other = basis.places[static_cast<std::size_t>(b)];
    return one.odd != other.odd ? 0.0 : (one.odd ? odd : even)(one.row, other.row);
  });
}

// Functions first … first + count at all rows.
MatrixXd at_all_rows(const HalfBasis& basis, Index rows, Index first, Index count) {
  MatrixXd matrix(rows, count);
  for (Index j = 0; j < count; ++j) {
    const auto& place = basis.places[static_cast<std::size_t>(first + j)];
    const auto values = (place.odd ? basis.odd : basis.even).row(place.row);
    matrix.col(j).tail(values.size()) = values.transpose();
    matrix.col(j).head(rows / 2) = (place.odd ? -1 : 1) * values.tail(rows / 2).reverse().transpose();
  }
  return matrix;
}

// (functions × signals)
MatrixXd products_with(const HalfBasis& basis, const PeriodicSignals& signals) {
  const std::size_t width = signals.width();
  const auto of_half = [&](const RowMajor& functions, const std::vector<double>& parts) {
    RowMajor sums(functions.rows(), static_cast<Index>(width));
    const auto stride = static_cast<std::ptrdiff_t>(width);
    kernels::matrix_times_rows(functions.data(), static_cast<std::size_t>(functions.rows()), signals.half(),
                               parts.data(), stride, sums.data(), stride, width);
    return sums;
  };
  const RowMajor even = of_half(basis.even, signals.even()), odd = of_half(basis.odd, signals.odd());
  MatrixXd products(static_cast<Index>(basis.places.size()), static_cast<Index>(signals.count()));
  for (Index a = 0; a < products.rows(); ++a) {
    const auto& place = basis.places[static_cast<std::size_t>(a)];
    products.row(a) = (place.odd ? odd : even).row(place.row).head(products.cols());
  }
  return products;
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

PeriodicSignals::PeriodicSignals(std::span<const double> samples, std::size_t rows)
    : samples_(samples), rows_(rows), width_(0) {
  require(rows > 0 && samples.size() % rows == 0, "rows", rows, "a divisor of the number of samples");
  const std::size_t signals = samples.size() / rows;
  width_ = (signals + kernels::kBlockAlignment - 1) / kernels::kBlockAlignment * kernels::kBlockAlignment;
  energies_.resize(signals);
  even_.assign(half() * width_, 0.0);
  odd_.assign(half() * width_, 0.0);
  for (std::size_t s = 0; s < signals; ++s) {
    const auto signal = samples.subspan(s * rows, rows);
    for (const double v : signal) energies_[s] += v * v;
    for (std::size_t i = 0; i < half(); ++i) {
      const std::size_t after = rows / 2 + i, before = rows - 1 - after;
      even_[i * width_ + s] = after == before ? signal[after] : signal[after] + signal[before];
      odd_[i * width_ + s] = signal[after] - signal[before];
    }
  }
}

namespace {

// Normal equations of the model and its slopes.
struct Equations {
  MatrixXd triangle;             // R of the model's functions, basis = functions·R⁻¹ orthonormal
  MatrixXd coordinates;          // of the signals in the basis
  MatrixXd inside, slopes_gram;  // of the slopes in the basis; inner products of the slopes
  MatrixXd slopes_signals;       // inner products of the slopes and the signals
};

constexpr double kMinPivot = 0.03;  // less loses more than three digits by normal equations: orthogonal factors then

std::optional<Equations> normal_equations(const PeriodicSignals& signals, const PeriodicModel& model,
                                          double frequency) {
  const HalfBasis basis = half_basis(model, signals.rows(), frequency);
  const auto parameters = static_cast<Index>(model.parameters());
  const MatrixXd gram = inner_products(basis);
  const Index slopes = gram.rows() - parameters;
  auto triangle = cholesky_factor(gram.topLeftCorner(parameters, parameters), kMinPivot);
  if (!triangle) return std::nullopt;
  const MatrixXd products = products_with(basis, signals);
  MatrixXd coordinates = solve_upper_transposed(*triangle, products.topRows(parameters));
  MatrixXd inside = solve_upper_transposed(*triangle, gram.topRightCorner(parameters, slopes));
  return Equations{std::move(*triangle), std::move(coordinates), std::move(inside),
                   gram.bottomRightCorner(slopes, slopes), products.bottomRows(slopes)};
}

Equations orthogonal_equations(const PeriodicSignals& signals, const PeriodicModel& model, double frequency) {
  const Signals y = as_matrix(signals.samples(), signals.rows());
  const MatrixXd matrix = model_matrix(model, y.rows(), frequency);
  const MatrixXd slopes = slope_matrix(model, matrix);
  OrthogonalFactors factors = orthogonal_factors(matrix);
  return {std::move(factors.triangle), transposed_product(factors.basis, y), transposed_product(factors.basis, slopes),
          transposed_product(slopes, slopes), transposed_product(slopes, y)};
}

}  // namespace

PeriodicFit fit_periodic(const PeriodicSignals& signals, const PeriodicModel& model, double frequency) {
  const std::size_t rows = signals.rows();
  require(rows > model.parameters(), "rows", rows, "more rows than the model has parameters");
  const Index first = trend_columns(model), parameters = static_cast<Index>(model.parameters());
  auto equations = normal_equations(signals, model, frequency);
  if (!equations) equations = orthogonal_equations(signals, model, frequency);
  const MatrixXd& coordinates = equations->coordinates;
  const MatrixXd coefficients = solve_upper(equations->triangle, coordinates);

  PeriodicFit fit;
  fit.frequency = frequency;
  const Eigen::Map<const Eigen::RowVectorXd> energies(signals.energies().data(), coordinates.cols());
  fit.residual_energy = as_vector((energies - coordinates.colwise().squaredNorm()).cwiseMax(0.0));
  fit.periodic_energy = as_vector(coordinates.bottomRows(parameters - first).colwise().squaredNorm());
  for (Index j = first; j < parameters; j += 2)
    fit.harmonic_energy.push_back(static_cast<double>(rows) / 2 * coefficients.middleRows(j, 2).squaredNorm());

  for (Index j = first; j < first + 2; ++j)
    fit.amplitudes.insert(fit.amplitudes.end(), coefficients.row(j).begin(), coefficients.row(j).end());

  const MatrixXd turned = slope_coefficients(model, coefficients);
  const MatrixXd& inside = equations->inside;  // projection of the slopes on the model
  const MatrixXd gram = equations->slopes_gram - transposed_product(inside, inside);
  const MatrixXd against_residual = equations->slopes_signals - transposed_product(inside, coordinates);
  const double gradient = against_residual.cwiseProduct(turned).sum();
  const double information = product(gram, turned).cwiseProduct(turned).sum();
  fit.step = information > 0 ? gradient / information : 0;
  return fit;
}

PeriodicFit fit_periodic(std::span<const double> signals, std::size_t rows, const PeriodicModel& model,
                         double frequency) {
  return fit_periodic(PeriodicSignals(signals, rows), model, frequency);
}

PeriodicFit refine_periodic(std::span<const double> signals, std::size_t rows, const PeriodicModel& model,
                            double frequency, double lower, double upper, int max_steps) {
  return refine_periodic(PeriodicSignals(signals, rows), model, frequency, lower, upper, max_steps);
}

PeriodicFit refine_periodic(const PeriodicSignals& signals, const PeriodicModel& model, double frequency, double lower,
                            double upper, int max_steps) {
  const double bin = 1 / static_cast<double>(signals.rows());
  const double trusted = 1e-5 * bin;  // energies of such neighbours differ by rounding: the step needs no test
  const double converged = 1e-12 * bin;
  const double longest = 0.25 * bin / static_cast<double>(model.harmonics.back());
  PeriodicFit best = fit_periodic(signals, model, std::clamp(frequency, lower, upper));
  for (int iteration = 0; iteration < max_steps; ++iteration) {
    double step = std::clamp(best.step, -longest, longest);
    PeriodicFit next;
    for (;; step /= 4) {
      next = fit_periodic(signals, model, std::clamp(best.frequency + step, lower, upper));
      if (std::abs(step) <= trusted || next.total_residual() <= best.total_residual()) break;
    }
    const double moved = next.frequency - best.frequency;
    best = std::move(next);
    if (std::abs(moved) <= converged) break;
  }
  return best;
}

namespace {

struct Projection {
  MatrixXd q;             // (rows × parameters) orthonormal
  MatrixXd coordinates;   // qᵀ·signals
  MatrixXd coefficients;  // of the model's columns
};

Projection project(const HalfBasis& functions, const MatrixXd& matrix, const Signals& signals) {
  const MatrixXd gram = inner_products(functions).topLeftCorner(matrix.cols(), matrix.cols());
  OrthogonalFactors factors;
  if (auto triangle = cholesky_factor(gram, kMinPivot))
    factors = {solve_upper_transposed(*triangle, matrix.transpose()).transpose(), *triangle, {}};
  else
    factors = orthogonal_factors(matrix);
  const MatrixXd coordinates = transposed_product(factors.basis, signals);
  return {std::move(factors.basis), coordinates, solve_upper(factors.triangle, coordinates)};
}

}  // namespace

double frequency_std(std::span<const double> signals, std::size_t rows, std::size_t group, const PeriodicModel& model,
                     double frequency) {
  if (rows <= model.parameters() + 1) return std::numeric_limits<double>::quiet_NaN();
  const Signals y = as_matrix(signals, rows);
  const auto members = static_cast<Index>(group);
  require(group > 0 && y.cols() % members == 0, "group", group, "a divisor of the number of signals");
  const HalfBasis functions = half_basis(model, rows, frequency);
  const auto parameters = static_cast<Index>(model.parameters());
  const MatrixXd matrix = at_all_rows(functions, y.rows(), 0, parameters);
  const Projection p = project(functions, matrix, y);
  const MatrixXd residual = y - product(p.q, p.coordinates);
  const MatrixXd slopes =
      at_all_rows(functions, y.rows(), parameters, static_cast<Index>(functions.places.size()) - parameters);
  MatrixXd derivative = product(slopes, slope_coefficients(model, p.coefficients));
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
