#include "ocisac/chips/row_nuisance.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <numeric>

#include "chips/channel_equations.hpp"
#include "core/check_interrupt.hpp"
#include "core/linear_algebra.hpp"
#include "core/spectrum.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kTurn = 2 * std::numbers::pi;
constexpr std::size_t kPadding = 4;  // frequency steps per width of a frame's spectral line
constexpr std::size_t kNearBins = 2 * kPadding, kFarBins = 8 * kPadding;  // from a tone to its neighbourhood
constexpr double kMaxSlowTerms = 160;  // a frame of 0.3 s at 260 Hz; the time grows with the square
constexpr double kRounding = 1e-12;    // relative to the mean: a signal that deviates by no more is constant
constexpr Index kSwingTerms = 3;
constexpr std::size_t kTurns = 64;      // of a phasor, rounded by 1e-16 each
constexpr double kMinSlope = 1e-9;      // of its squares, not explained by the other columns
constexpr double kShortestPart = 1e-6;  // cycles; a shorter exposure is none
constexpr int kSquareSteps = 12;
constexpr double kSquareReach = 0.6;  // spectral lines of a frame
constexpr int kSquareHalvings = 4;    // of the steps of frequency and phase

Index slow_terms(std::size_t rows, const RowNuisance& nuisance) {
  return static_cast<Index>(std::min(std::ceil(2 * static_cast<double>(rows) * nuisance.slow), kMaxSlowTerms));
}

// cos and sin (nullptr: none) of first + step·n for n < rows, by turns of a phasor, exact every kTurns rows.
void fill_tone(double step, double first, double* cosine, double* sine, std::size_t rows) {
  const std::complex<double> turn = std::polar(1.0, step);
  std::complex<double> phasor;
  for (std::size_t n = 0; n < rows; ++n) {
    phasor = n % kTurns == 0 ? std::polar(1.0, first + step * static_cast<double>(n)) : phasor * turn;
    cosine[n] = phasor.real();
    if (sine) sine[n] = phasor.imag();
  }
}

// Columns of slow light and tones, with room for `more` at the end; the constant comes first.
MatrixXd nuisance_columns(std::size_t rows, const RowNuisance& nuisance, std::size_t harmonics, Index more) {
  const auto count = static_cast<double>(rows);
  const Index slow = slow_terms(rows, nuisance);
  std::vector<double> frequencies;
  for (const double tone : nuisance.tones)
    for (std::size_t harmonic = 1; harmonic <= harmonics; ++harmonic)
      if (static_cast<double>(harmonic) * tone < 0.5) frequencies.push_back(static_cast<double>(harmonic) * tone);
  MatrixXd columns(static_cast<Index>(rows), 1 + slow + 2 * static_cast<Index>(frequencies.size()) + more);
  for (Index k = 0; k <= slow; ++k) {
    const double half_turns = 0.5 * kTurn * static_cast<double>(k) / count;
    fill_tone(half_turns, 0.5 * half_turns, &columns(0, k), nullptr, rows);
  }
  Index column = slow + 1;
  for (const double frequency : frequencies) {
    fill_tone(kTurn * frequency, 0, &columns(0, column), &columns(0, column + 1), rows);
    column += 2;
  }
  if (!nuisance.scale.empty()) {
    const Eigen::Map<const VectorXd> scale(nuisance.scale.data(), columns.rows());
    columns.middleCols(1, column - 1).array().colwise() *= scale.array();
  }
  return columns;
}

// By how much each tone is too low for the least residual, cycles per row: one Gauss–Newton step with all else
// refitted. Its derivative by the frequency is that of its fitted harmonics about the middle row.
void find_tone_steps(const MatrixXd& model, const Solved& solved, const VectorXd& left, const RowNuisance& nuisance,
                     Index first_tone, NuisanceFit& fit) {
  double squares = 0;
  const double middle = 0.5 * static_cast<double>(model.rows() - 1);
  for (const double tone : nuisance.tones) {
    VectorXd slope = VectorXd::Zero(model.rows());
    for (std::size_t harmonic = 1; harmonic <= kToneHarmonics; ++harmonic) {
      if (!(static_cast<double>(harmonic) * tone < 0.5)) continue;
      slope += kTurn * static_cast<double>(harmonic) *
               (solved.values[first_tone + 1] * model.col(first_tone) -
                solved.values[first_tone] * model.col(first_tone + 1));
      first_tone += 2;
    }
    slope.array() *= VectorXd::LinSpaced(model.rows(), -middle, middle).array();
    const VectorXd shared = model.transpose() * slope;
    const double own = slope.squaredNorm() - shared.dot(solved.inverse * shared);
    fit.tone_steps.push_back(own > kMinSlope * slope.squaredNorm() ? slope.dot(left) / own : 0.0);
    squares += std::pow(fit.tone_steps.back(), 2) * slope.squaredNorm();
  }
  fit.moved_by_steps = std::sqrt(squares / static_cast<double>(model.rows()));
}

struct SquareWave {
  double frequency, phase, height, gain;  // gain: by which the squares fall
};

// A square wave of ±½ and duty ½, exposed for a part of its cycle about `cycles`: a trapezoid.
double exposed_square(double cycles, double exposure) {
  const auto integral = [](double at) {
    const double part = at - std::floor(at);
    return 0.5 * std::min(part, 1 - part);
  };
  if (exposure <= kShortestPart) return cycles - std::floor(cycles) < 0.5 ? 0.5 : -0.5;
  return (integral(cycles + 0.5 * exposure) - integral(cycles - 0.5 * exposure)) / exposure;
}

}  // namespace

