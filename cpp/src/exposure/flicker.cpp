#include "ocisac/exposure/flicker.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <tuple>
#include <utility>

#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"

namespace ocisac {

namespace {

using Intervals = std::vector<Interval>;

void check(const FlickeringLight& light) {
  require_positive("frequency", light.frequency);
  require(light.uncertainty >= 0 && light.uncertainty < light.frequency, "uncertainty", light.uncertainty,
          "0 to below " + shortest_text(light.frequency) + " (Hz)");
  require(!light.duty || (*light.duty > 0 && *light.duty < 1), "duty", light.duty.value_or(0), "above 0 and below 1");
  require(light.depth > 0 && light.depth <= 1, "depth", light.depth, "above 0, at most 1");
}

double largest_modulation(std::span<const FlickeringLight> lights, double exposure) {
  double largest = 0;
  for (const FlickeringLight& light : lights) largest = std::max(largest, exposure_modulation(light, exposure));
  return largest;
}

// Intersects two ascending lists of disjoint intervals.
Intervals intersection(const Intervals& first, const Intervals& second) {
  Intervals both;
  for (auto a = first.begin(), b = second.begin(); a != first.end() && b != second.end(); a->high < b->high ? ++a : ++b)
    if (const Interval part{std::max(a->low, b->low), std::min(a->high, b->high)}; part.low <= part.high)
      both.push_back(part);
  return both;
}

// Exposures in s within `low` … `high` at which the light's modulation is at most `below`.
Intervals exposures_below(const FlickeringLight& light, double below, double low, double high) {
  const double slow = light.frequency - light.uncertainty, fast = light.frequency + light.uncertainty;
  Intervals intervals = cycles_below(light, below, fast * high);
  for (Interval& one : intervals) one = {one.low / slow, one.high / fast};
  return intersection(intervals, {{low, high}});
}

Intervals all_below(std::span<const FlickeringLight> lights, double below, Intervals every) {
  for (const FlickeringLight& light : lights)
    if (!every.empty())
      every = intersection(every, exposures_below(light, below, every.front().low, every.back().high));
  return every;
}

std::vector<double> multiples(const Intervals& every, double step) {
  require_positive("step", step);
  require(every.back().high / step <= kMostCandidates, "step", step,
          "at most 10 million multiples up to " + shortest_text(every.back().high) + " s");
  std::vector<double> grid;
  double next = 1;
  for (const Interval& one : every) {
    next = std::max(next, std::ceil(one.low / step * (1 - kShrink)));
    for (const double last = std::floor(one.high / step * (1 + kShrink)); next <= last; ++next)
      grid.push_back(next * step);
  }
  return grid;
}

// Multiples of the step that satisfy the bound, as intervals of length 0, or those of the smallest modulation.
Intervals multiples_allowed(std::span<const FlickeringLight> lights, double below, const Intervals& every,
                            double step) {
  const std::vector<double> grid = multiples(every, step);
  require(!grid.empty(), "step", step,
          "a step with a multiple between " + shortest_text(every.front().low) + " and " +
              shortest_text(every.back().high));
  std::vector<double> left;
  for (const double exposure : grid) {
    check_interrupt();
    left.push_back(largest_modulation(lights, exposure));
  }
  const double least = *std::ranges::min_element(left);
  Intervals allowed;
  for (std::size_t k = 0; k < grid.size(); ++k)
    if (left[k] <= std::max(below, least)) allowed.push_back({grid[k], grid[k]});
  return allowed;
}

// Exposures that keep the gain of the data light: those between its valleys; all if there are none.
Intervals keeping(double f_comm, double min_gain, const Intervals& every, std::optional<double> step) {
  Intervals between;
  double begin = 0;
  for (const Interval& valley : cycles_below({f_comm}, min_gain, f_comm * every.back().high + 1)) {
    if (begin < valley.low / f_comm) between.push_back({begin, valley.low / f_comm});
    begin = valley.high / f_comm;
  }
  if (begin < kInfinity) between.push_back({begin, kInfinity});
  // Undoes kShrink: the ends keep the gain.
  for (Interval& one : between) one = {one.low * (1 - 4 * kShrink), one.high * (1 + 4 * kShrink)};
  const Intervals kept = intersection(between, every);
  return !kept.empty() && (!step || !multiples(kept, *step).empty()) ? kept : every;
}

double nearest(const Intervals& allowed, double near) {
  double best = kInfinity;
  for (const Interval& one : allowed)
    if (const double tried = std::clamp(near, one.low, one.high); std::abs(tried - near) < std::abs(best - near))
      best = tried;
  return best;
}

double shortest(const Intervals& allowed) {
  require(allowed.front().low != 0, "bounds", "0 as the shortest", "above 0 (s), since every short exposure holds");
  return allowed.front().low;
}

// Exposure of largest Y within the intervals; of equals, the shortest.
BestExposure largest_objective(const Intervals& allowed, std::span<const double> tones, std::span<const double> weights,
                               bool stepped) {
  std::vector<double> exposures;
  for (const Interval& one : allowed) {
    exposures.push_back(one.low);
    if (stepped) continue;
    exposures.push_back(one.high);
    if (one.high > one.low) exposures.push_back(best_exposure_exact(tones, weights, {one, std::nullopt}).exposure);
  }
  std::ranges::sort(exposures);
  BestExposure best{0, -1};
  for (const double exposure : exposures)
    if (const double value = exposure > 0 ? exposure_objective(tones, weights, exposure) : -1; value > best.objective)
      best = {exposure, value};
  return best;
}

void check(std::span<const FlickeringLight> lights, const FlickerFreeRequest& request) {
  require(!lights.empty(), "lights", "none", "at least one");
  for (const FlickeringLight& light : lights) check(light);
  require(request.below > 0 && request.below < 1, "below", request.below, "above 0 and below 1");
  for (const auto& [name, value, unit] :
       {std::tuple{"near", request.near, "s"}, {"f_comm", request.f_comm, "Hz"}, {"f_sense", request.f_sense, "Hz"}})
    require(!value || (std::isfinite(*value) && *value > 0), name, value.value_or(0),
            std::string("a finite number above 0 (") + unit + ")");
  require(!request.min_gain || (*request.min_gain > 0 && *request.min_gain < 1), "min_gain",
          request.min_gain.value_or(0), "above 0 and below 1");
  for (const FlickeringLight& light : lights)
    require(!request.f_comm || std::abs(*request.f_comm - light.frequency) > light.uncertainty, "f_comm",
            request.f_comm.value_or(0), "none of the lights to avoid");
  require(request.f_comm || (!request.f_sense && !request.min_gain), "f_comm", "None",
          "a frequency (Hz), needed for f_sense and min_gain");
  const auto& [low, high] = request.bounds;
  require(low >= 0 && low <= high && high < kInfinity && high > 0, "bounds",
          shortest_text(low) + " to " + shortest_text(high), "0 <= shortest <= longest, above 0 (s)");
}

}  // namespace

std::vector<Interval> flicker_free_intervals(std::span<const FlickeringLight> lights, double below,
                                             const std::vector<Interval>& within) {
  Intervals found = all_below(lights, below, within);
  if (!found.empty()) return found;
  double fails = below, holds = 1;
  found = all_below(lights, holds, within);
  while (holds - fails > 1e-12 * holds) {
    check_interrupt();
    const double middle = 0.5 * (fails + holds);
    if (Intervals some = all_below(lights, middle, within); some.empty())
      fails = middle;
    else
      holds = middle, found = std::move(some);
  }
  return found;
}

FlickerFreeExposure flicker_free_exposure(std::span<const FlickeringLight> lights, const FlickerFreeRequest& request) {
  check(lights, request);
  Intervals kept{request.bounds};
  if (request.min_gain) kept = keeping(*request.f_comm, *request.min_gain, kept, request.step);
  const Intervals allowed = request.step ? multiples_allowed(lights, request.below, kept, *request.step)
                                         : flicker_free_intervals(lights, request.below, kept);
  FlickerFreeExposure result;
  if (!request.near && request.f_comm && (!request.min_gain || request.f_sense)) {
    std::vector<double> tones{*request.f_comm}, weights{request.f_sense ? request.comm_weight : 1};
    if (request.f_sense) {
      tones.push_back(*request.f_sense);
      weights.push_back(request.sense_weight);
    }
    const BestExposure best = largest_objective(allowed, tones, weights, request.step.has_value());
    result.exposure = best.exposure;
    result.objective = std::max(best.objective, 0.0);
  } else {
    result.exposure = request.near ? nearest(allowed, *request.near) : shortest(allowed);
  }
  for (const FlickeringLight& light : lights) result.modulations.push_back(exposure_modulation(light, result.exposure));
  result.modulation = *std::ranges::max_element(result.modulations);
  if (request.f_comm) result.gain = std::abs(sinc(*request.f_comm * result.exposure));
  result.holds = result.modulation <= request.below && !(result.gain < (1 - kEqual) * request.min_gain.value_or(0));
  return result;
}

}  // namespace ocisac
