#include "tones/row_moments.hpp"

#include <array>
#include <cmath>
#include <numeric>
#include <span>

#include "ocisac/core/require.hpp"
#include "ocisac/rows/basis.hpp"

namespace ocisac {

namespace {

constexpr double kMinOscillation = 2;  // rows·|sin(x/2)|: above it, moments are exact to 4·10⁻¹⁶·rows up to power 4

// Fills in the moments of the frequency 0: sums of powers of whole or half numbers in closed form.
void fill_powers(std::size_t rows, std::span<double> moments) {
  const auto n = static_cast<double>(rows);
  const std::array sums{n, (n * n - 1) / (3 * n), (n * n - 1) * (3 * n * n - 7) / (15 * n * n * n)};
  for (std::size_t p = 0; p < moments.size(); p += 2) moments[p] = sums[p / 2];
}

void add_up(std::size_t rows, double cycles_per_row, std::span<double> moments) {
  std::vector<double> times((rows + 1) / 2), cosine(times.size()), sine(times.size());
  std::iota(times.begin(), times.end(), rows % 2 == 0 ? 0.5 : 0.0);
  fill_wave(times, cycles_per_row, cosine, sine);
  for (std::size_t i = 0; i < times.size(); ++i) {
    const double u = times[i];
    double power = u == 0 ? 1 : 2;  // the middle row once, all others on both sides
    for (std::size_t p = 0; p < moments.size(); ++p, power *= 2 * u / static_cast<double>(rows))
      moments[p] += power * (p % 2 == 0 ? cosine[i] : sine[i]);
  }
}

// sin(angle + quarters·π/2)
double turned(const Phasor& angle, std::size_t quarters) {
  const double value = quarters % 2 == 0 ? angle.sine : angle.cosine;
  return quarters % 4 < 2 ? value : -value;
}

// D(x) = sin(rows·x/2)/sin(x/2): the derivatives of D·sin(x/2) are those of sin(rows·x/2), by Leibniz' rule.
void differentiate(std::size_t rows, double cycles_per_row, std::span<double> moments) {
  const auto n = static_cast<double>(rows);
  const Phasor short_angle = phasor(cycles_per_row, 0.5), long_angle = phasor(cycles_per_row, n / 2);
  for (std::size_t p = 0; p < moments.size(); ++p) {
    double rest = turned(long_angle, p), binomial = 1, scale = 1;
    for (std::size_t i = p; i-- > 0;) {  // derivatives i of D, times (2/rows)^i
      binomial *= static_cast<double>(i + 1) / static_cast<double>(p - i);
      scale /= n;
      rest -= binomial * scale * moments[i] * turned(short_angle, p - i);
    }
    moments[p] = rest / short_angle.sine;
  }
  for (std::size_t p = 0; p < moments.size(); ++p)
    if (p % 4 == 1 || p % 4 == 2) moments[p] = -moments[p];
}

}  // namespace

RowMoments::RowMoments(std::size_t rows, double frequency, std::size_t highest, std::size_t power)
    : powers_(power + 1), values_((highest + 1) * powers_) {
  require(power <= 4, "power", power, "0 to 4");
  fill_powers(rows, std::span(values_).first(powers_));
  for (std::size_t k = 1; k <= highest; ++k) {
    const double cycles = static_cast<double>(k) * frequency;
    const std::span<double> moments = std::span(values_).subspan(k * powers_, powers_);
    if (static_cast<double>(rows) * std::abs(phasor(cycles, 0.5).sine) < kMinOscillation)
      add_up(rows, cycles, moments);
    else
      differentiate(rows, cycles, moments);
  }
}

}  // namespace ocisac