std::optional<NuisanceFit> remove_nuisance(std::span<const double> signal, const RowNuisance& nuisance,
                                           std::span<const double> exposed) {
  const std::size_t scaled = nuisance.scale.size();
  require(scaled == 0 || scaled == signal.size(), "scale", scaled, "a value for each row");
  const Index swings = exposed.empty() ? 0 : kSwingTerms;
  MatrixXd model = nuisance_columns(signal.size(), nuisance, exposed.empty() ? 1 : kToneHarmonics, swings);
  const Index others = model.cols() - swings;
  for (Index n = 0; n < model.rows() && swings > 0; ++n) {
    const double x = along_frame(static_cast<double>(n), signal.size());
    double swing = exposed[static_cast<std::size_t>(n)];
    for (Index k = 0; k < swings; ++k, swing *= x) model(n, others + k) = swing;
  }
  if (model.rows() <= model.cols()) return std::nullopt;
  const Eigen::Map<const VectorXd> values(signal.data(), model.rows());
  const auto solved = solve_normal(normal_of(model), model.transpose() * values);
  if (!solved) return std::nullopt;
  const VectorXd rest = values - model.middleCols(1, others - 1) * solved->values.segment(1, others - 1);
  VectorXd left = rest.array() - solved->values[0];
  left -= model.rightCols(swings) * solved->values.tail(swings);
  NuisanceFit fit{{rest.begin(), rest.end()}, left.squaredNorm(), {}};
  if (swings > 0) find_tone_steps(model, *solved, left, nuisance, 1 + slow_terms(signal.size(), nuisance), fit);
  return fit;
}

StrongestTone strongest_tone(std::span<const double> signals, std::size_t rows, double lowest, double highest) {
  const std::size_t length = optimal_dft_length(kPadding * rows), bins = length / 2 + 1;
  std::vector<double> powers(bins);
  for (std::size_t begin = 0; begin + rows <= signals.size(); begin += rows) {
    const auto signal = signals.subspan(begin, rows);
    const double mean = std::accumulate(signal.begin(), signal.end(), 0.0) / static_cast<double>(rows);
    const auto varies = [&](double value) { return std::abs(value - mean) > kRounding * std::abs(mean); };
    if (std::ranges::none_of(signal, varies)) continue;
    std::vector<double> windowed(length);
    for (std::size_t n = 0; n < rows; ++n) {
      const double sine = std::sin(0.5 * kTurn * (static_cast<double>(n) + 0.5) / static_cast<double>(rows));
      windowed[n] = sine * sine * (signal[n] - mean);
    }
    const auto spectrum = half_spectra(windowed, length);
    for (std::size_t k = 0; k < bins; ++k) powers[k] += std::norm(spectrum[k]);
  }
  const auto bin_of = [&](double frequency) {
    return std::min(static_cast<std::size_t>(std::ceil(frequency * static_cast<double>(length))), bins);
  };
  const std::size_t first = bin_of(lowest), last = bin_of(highest);
  if (first >= last) return {};
  const auto strongest = static_cast<std::size_t>(std::max_element(powers.begin() + static_cast<std::ptrdiff_t>(first),
                                                                   powers.begin() + static_cast<std::ptrdiff_t>(last)) -
                                                  powers.begin());
  std::vector<double> nearby;
  for (std::size_t k = strongest - std::min(strongest, kFarBins); k < std::min(strongest + kFarBins + 1, bins); ++k)
    if (std::max(k, strongest) - std::min(k, strongest) > kNearBins) nearby.push_back(powers[k]);
  if (nearby.empty()) return {};
  const auto middle = nearby.begin() + std::ssize(nearby) / 2;
  std::ranges::nth_element(nearby, middle);
  return {static_cast<double>(strongest) / static_cast<double>(length), powers[strongest] / std::max(*middle, 1e-300)};
}

std::vector<double> without_square_wave(std::span<const double> signal, double frequency, double exposure_rows) {
  const auto rows = static_cast<double>(signal.size());
  double mean = 0;
  for (double value : signal) mean += value / rows;
  SquareWave best{frequency, 0, 0, 0};
  const auto try_wave = [&](double tried, double phase) {
    double sum = 0, wave_sum = 0, squares = 0;
    for (std::size_t n = 0; n < signal.size(); ++n) {
      const double wave = exposed_square(tried * static_cast<double>(n) + phase, tried * exposure_rows);
      sum += wave * (signal[n] - mean);
      wave_sum += wave;
      squares += wave * wave;
    }
    squares -= wave_sum * wave_sum / rows;
    if (sum > 0 && sum * sum > best.gain * squares) best = {tried, phase, sum / squares, sum * sum / squares};
  };
  for (int f = -kSquareSteps; f <= kSquareSteps; ++f) {
    check_interrupt();
    const double tried = frequency + kSquareReach * f / (kSquareSteps * rows);
    for (double phase = 0; phase < 1; phase += 0.5 * tried) try_wave(tried, phase);  // half a row
  }
  double frequency_step = kSquareReach / (kSquareSteps * rows), phase_step = 0.5 * frequency;
  for (int halving = 0; halving < kSquareHalvings; ++halving) {
    frequency_step *= 0.5;
    phase_step *= 0.5;
    const SquareWave about = best;
    for (const double f : {-1.0, 0.0, 1.0})  // the wave turns about the middle row
      for (const double p : {-1.0, 0.0, 1.0})
        try_wave(about.frequency + f * frequency_step, about.phase + p * phase_step - 0.5 * rows * f * frequency_step);
  }
  std::vector<double> rest(signal.begin(), signal.end());
  for (std::size_t n = 0; n < rest.size(); ++n)
    rest[n] -= best.height *
               exposed_square(best.frequency * static_cast<double>(n) + best.phase, best.frequency * exposure_rows);
  return rest;
}

}  // namespace ocisac
