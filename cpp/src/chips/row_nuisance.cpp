#include "ocisac/chips/row_nuisance.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "chips/channel_equations.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kStepsPerLine = 4;  // frequency steps per width of a frame's spectral line
constexpr Index kSwingTerms = 3;
constexpr int kSquareSteps = 12;
constexpr double kSquareReach = 0.6;  // spectral lines of a frame

// Columns of slow light and tones; the constant comes first.
MatrixXd nuisance_columns(std::size_t rows, const RowNuisance& nuisance, std::size_t harmonics) {
  const auto count = static_cast<double>(rows);
  const auto slow = static_cast<Index>(std::ceil(2 * count * nuisance.slow));
  std::vector<double> frequencies;
  for (const double tone : nuisance.tones)
    for (std::size_t harmonic = 1; harmonic <= harmonics; ++harmonic)
      if (static_cast<double>(harmonic) * tone < 0.5) frequencies.push_back(static_cast<double>(harmonic) * tone);
  MatrixXd columns(static_cast<Index>(rows), 1 + slow + 2 * static_cast<Index>(frequencies.size()));
  for (Index n = 0; n < columns.rows(); ++n) {
    const auto row = static_cast<double>(n);
    for (Index k = 0; k <= slow; ++k)
      columns(n, k) = std::cos(0.5 * kTurn * static_cast<double>(k) * (row + 0.5) / count);
    Index column = slow + 1;
    for (const double frequency : frequencies) {
      const double angle = kTurn * frequency * row;
      columns(n, column++) = std::cos(angle);
      columns(n, column++) = std::sin(angle);
    }
  }
  return columns;
}

}  // namespace

std::optional<NuisanceFit> remove_nuisance(std::span<const double> signal, const RowNuisance& nuisance,
                                           std::span<const double> exposed) {
  const MatrixXd columns = nuisance_columns(signal.size(), nuisance, exposed.empty() ? 1 : kToneHarmonics);
  const Index swings = exposed.empty() ? 0 : kSwingTerms;
  MatrixXd model(columns.rows(), columns.cols() + swings);
  model.leftCols(columns.cols()) = columns;
  for (Index n = 0; n < model.rows() && swings > 0; ++n) {
    const double x = along_frame(static_cast<double>(n), signal.size());
    for (Index k = 0; k < swings; ++k)
      model(n, columns.cols() + k) = exposed[static_cast<std::size_t>(n)] * std::pow(x, static_cast<double>(k));
  }
  if (model.rows() <= model.cols()) return std::nullopt;
  const Eigen::Map<const VectorXd> values(signal.data(), model.rows());
  const auto solved = solve_normal(model.transpose() * model, model.transpose() * values);
  if (!solved) return std::nullopt;
  const VectorXd rest = values - columns.rightCols(columns.cols() - 1) * solved->values.segment(1, columns.cols() - 1);
  return NuisanceFit{{rest.begin(), rest.end()}, (values - model * solved->values).squaredNorm()};
}

StrongestTone strongest_tone(std::span<const double> signal, double lowest, double highest) {
  const double step = 1 / (kStepsPerLine * static_cast<double>(signal.size()));
  double mean = 0;
  for (double value : signal) mean += value / static_cast<double>(signal.size());
  std::vector<double> powers;
  StrongestTone strongest;
  for (double frequency = lowest; frequency < highest; frequency += step) {
    const auto turn = std::polar(1.0, -kTurn * frequency);
    std::complex<double> phase = 1, sum = 0;
    for (std::size_t n = 0; n < signal.size(); ++n, phase *= turn) {
      const double window = std::sin(0.5 * kTurn * (static_cast<double>(n) + 0.5) / static_cast<double>(signal.size()));
      sum += window * window * (signal[n] - mean) * phase;
    }
    powers.push_back(std::norm(sum));
    if (powers.back() > strongest.prominence) strongest = {frequency, powers.back()};
  }
  if (powers.empty()) return {};
  std::ranges::nth_element(powers, powers.begin() + static_cast<std::ptrdiff_t>(powers.size() / 2));
  strongest.prominence /= std::max(powers[powers.size() / 2], 1e-300);
  return strongest;
}

std::vector<double> without_square_wave(std::span<const double> signal, double frequency) {
  const auto rows = static_cast<double>(signal.size());
  const auto square = [](double cycles) { return cycles - std::floor(cycles) < 0.5 ? 0.5 : -0.5; };
  double mean = 0, best_gain = 0, best_height = 0, best_frequency = frequency, best_phase = 0;
  for (double value : signal) mean += value / rows;
  for (int f = -kSquareSteps; f <= kSquareSteps; ++f) {
    const double tried = frequency + kSquareReach * f / (kSquareSteps * rows);
    for (double phase = 0; phase < 1; phase += 0.5 * tried) {  // half a row
      double sum = 0, square_sum = 0;
      for (std::size_t n = 0; n < signal.size(); ++n) {
        const double wave = square(tried * static_cast<double>(n) + phase);
        sum += wave * (signal[n] - mean);
        square_sum += wave;
      }
      const double squares = 0.25 * rows - square_sum * square_sum / rows;
      if (sum > 0 && sum * sum / squares > best_gain) {
        best_gain = sum * sum / squares;
        best_height = sum / squares;
        best_frequency = tried;
        best_phase = phase;
      }
    }
  }
  std::vector<double> rest(signal.begin(), signal.end());
  for (std::size_t n = 0; n < rest.size(); ++n)
    rest[n] -= best_height * square(best_frequency * static_cast<double>(n) + best_phase);
  return rest;
}

}  // namespace ocisac
