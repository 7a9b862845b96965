#include "ocisac/chips/error_rates.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "chips/threshold_detectors.hpp"
#include "core/statistics.hpp"
#include "ocisac/chips/reduced_search.hpp"
#include "ocisac/core/require.hpp"
#include "rows/exposed_chips.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kMaxEnumerated = 8;  // number of other chips up to which all signs are enumerated
constexpr double kNegligible = 1e-7;       // relative to the gain
constexpr double kMinNoise = 1e-5;  // relative to the range of the values: smoothing of the steps of the distribution
constexpr double kHopelessNoise = 1e6;    // swings: above, every rate is 1/2 within 1e-6
constexpr double kMaxRowsPerChip = 1000;  // the time grows with its square: 0.2 s
constexpr int kPlaces = 4;                // positions of the chips relative to the rows
constexpr std::size_t kChips = 6;         // evaluated for each

double by_all_signs(double gain, std::span<const double> others, double noise) {
  double sum = 0;
  for (std::size_t word = 0; word < std::size_t{1} << others.size(); ++word) {
    double value = 0.5 * gain;
    for (std::size_t j = 0; j < others.size(); ++j) value += ((word >> j) & 1U ? 0.5 : -0.5) * others[j];
    sum += normal_tail(value / noise);
  }
  return sum / static_cast<double>(std::size_t{1} << others.size());
}

// Distribution of the value as a Fourier series; its period contains the range and eight standard deviations of noise.
double by_series(double gain, std::span<const double> others, double noise) {
  double reach = 0.5 * std::abs(gain) + 8 * noise;
  for (const double other : others) reach += 0.5 * std::abs(other);
  noise = std::max(noise, kMinNoise * reach);  // bounds the number of terms
  const double step = std::numbers::pi / reach;
  double sum = 0;
  for (double m = 1; m * step * noise < 8.5; m += 2) {
    double term = std::exp(-0.5 * std::pow(m * step * noise, 2)) * std::sin(0.5 * m * step * gain) / m;
    for (const double other : others) term *= std::cos(0.5 * m * step * other);
    sum += term;
  }
  return std::clamp(0.5 - 2 / std::numbers::pi * sum, 0.0, 1.0);
}

// At most `max_count` evenly spaced chips at least an exposure from the ends of the equations.
std::vector<std::size_t> inner_chips(const ChipEquations& equations, std::size_t max_count) {
  const std::size_t edge = std::min(2 * equations.band() + 2, equations.count() / 2);
  const std::size_t inside = equations.count() - 2 * edge,
                    count = std::min(max_count, std::max<std::size_t>(inside, 1));
  std::vector<std::size_t> chips;
  for (std::size_t k = 0; k < count; ++k) chips.push_back(std::min(edge + k * inside / count, equations.count() - 1));
  return chips;
}

// Column `chip` of A⁻¹, or of the inverse of A without the earlier chips.
std::vector<double> inverse_column(const ChipEquations& equations, std::size_t chip, bool without_earlier) {
  const std::size_t count = equations.count(), band = equations.band();
  std::vector<double> column(count, 0.0);
  // Solve Mᵀ·u = e, then D, then M·x = u/d. M is lower triangular, so Mᵀ is solved from the last chip on: entries after
  // `chip` stay 0.
  column[chip] = 1;
  if (!without_earlier)
    for (std::size_t k = chip + 1; k-- > 0;)
      for (std::size_t back = 1; back <= std::min(band, k); ++back)
        column[k - back] -= equations.feedback(k)[back] * column[k];
  for (std::size_t k = 0; k <= chip; ++k) column[k] /= equations.precision(k);
  for (std::size_t k = without_earlier ? chip : 0; k < count; ++k)
    for (std::size_t back = 1; back <= std::min(band, k); ++back)
      if (!without_earlier || k - back >= chip) column[k] -= equations.feedback(k)[back] * column[k - back];
  return column;
}

// The estimate (A⁻¹b)_k is Σ (I − 4·A⁻¹)_kj·x_j with noise of variance (A⁻¹)_kk − 4·Σ (A⁻¹)²_kj.
double linear_error_rate(const ChipEquations& equations, bool without_earlier) {
  const auto chips = inner_chips(equations, kChips);
  double sum = 0;
  for (const std::size_t chip : chips) {
    auto column = inverse_column(equations, chip, without_earlier);
    const double gain = 1 - 4 * column[chip];
    double variance = column[chip];
    for (double& value : column) {
      variance -= 4 * value * value;
      value *= 4;
    }
    column[chip] = 0;
    sum += sliced_error_rate(gain, column, std::sqrt(std::max(variance, 1e-300)));
  }
  return sum / static_cast<double>(chips.size());
}

// Error event: two sequences that differ by ±1 in some chips.
struct Difference {
  std::array<std::size_t, 4> chips;  // after the first
  std::array<int, 4> signs;
  std::size_t count;
};

