#include "ocisac/tones/periodic_fit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "columns/equalizer_kernels.hpp"
#include "core/levels.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "rows/fit.hpp"
#include "tones/row_moments.hpp"
#include "tones/texture.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Signals = Eigen::Map<const MatrixXd>;  // (rows × signals)

constexpr std::size_t kManySignals = 6;  // of which one is in each lane of a strip
constexpr std::size_t kMaxTrend = 2;     // degree

Signals as_matrix(std::span<const double> signals, std::size_t rows) {
  require(rows > 0 && signals.size() % rows == 0, "rows", rows, "a divisor of the number of samples");
  return {signals.data(), static_cast<Index>(rows), static_cast<Index>(signals.size() / rows)};
}

// (signals × parameters)
Eigen::Map<const MatrixXd> coefficients_of(const PeriodicFit& fit) {
  const std::size_t count = fit.residual_energy.size();
  return {fit.coefficients.data(), static_cast<Index>(count), static_cast<Index>(fit.coefficients.size() / count)};
}

Index trend_columns(const PeriodicModel& model) { return static_cast<Index>(model.trend_degree) + 1; }

// The model's columns: trend, then cosine and sine of each harmonic.
MatrixXd model_matrix(const PeriodicModel& model, std::size_t rows, double frequency) {
  std::vector<double> frequencies;
  for (const std::size_t harmonic : model.harmonics) frequencies.push_back(static_cast<double>(harmonic) * frequency);
  return tone_design(centred_rows(rows), frequencies, model.trend_degree);
}

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// A trend's polynomial of v = 2u/rows, cos(2πhfu), or sin(2πhfu); and those times 2πhu = π·rows·h·v: with the
// coefficients (b, −a) they give ∂y/∂f up to a tone, which the fit absorbs.
struct Function {
  std::array<double, kMaxTrend + 1> powers;  // coefficients of v^p
  std::size_t lowest, highest;               // p of those that are not 0
  int harmonic = 0;
  bool sine = false;
};

constexpr std::array<Function, kMaxTrend + 1> kLegendre{{{{1, 0, 0}, 0, 0}, {{0, 1, 0}, 1, 1}, {{-0.5, 0, 1.5}, 0, 2}}};

// Sum of the product of two functions of the same parity over all rows.
double inner_product(const Function& a, const Function& b, const RowMoments& moments) {
  const int less = a.harmonic - b.harmonic, more = a.harmonic + b.harmonic;
  double sum = 0;
  for (std::size_t p = a.lowest; p <= a.highest; ++p)
    for (std::size_t q = b.lowest; q <= b.highest; ++q) {
      const double weight = a.powers[p] * b.powers[q] / 2;
      if (a.sine && b.sine)
        sum += weight * (moments.at(p + q, less) - moments.at(p + q, more));
      else if (weight != 0)
        sum += weight * (moments.at(p + q, more) + (b.sine ? -1 : 1) * moments.at(p + q, less));
    }
  return sum;
}

// The functions of one parity about the middle row, to which those of the other are orthogonal, by their places among
// all: the model's, then the slopes; and their normal equations.
struct Parity {
  std::vector<Function> functions, slopes;
  std::vector<Index> at, slopes_at;
  Index trend = 0;            // functions of the trend, the first ones
  MatrixXd triangle{};        // R of the model's functions
  MatrixXd coordinates{};     // of the signals in the basis
  MatrixXd with_slopes{};     // inner products of the functions with the slopes
  MatrixXd slopes_gram{};     // inner products of the slopes
  MatrixXd slopes_signals{};  // inner products of the slopes and the signals
};

using Parities = std::array<Parity, 2>;  // even, odd

Parities parities_of(const PeriodicModel& model, std::size_t rows) {
  require(model.trend_degree <= kMaxTrend, "trend_degree", model.trend_degree, "0 to 2");
  Parities both;
  auto& [even, odd] = both;
  for (std::size_t d = 0; d <= model.trend_degree; ++d) {
    Parity& own = both[d % 2];
    own.functions.push_back(kLegendre[d]);
    own.at.push_back(static_cast<Index>(d));
    ++own.trend;
  }
  Index place = trend_columns(model), slope = 0;
  for (const std::size_t order : model.harmonics) {
    const auto h = static_cast<int>(order);
    const double times = std::numbers::pi * static_cast<double>(rows) * static_cast<double>(order);
    even.functions.push_back({{1, 0, 0}, 0, 0, h, false});
    even.at.push_back(place++);
    odd.functions.push_back({{1, 0, 0}, 0, 0, h, true});
    odd.at.push_back(place++);
    odd.slopes.push_back({{0, times, 0}, 1, 1, h, false});
    odd.slopes_at.push_back(slope++);
    even.slopes.push_back({{0, times, 0}, 1, 1, h, true});
    even.slopes_at.push_back(slope++);
  }
  return both;
}

