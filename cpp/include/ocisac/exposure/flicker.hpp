// Exposures at which flickering lights leave no bands.
//
// With x = f·T_e cycles in an exposure, a light's modulation is (max − min)/(max + min) of the mean light over the
// exposure, over all phases: |sinc(x)| for a raised cosine of full depth. It is 0 at whole x and has one maximum
// between neighbouring whole x. These maxima decrease with x for tones and for PWM of any duty. So the exposures below
// a bound are intervals about the nulls, found by bisection of monotone pieces.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/core/constants.hpp"
#include "ocisac/exposure/best_exposure.hpp"

namespace ocisac {

struct FlickeringLight {
  double frequency;              // Hz, > 0
  double uncertainty = 0;        // Hz, half width of the interval that contains it, 0 to below `frequency`
  std::optional<double> duty{};  // bright share of a PWM period, in (0, 1); absent: a raised cosine
  double depth = 1;              // (max − min)/(max + min) of the light itself, in (0, 1]
};

// Largest modulation over all phases and the light's frequencies, harmonics included. `exposure`: s, >= 0.
double exposure_modulation(const FlickeringLight& light, double exposure);

using Interval = ExposureDomain::Bounds;

// Cycles in an exposure up to `most`, ascending, in which the modulation at one frequency is at most `below`; the last
// interval may be infinite. At most a million cycles.
std::vector<Interval> cycles_below(const FlickeringLight& light, double below, double most);

struct FlickerFreeRequest {
  double below = 0.02;                       // bound of the modulation, in (0, 1)
  std::optional<double> near{};              // s: the nearest to it instead of the shortest or of eq. 18
  ExposureDomain::Bounds bounds{0, 0.1};     // s
  std::optional<double> step{};              // s: only whole multiples of it
  std::optional<double> f_comm{};            // Hz, of a data light
  std::optional<double> f_sense{};           // Hz, f_x·v; needs f_comm
  std::optional<double> min_gain{};          // of the data light, in (0, 1); needs f_comm
  double comm_weight = 1, sense_weight = 1;  // of eq. 18
};

struct FlickerFreeExposure {
  double exposure = 0;              // s
  double modulation = 0;            // the largest of any light
  bool holds = false;               // no modulation is above the bound and the data light keeps its gain
  std::vector<double> modulations;  // (lights)
  double objective = kNaN;          // Y(exposure), s; NaN if it was not maximised
  double gain = kNaN;               // |sinc(f_comm·exposure)|; NaN without a data light
};

// The nearest, the shortest, or the exposure of largest Y (with f_sense, or f_comm without min_gain) at which no
// light's modulation exceeds the bound. If there is none: the smallest modulation among the exposures that keep the
// data light's gain; if none keeps it, the smallest of all. Throws std::invalid_argument, also where every exposure
// satisfies the bound, so that none is the shortest.
FlickerFreeExposure flicker_free_exposure(std::span<const FlickeringLight> lights, const FlickerFreeRequest& request);

}  // namespace ocisac
