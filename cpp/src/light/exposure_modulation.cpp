#include "ocisac/light/exposure_modulation.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/check_interrupt.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"

namespace ocisac {

namespace {

// At one frequency. PWM: the overlap of parts d and r of a period varies by min(r, d, 1 − r, 1 − d).
double modulation_at(const FlickeringLight& light, double cycles) {
  if (!light.duty) return light.depth * std::abs(sinc(cycles));
  const double duty = *light.duty, whole = std::floor(cycles), rest = cycles - whole;
  const double swing = std::min({rest, 1 - rest, duty, 1 - duty});
  const double least = whole * duty + std::max(rest + duty - 1, 0.0);
  const double total = (1 - light.depth) * cycles + light.depth * (2 * least + swing);
  return total > 0 ? light.depth * swing / total : light.depth;
}

// Cycles of the largest modulation between `whole` and the next whole number; of a tone where tan(πx) = πx.
double peak_after(const FlickeringLight& light, double whole) {
  if (light.duty) return whole + std::min(*light.duty, 1 - *light.duty);
  if (whole == 0) return 0;
  const double middle = std::numbers::pi * (whole + 0.5);
  double angle = middle;
  for (int k = 0; k < 14; ++k) angle = middle - std::atan(1 / angle);  // each divides the error by 20 or more
  return angle / std::numbers::pi;
}

// The last point from `inside`, where the modulation is at most `below`, towards `outside`.
double boundary(const FlickeringLight& light, double below, double inside, double outside) {
  for (double middle = 0.5 * (inside + outside); middle != inside && middle != outside;
       middle = 0.5 * (inside + outside))
    (modulation_at(light, middle) <= below ? inside : outside) = middle;
  return inside;
}

}  // namespace

double exposure_modulation(const FlickeringLight& light, double exposure) {
  const double low = (light.frequency - light.uncertainty) * exposure;
  const double high = (light.frequency + light.uncertainty) * exposure;
  double peak = peak_after(light, std::floor(low));
  if (peak < low) peak = peak_after(light, std::floor(low) + 1);
  const double inside = peak <= high ? modulation_at(light, peak) : 0;
  return std::max({modulation_at(light, low), modulation_at(light, high), inside});
}

std::vector<Interval> cycles_below(const FlickeringLight& light, double below, double most) {
  if (light.depth <= below) return {{0, kInfinity}};
  require(most <= kMostNulls, "bounds", shortest_text(most) + " cycles of " + shortest_text(light.frequency) + " Hz",
          "at most a million");
  std::vector<Interval> found;
  double before = peak_after(light, 0);
  for (double null = 1; null <= std::ceil(most); ++null) {
    check_interrupt();
    const double after = peak_after(light, null);
    const bool last = modulation_at(light, after) <= below;  // all later peaks are lower
    found.push_back({boundary(light, below, null, before) * (1 + kShrink),
                     last ? kInfinity : boundary(light, below, null, after) * (1 - kShrink)});
    if (last) break;
    before = after;
  }
  return found;
}

}  // namespace ocisac