MatrixXd inner_products(const std::vector<Function>& some, const std::vector<Function>& others,
                        const RowMoments& moments) {
  const bool same = &some == &others;
  MatrixXd products(static_cast<Index>(some.size()), static_cast<Index>(others.size()));
  for (Index a = 0; a < products.rows(); ++a)
    for (Index b = 0; b < (same ? a + 1 : products.cols()); ++b) {
      products(a, b) = inner_product(some[static_cast<std::size_t>(a)], others[static_cast<std::size_t>(b)], moments);
      if (same) products(b, a) = products(a, b);
    }
  return products;
}

constexpr double kMinPivot = 3e-5;  // of R, relative

// R of functions, basis = functions·R⁻¹ orthonormal. `gram`: their inner products. A ridge leaves out what the rows do
// not tell from the rest, such as a sine of half the row rate, which is 0 in every row.
MatrixXd triangle_of(MatrixXd gram) {
  if (auto triangle = cholesky_factor(gram, kMinPivot)) return std::move(*triangle);
  gram.diagonal().array() += kMinPivot * kMinPivot * gram.diagonal().maxCoeff();
  return cholesky_factor(gram, 0).value();
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
  for (std::size_t h = 2; cycles >= 1 && h <= max_harmonics && static_cast<double>(h) * frequency <= below; ++h)
    model.harmonics.push_back(h);
  while (model.harmonics.size() > 1 && rows < 2 * model.parameters()) model.harmonics.pop_back();
  return model;
}

std::span<const double> PeriodicFit::amplitudes() const {
  const std::size_t count = residual_energy.size();
  return std::span(coefficients).subspan((model.trend_degree + 1) * count, 2 * count);
}

double PeriodicFit::total_residual() const {
  return std::accumulate(residual_energy.begin(), residual_energy.end(), 0.0);
}

double PeriodicFit::total_periodic() const {
  return std::accumulate(periodic_energy.begin(), periodic_energy.end(), 0.0);
}

PeriodicSignals::PeriodicSignals(std::vector<double> samples, std::size_t rows)
    : samples_(std::move(samples)), rows_(rows) {
  const Signals all = as_matrix(samples_, rows);
  energies_ = values_of(all.colwise().squaredNorm());
  for (auto& part : parts_) part.assign(half() * width(), 0.0);
  for (std::size_t s = 0; s < count(); ++s) {
    const auto signal = this->signal(s);
    std::size_t at = s / strip() * half() * strip() + s % strip();
    for (std::size_t after = rows / 2, before = (rows - 1) / 2; after < rows; ++after, --before, at += strip()) {
      parts_[0][at] = after == before ? signal[after] : signal[after] + signal[before];
      parts_[1][at] = signal[after] - signal[before];
    }
  }
  add_trend();
}

std::size_t PeriodicSignals::strip() const { return count() < kManySignals ? 1 : kernels::kBlockAlignment; }
std::size_t PeriodicSignals::width() const { return (count() + strip() - 1) / strip() * strip(); }

namespace {

// (functions × signals): the products of functions at the rows from the middle on with parts of signals.
RowMajor products_with(const RowMajor& functions, const std::vector<double>& parts, const PeriodicSignals& signals) {
  const std::size_t half = signals.half(), strip = signals.strip(), width = signals.width();
  if (strip == 1) return transposed_product(functions.transpose(), as_matrix(parts, half));
  RowMajor sums(functions.rows(), static_cast<Index>(width));
  for (std::size_t first = 0; first < width; first += strip)
    kernels::equalizer_loops<double>().matrix_times_rows(
        functions.data(), static_cast<std::size_t>(functions.rows()), half, &parts[first * half],
        static_cast<std::ptrdiff_t>(strip), sums.data() + first, static_cast<std::ptrdiff_t>(width), strip);
  return sums.leftCols(static_cast<Index>(signals.count()));
}

Parities normal_equations(const PeriodicSignals& signals, const PeriodicModel& model, double frequency,
                          bool with_slopes) {
  const std::size_t rows = signals.rows(), half = signals.half();
  const RowMoments moments(rows, frequency, 2 * model.harmonics.back(),
                           std::max<std::size_t>(2 * model.trend_degree, 2));
  std::vector<double> times(half);
  std::iota(times.begin(), times.end(), rows % 2 == 0 ? 0.5 : 0.0);
  const auto harmonics = std::ssize(model.harmonics), count = static_cast<Index>(signals.count());
  std::array<RowMajor, 2> waves;  // cosines, then slopes of sines; sines, then slopes of cosines
  for (RowMajor& functions : waves) functions.resize(with_slopes ? 2 * harmonics : harmonics, static_cast<Index>(half));
  auto& [cosine, sine] = waves;
  for (Index h = 0; h < harmonics; ++h) {
    const auto order = static_cast<double>(model.harmonics[static_cast<std::size_t>(h)]);
    fill_wave(times, order * frequency, {cosine.row(h).data(), half}, {sine.row(h).data(), half});
    if (!with_slopes) continue;
    const Eigen::RowVectorXd turn = kTwoPi * order * vector_of(times).transpose();
    cosine.row(harmonics + h) = sine.row(h).cwiseProduct(turn);
    sine.row(harmonics + h) = cosine.row(h).cwiseProduct(turn);
  }
  Parities both = parities_of(model, rows);
  for (const std::size_t parity : {0U, 1U}) {
    Parity& of = both[parity];
    const RowMajor products = products_with(waves[parity], signals.parts()[parity], signals);
    MatrixXd of_functions(of.trend + harmonics, count);
    of_functions << Eigen::Map<const RowMajor>(signals.trend()[parity].data(), of.trend, count),
        products.topRows(harmonics);
    of.triangle = triangle_of(inner_products(of.functions, of.functions, moments));
    of.coordinates = solve_upper_transposed(of.triangle, of_functions);
    if (!with_slopes) continue;
    of.with_slopes = inner_products(of.functions, of.slopes, moments);
    of.slopes_gram = inner_products(of.slopes, of.slopes, moments);
    of.slopes_signals = products.bottomRows(harmonics);
  }
  return both;
}

}  // namespace

