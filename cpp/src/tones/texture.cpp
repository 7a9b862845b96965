#include "tones/texture.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "ocisac/rows/basis.hpp"
#include "rows/fit.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

using Eigen::ArrayXd;
using Eigen::ArrayXXd;
using Eigen::Index;
using Eigen::Map;
using Eigen::MatrixXd;

// Orders of the lines, of the tone's frequency, and the powers of each signal there (lines × signals).
struct LinesAbout {
  ArrayXd orders;
  ArrayXXd powers;
};

constexpr int kLines = 8;  // of the spectrum, up to 8 cycles apart

double spacing_of_lines(double frequency, std::size_t rows) {
  return frequency / std::ceil(frequency * static_cast<double>(rows) / kLines);
}

LinesAbout lines_about(double frequency, std::span<const double> residuals, std::size_t height) {
  const auto rows = static_cast<double>(height);
  const double step = spacing_of_lines(frequency, height);
  std::vector<double> lines, waves;
  for (int k = 0; k < kLines && frequency + (k + 0.5) * step < 0.5; ++k) lines.push_back(frequency + (k + 0.5) * step);
  const auto count = std::ssize(lines);
  const RowSampling sampling = centred_rows(height);
  append_tones(waves, sampling, lines);
  const Map<const MatrixXd> left(residuals.data(), static_cast<Index>(height),
                                 std::ssize(residuals) / static_cast<Index>(height));
  const ArrayXXd squares = transposed_product(matrix_of(waves, sampling), left).array().square();
  return {Map<const ArrayXd>(lines.data(), count) / frequency,
          squares.reshaped(2, count * left.cols()).colwise().sum().reshaped(count, left.cols()) / rows};
}

// `powers`: means over that many signals.
Texture texture_of(const ArrayXd& orders, const ArrayXd& powers, double white, std::size_t signals) {
  Texture found{.white = white};
  const auto count = static_cast<std::size_t>(powers.size());
  if (count == 0) return found;
  const double mean = powers.mean(), freedom = 2 * static_cast<double>(signals * count);
  if (!(freedom * mean > chance_energy(2 * signals * count) * white)) return found;
  found.lines = count;
  found.flat = mean - white;
  const ArrayXd slope = orders.square().inverse();
  const auto evidence = [&](const ArrayXd& expected) { return -(expected.log() + powers / expected).sum(); };
  const ArrayXd texture = (powers - white) / slope;
  found.falling = std::max(median({texture.begin(), texture.end()}) / std::numbers::ln2, 0.0);
  found.odds =
      1 / (1 + std::exp(evidence(ArrayXd::Constant(powers.size(), mean)) - evidence(white + found.falling * slope)));
  return found;
}

double white_of(std::span<const double> residuals, std::size_t rows, std::size_t signal) {
  return noise_of_differences(residuals.subspan(signal * rows, rows));
}

}  // namespace

double Texture::chance(std::span<const double> powers, std::span<const std::size_t> orders) const {
  if (lines == 0) return 0;
  double of_flat = 0, of_falling = 0;  // Σ over the expected powers
  for (std::size_t i = 0; i < powers.size(); ++i) {
    const auto order = static_cast<double>(orders[i]);
    of_flat += powers[i] / (white + flat);
    of_falling += powers[i] / (white + falling / (order * order));
  }
  const auto count = static_cast<double>(lines);
  const auto tail = [&](double sum) { return chance_of_share(sum / (count + sum), powers.size(), 2 * count); };
  return odds * tail(of_falling) + (1 - odds) * tail(of_flat);
}

std::size_t orders_about(double frequency, std::size_t rows) {
  return 1 + static_cast<std::size_t>(std::lround(kLines * spacing_of_lines(frequency, rows) / frequency));
}

std::vector<Texture> textures_about(double frequency, std::span<const double> residuals, std::size_t rows) {
  const LinesAbout about = lines_about(frequency, residuals, rows);
  std::vector<Texture> found(residuals.size() / rows);
  for (std::size_t s = 0; s < found.size(); ++s)
    found[s] = texture_of(about.orders, about.powers.col(static_cast<Index>(s)), white_of(residuals, rows, s), 1);
  return found;
}

Texture texture_about(double frequency, std::span<const double> residuals, std::size_t rows) {
  const LinesAbout about = lines_about(frequency, residuals, rows);
  const std::size_t signals = residuals.size() / rows;
  double white = 0;
  for (std::size_t s = 0; s < signals; ++s) white += white_of(residuals, rows, s) / static_cast<double>(signals);
  return texture_of(about.orders, about.powers.rowwise().mean(), white, signals);
}

}  // namespace ocisac
