#include "ocisac/light/exposure_response.hpp"

#include <cmath>
#include <numbers>

#include "ocisac/core/require.hpp"

namespace ocisac {

double sinc(double x) {
  const double magnitude = std::abs(x);
  if (magnitude < 1e-9) return 1;  // 1 − (πx)²/6 rounds to 1
  // sin(πx) from the distance to the nearest whole number: nulls are exact, and large x keeps its precision.
  const double nearest = std::nearbyint(magnitude);
  const double sine = std::sin(std::numbers::pi * (magnitude - nearest));
  const bool odd = std::fmod(nearest, 2.0) != 0;
  return (odd ? -sine : sine) / (std::numbers::pi * magnitude);
}

double exposure_cycles_of_gain(double gain) {
  double low = 0, high = 1;
  for (int step = 0; step < 40; ++step) (sinc((low + high) / 2) > gain ? low : high) = (low + high) / 2;
  return low;
}

std::complex<double> exposure_response(double frequency, double exposure) {
  require_finite("frequency", frequency);
  require_not_negative("exposure", exposure);
  const double cycles = frequency * exposure;
  const double turn = std::fmod(cycles, 2.0);  // e^{−jπx} has period 2 in x
  return std::polar(1.0, -std::numbers::pi * turn) * sinc(cycles);
}

}  // namespace ocisac