// Products with the trend's polynomials.
void PeriodicSignals::add_trend() {
  const MatrixXd trend = tone_design(centred_rows(rows_), {}, kMaxTrend).bottomRows(static_cast<Index>(half()));
  RowMajor even(2, trend.rows());
  even << trend.col(0).transpose(), trend.col(2).transpose();
  const RowMajor odd = trend.col(1).transpose(), of_even = products_with(even, parts_[0], *this),
                 of_odd = products_with(odd, parts_[1], *this);
  trend_ = {std::vector(of_even.data(), of_even.data() + of_even.size()),
            std::vector(of_odd.data(), of_odd.data() + of_odd.size())};
}

PeriodicFit fit_periodic(const PeriodicSignals& signals, const PeriodicModel& model, double frequency, bool with_step) {
  const std::size_t rows = signals.rows();
  require(rows > model.parameters(), "rows", rows, "more rows than the model has parameters");
  const Index first = trend_columns(model), parameters = static_cast<Index>(model.parameters());
  const auto equations = normal_equations(signals, model, frequency, with_step);

  PeriodicFit fit;
  fit.model = model;
  fit.frequency = frequency;
  const auto count = static_cast<Index>(signals.count());
  Eigen::RowVectorXd residual = Eigen::Map<const Eigen::RowVectorXd>(signals.energies().data(), count);
  Eigen::RowVectorXd periodic = Eigen::RowVectorXd::Zero(count);
  MatrixXd coefficients(parameters, count);
  for (const Parity& of : equations) {
    residual -= of.coordinates.colwise().squaredNorm();
    periodic += of.coordinates.bottomRows(of.coordinates.rows() - of.trend).colwise().squaredNorm();
    coefficients(of.at, Eigen::all) = solve_upper(of.triangle, of.coordinates);
  }
  fit.residual_energy = values_of(residual.cwiseMax(0.0));
  fit.periodic_energy = values_of(periodic);
  for (Index j = first; j < parameters; j += 2)
    fit.harmonic_energy.push_back(static_cast<double>(rows) / 2 * coefficients.middleRows(j, 2).squaredNorm());

  fit.coefficients = values_of(coefficients.transpose());
  if (!with_step) return fit;
  const MatrixXd all_turned = slope_coefficients(model, coefficients);
  double gradient = 0, information = 0;
  for (const Parity& of : equations) {
    const MatrixXd turned = all_turned(of.slopes_at, Eigen::all),
                   inside =  // what the model absorbs of ∂y/∂f
                   solve_upper_transposed(of.triangle, product(of.with_slopes, turned));
    gradient += of.slopes_signals.cwiseProduct(turned).sum() - inside.cwiseProduct(of.coordinates).sum();
    information += product(of.slopes_gram, turned).cwiseProduct(turned).sum() - inside.squaredNorm();
  }
  fit.step = information > 0 ? gradient / information : 0;
  return fit;
}

