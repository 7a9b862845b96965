// Modulation of flickering light after an exposure.
//
// With x = f·T_e cycles in an exposure, a light's modulation is (max − min)/(max + min) of the mean light over the
// exposure, over all phases: |sinc(x)| for a raised cosine of full depth. It is 0 at whole x and has one maximum
// between neighbouring whole x. These maxima decrease with x for tones and for PWM of any duty. So the exposures below
// a bound are intervals about the nulls, found by bisection of monotone pieces.
#pragma once

#include <optional>
#include <vector>

namespace ocisac {

struct Interval {
  double low, high;
};

struct FlickeringLight {
  double frequency;              // Hz, > 0
  double uncertainty = 0;        // Hz, half width of the interval that contains it, 0 to below `frequency`
  std::optional<double> duty{};  // bright share of a PWM period, in (0, 1); absent: a raised cosine
  double depth = 1;              // (max − min)/(max + min) of the light itself, in (0, 1]
};

// Largest modulation over all phases and the light's frequencies, harmonics included. `exposure`: s, >= 0.
double exposure_modulation(const FlickeringLight& light, double exposure);

// Cycles in an exposure up to `most`, ascending, in which the modulation at one frequency is at most `below`; the last
// interval may be infinite. At most a million cycles.
std::vector<Interval> cycles_below(const FlickeringLight& light, double below, double most);
inline constexpr double kMostNulls = 1e6;
// Relative reduction of intervals, which keeps their ends within the bound despite rounding.
inline constexpr double kShrink = 0x1p-50;

}  // namespace ocisac