// Squared distance of the rows over the noise's variance: eᵀ(A − 4I)e.
double squared_distance(const ChipEquations& equations, std::size_t chip, const Difference& difference) {
  double sum = 0;
  for (std::size_t i = 0; i < difference.count; ++i) {
    sum += equations.normal(chip + difference.chips[i], 0) - 4;
    for (std::size_t j = 0; j < i; ++j)
      sum += 2 * difference.signs[i] * difference.signs[j] *
             equations.normal(chip + difference.chips[i], difference.chips[i] - difference.chips[j]);
  }
  return std::max(sum, 0.0);
}

// Wrong chips times the probability of the pattern: n chips of which the first is free and the others are determined by
// it.
double weight(const Difference& difference) {
  const auto chips = static_cast<double>(difference.count);
  return chips * std::exp2(1 - chips);
}

double sequence_error_rate(const ChipEquations& equations, std::size_t chip) {
  const std::size_t band = equations.band();
  const std::array<Difference, 5> differences{{{{0}, {1}, 1},
                                               {{0, 1}, {1, -1}, 2},
                                               {{0, 1, 2}, {1, -1, 1}, 3},
                                               {{0, 1, band, band + 1}, {1, -1, 1, -1}, 4},
                                               {{0, 1, band - 1, band}, {1, -1, 1, -1}, 4}}};
  double sum = 0;
  for (std::size_t k = 0; k < differences.size(); ++k) {
    const Difference& difference = differences[k];
    if (difference.count == 4 && difference.chips[2] < 2) continue;
    if (chip + difference.chips[difference.count - 1] >= equations.count()) continue;
    sum += weight(difference) * normal_tail(0.5 * std::sqrt(squared_distance(equations, chip, difference)));
  }
  return std::min(sum, 0.5);
}

// Equations of rows that cover eight exposures of chips or more.
ChipEquations inner_equations(const ChipClock& clock, double noise) {
  const auto band = static_cast<std::size_t>(std::ceil(clock.exposure_rows / clock.rows_per_chip));
  const std::size_t count = 8 * band + 24;
  const double rows = static_cast<double>(count - 1) * clock.rows_per_chip - clock.exposure_rows - 1;
  const std::vector<double> values(static_cast<std::size_t>(std::max(rows, 1.0)), 0.5);
  return {{values, clock, noise, 0, count}, kLongestReducedExposure};
}

}  // namespace

double sliced_error_rate(double gain, std::span<const double> others, double noise) {
  require_finite("gain", gain);
  require_positive("noise", noise);
  std::vector<double> large;
  double small = noise * noise;
  for (const double other : others) {
    require_finite("others", other);
    if (std::abs(other) > kNegligible * std::abs(gain))
      large.push_back(other);
    else
      small += 0.25 * other * other;
  }
  const double spread = std::sqrt(small);
  return large.size() <= kMaxEnumerated ? by_all_signs(gain, large, spread) : by_series(gain, large, spread);
}

double wiener_error_rate(const ChipEquations& equations) { return linear_error_rate(equations, false); }
double feedback_error_rate(const ChipEquations& equations) { return linear_error_rate(equations, true); }

double sequence_error_rate(const ChipEquations& equations) {
  const auto chips = inner_chips(equations, 4 * kChips);
  double sum = 0;
  for (const std::size_t chip : chips) sum += sequence_error_rate(equations, chip);
  return sum / static_cast<double>(chips.size());
}

DetectorErrorRates detector_error_rates(double rows_per_chip, double exposure_rows, double noise) {
  require(rows_per_chip >= kMinRowsPerChip && rows_per_chip <= kMaxRowsPerChip, "rows_per_chip", rows_per_chip,
          "0.01 to 1000");
  require(exposure_rows >= 0 && exposure_rows <= kLongestReducedExposure * rows_per_chip, "exposure_rows",
          exposure_rows, "0 to 24 chips, in rows");
  require_positive("noise", noise);
  if (noise > kHopelessNoise) return {0.5, 0.5, 0.5, 0.5, 0.5};
  DetectorErrorRates rates{};
  for (int place = 0; place < kPlaces; ++place) {
    const ChipClock clock{rows_per_chip, -0.5 * exposure_rows - rows_per_chip * (place + 0.5) / kPlaces, exposure_rows};
    const auto equations = inner_equations(clock, noise);
    rates.slicer += slicer_error_rate(clock, noise) / kPlaces;
    rates.inverse += inverse_error_rate(clock, noise) / kPlaces;
    rates.wiener += wiener_error_rate(equations) / kPlaces;
    rates.dfe += feedback_error_rate(equations) / kPlaces;
    rates.mlse += sequence_error_rate(equations) / kPlaces;
  }
  return rates;
}

}  // namespace ocisac