PeriodicFit refine_periodic(const PeriodicSignals& signals, PeriodicFit best, double lower, double upper,
                            int max_steps) {
  const double bin = 1 / static_cast<double>(signals.rows());
  const double trusted = 1e-5 * bin;  // energies of such neighbours differ by rounding: the step needs no test
  const double converged = 1e-12 * bin;
  const double longest = 0.25 * bin / static_cast<double>(best.model.harmonics.back());
  for (int iteration = 0; iteration < max_steps; ++iteration) {
    double step = std::clamp(best.step, -longest, longest);
    PeriodicFit next;
    for (;; step /= 4) {
      next =
          fit_periodic(signals, best.model, std::clamp(best.frequency + step, lower, upper), iteration + 1 < max_steps);
      if (std::abs(step) <= trusted || next.total_residual() <= best.total_residual()) break;
    }
    const double moved = next.frequency - best.frequency;
    best = std::move(next);
    if (std::abs(moved) <= converged) break;
  }
  return best;
}

namespace {

// Variance of the sum of residual × derivative by texture: a harmonic h counts with h², and texture has the power 1/h²
// there. That which stands still is the same in all frames.
double texture_score(const PeriodicFit& fit, const MatrixXd& amplitudes, const Signals& residual,
                     const MatrixXd& derivative) {
  const PeriodicModel& model = fit.model;
  double mean = 0, variance = 0;
  const std::span<const double> rest(residual.data(), static_cast<std::size_t>(residual.size()));
  const auto rows = static_cast<std::size_t>(residual.rows());
  const std::vector<Texture> textures = textures_about(fit.frequency, rest, rows);
  for (Index s = 0; s < residual.cols(); ++s) {
    double flat = 0, steep = 0;
    for (std::size_t k = 0; k < model.harmonics.size(); ++k) {
      const Index place = trend_columns(model) + 2 * static_cast<Index>(k);
      const double energy = amplitudes.col(s).segment<2>(place).squaredNorm();
      flat += energy;
      steep += energy * static_cast<double>(model.harmonics[k] * model.harmonics[k]);
    }
    const Texture& texture = textures[static_cast<std::size_t>(s)];
    const double power = steep > 0 ? texture.power() * flat / steep : 0;
    if (!(power > 0)) continue;
    mean += power / static_cast<double>(residual.cols());
    variance += (texture.white + power) * derivative.col(s).squaredNorm();
  }
  return std::max(variance, mean * derivative.rowwise().sum().squaredNorm());
}

}  // namespace

std::vector<double> residual_of(const PeriodicSignals& signals, const PeriodicFit& fit) {
  const MatrixXd model = model_matrix(fit.model, signals.rows(), fit.frequency);
  return values_of(as_matrix(signals.samples(), signals.rows()) - product(model, coefficients_of(fit).transpose()));
}

double frequency_std(const PeriodicSignals& signals, std::size_t group, const PeriodicFit& fit,
                     std::span<const double> residual_values) {
  const std::size_t rows = signals.rows();
  if (rows <= fit.model.parameters() + 1) return kNaN;
  const Signals residual = as_matrix(residual_values, rows);
  const auto members = static_cast<Index>(group);
  require(group > 0 && residual.cols() % members == 0, "group", group, "a divisor of the number of signals");
  const MatrixXd matrix = model_matrix(fit.model, rows, fit.frequency), amplitudes = coefficients_of(fit).transpose();
  const MatrixXd triangle = triangle_of(transposed_product(matrix, matrix)),
                 q = solve_upper_transposed(triangle, matrix.transpose()).transpose();
  MatrixXd turned = slope_coefficients(fit.model, amplitudes);
  for (Index j = 0; j < turned.rows(); ++j)
    turned.row(j) *= kTwoPi * static_cast<double>(fit.model.harmonics[static_cast<std::size_t>(j / 2)]);
  const RowSampling sampling = centred_rows(rows);
  const Eigen::Map<const VectorXd> time(sampling.times.data(), residual.rows());
  MatrixXd derivative = time.asDiagonal() * product(matrix.rightCols(turned.rows()), turned);
  derivative = beside(q, derivative);
  const double information = derivative.squaredNorm();
  if (!(information > 0)) return kNaN;

  // Corrects for the share of each row's noise absorbed by the fit (its leverage).
  const VectorXd leverage = q.rowwise().squaredNorm() + derivative.rowwise().squaredNorm() / information;
  const VectorXd spare = (1 - leverage.array()).max(1e-3).sqrt().inverse();
  const MatrixXd products = residual.cwiseProduct(derivative);
  MatrixXd scores(residual.rows(), residual.cols() / members);
  for (Index g = 0; g < scores.cols(); ++g)
    scores.col(g) = products.middleCols(g * members, members).rowwise().sum().cwiseProduct(spare);
  const double texture = texture_score(fit, amplitudes, residual, derivative);
  // Frames that repeat each other, or see a lamp of one phase on rows of a fixed pattern, share their errors.
  const double shared = variance_of_sum(scores.rowwise().sum());
  return std::sqrt(std::max({variance_of_sum(scores), shared, texture})) / information;
}

}  // namespace ocisac
