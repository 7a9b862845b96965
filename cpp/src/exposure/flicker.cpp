#include "ocisac/exposure/flicker.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>
#include <utility>

#include "core/check_interrupt.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"

namespace ocisac {

namespace {

using Intervals = std::vector<Interval>;

constexpr double kMostNulls = 1e6;
// Relative reduction of intervals, which keeps their ends within the bound despite rounding.
constexpr double kShrink = 0x1p-50;

void check(const FlickeringLight& light) {
  require_positive("frequency", light.frequency);
  require(light.uncertainty >= 0 && light.uncertainty < light.frequency, "uncertainty", light.uncertainty,
          "0 to below " + shortest_text(light.frequency) + " (Hz)");
  require(!light.duty || (*light.duty > 0 && *light.duty < 1), "duty", light.duty.value_or(0), "above 0 and below 1");
  require(light.depth > 0 && light.depth <= 1, "depth", light.depth, "above 0, at most 1");
}

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

struct Allowed {
  Intervals intervals;
  bool holds;
};

// Those at `below`, or else those at the smallest level that has any.
Allowed smallest_level(double below, const std::function<Intervals(double)>& found_at) {
  if (Intervals found = found_at(below); !found.empty()) return {std::move(found), true};
  double fails = below, holds = 1;
  Intervals found = found_at(1);
  while (holds - fails > 1e-12 * holds) {
    check_interrupt();
    const double middle = 0.5 * (fails + holds);
    if (Intervals some = found_at(middle); some.empty())
      fails = middle;
    else
      holds = middle, found = std::move(some);
  }
  return {std::move(found), false};
}

std::vector<double> multiples(const Intervals& every, double step) {
  require_positive("step", step);
  require(every.back().high / step <= kMostCandidates, "step", step,
          "at most 10 million multiples up to " + shortest_text(every.back().high) + " s");
  std::vector<double> grid;
  double next = 1;
  for (const Interval& one : every) {
    next = std::max(next, std::ceil(one.low / step * (1 - 1e-15)));
    for (const double last = std::floor(one.high / step * (1 + 1e-15)); next <= last; ++next)
      grid.push_back(next * step);
  }
  return grid;
}

// Multiples of the step that satisfy the bound, as intervals of length 0, or those of the smallest modulation.
Allowed multiples_allowed(std::span<const FlickeringLight> lights, double below, const Intervals& every, double step) {
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
  Allowed allowed{{}, least <= below};
  for (std::size_t k = 0; k < grid.size(); ++k)
    if (left[k] <= std::max(below, least)) allowed.intervals.push_back({grid[k], grid[k]});
  return allowed;
}

// Exposures that keep the gain of the data light: those between its valleys; all, and false, if there are none.
Allowed keeping(double f_comm, double min_gain, const ExposureDomain::Bounds& bounds, std::optional<double> step) {
  const Intervals every{{bounds.low, bounds.high}};
  Intervals between;
  double begin = 0;
  for (const Interval& valley : cycles_below({f_comm}, min_gain, f_comm * bounds.high + 1)) {
    if (begin < valley.low / f_comm) between.push_back({begin, valley.low / f_comm});
    begin = valley.high / f_comm;
  }
  if (begin < kInfinity) between.push_back({begin, kInfinity});
  // Undoes kShrink: the ends keep the gain.
  for (Interval& one : between) one = {one.low * (1 - 4 * kShrink), one.high * (1 + 4 * kShrink)};
  const Intervals kept = intersection(between, every);
  if (!kept.empty() && (!step || !multiples(kept, *step).empty())) return {kept, true};
  return {every, false};
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
  Intervals found;
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

FlickerFreeExposure flicker_free_exposure(std::span<const FlickeringLight> lights, const FlickerFreeRequest& request) {
  check(lights, request);
  Allowed kept{{{request.bounds.low, request.bounds.high}}, true};
  if (request.min_gain) kept = keeping(*request.f_comm, *request.min_gain, request.bounds, request.step);
  const Allowed allowed =
      request.step
          ? multiples_allowed(lights, request.below, kept.intervals, *request.step)
          : smallest_level(request.below, [&](double level) { return all_below(lights, level, kept.intervals); });
  FlickerFreeExposure result;
  if (!request.near && request.f_comm && (!request.min_gain || request.f_sense)) {
    std::vector<double> tones{*request.f_comm}, weights{request.f_sense ? request.comm_weight : 1};
    if (request.f_sense) {
      tones.push_back(*request.f_sense);
      weights.push_back(request.sense_weight);
    }
    const BestExposure best = largest_objective(allowed.intervals, tones, weights, request.step.has_value());
    result.exposure = best.exposure;
    result.objective = std::max(best.objective, 0.0);
  } else {
    result.exposure = request.near ? nearest(allowed.intervals, *request.near) : shortest(allowed.intervals);
  }
  for (const FlickeringLight& light : lights) result.modulations.push_back(exposure_modulation(light, result.exposure));
  result.modulation = *std::ranges::max_element(result.modulations);
  result.holds = allowed.holds && kept.holds;
  if (request.f_comm) result.gain = std::abs(sinc(*request.f_comm * result.exposure));
  return result;
}

}  // namespace ocisac
