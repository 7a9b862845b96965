// Exposures at which flickering lights leave no bands.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "ocisac/core/constants.hpp"
#include "ocisac/exposure/best_exposure.hpp"
#include "ocisac/light/exposure_modulation.hpp"

namespace ocisac {

struct FlickerFreeRequest {
  double below = 0.02;                       // bound of the modulation, in (0, 1)
  std::optional<double> near{};              // s: the nearest to it instead of the shortest or of eq. 18
  Interval bounds{0, 0.1};                   // s
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

// Exposures in s within ascending intervals at which no light's modulation exceeds `below`; if there are none, those at
// the smallest bound that has any. Exposures and frequencies interchange.
std::vector<Interval> flicker_free_intervals(std::span<const FlickeringLight> lights, double below,
                                             const std::vector<Interval>& within);

// The nearest, the shortest, or the exposure of largest Y (with f_sense, or f_comm without min_gain) at which no
// light's modulation exceeds the bound. If there is none: the smallest modulation among the exposures that keep the
// data light's gain; if none keeps it, the smallest of all. Throws std::invalid_argument, also where every exposure
// satisfies the bound, so that none is the shortest.
FlickerFreeExposure flicker_free_exposure(std::span<const FlickeringLight> lights, const FlickerFreeRequest& request);

}  // namespace ocisac
