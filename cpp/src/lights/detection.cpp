#include "lights/detection.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include "core/levels.hpp"
#include "ocisac/columns/column_combination.hpp"

namespace ocisac {

namespace {

constexpr double kFrequencyApart = 0.04;  // relative: parts that differ by more belong to a light that sends data
constexpr double kSettledCycles = 5;

bool one_frequency(double f, double g) { return std::abs(f - g) <= kFrequencyApart * std::max(f, g); }

// Approximate total flux of the box.
double flux(const RefinedLight& light) { return light.amplitude * static_cast<double>(light.box.pixels()); }

double strength(const Detection& one) {
  return one.light.amplitude * std::sqrt(static_cast<double>(one.light.box.pixels()));
}

double middle(const RefinedLight& light) {
  return static_cast<double>(light.box.y) + 0.5 * static_cast<double>(light.box.height);
}

// Standard error of the stronger light's phase at the centre of the weaker one, where the error of its own frequency
// does not matter, rad.
double phase_spread(const RefinedLight& weak, const RefinedLight& strong) {
  return kTwoPi * std::abs(middle(weak) - middle(strong)) * strong.frequency_std + 0.3;
}

// A faint light in few rows may be a mixture of reflections: it has another frequency where its rows tell both apart.
bool may_be_mixed(const RefinedLight& weak, const RefinedLight& strong) {
  return flux(weak) < kNextToNone * flux(strong) &&
         std::abs(weak.frequency - strong.frequency) * static_cast<double>(weak.box.height) < kMostly;
}

bool is_reflection(const RefinedLight& weak, const RefinedLight& strong) {
  if (!same_frequency(weak, strong) && !may_be_mixed(weak, strong)) return false;
  if (flux(weak) > kMostly * flux(strong)) return false;
  const double spread = phase_spread(weak, strong);
  const double apart =
      std::remainder(weak.phase - strong.phase + kTwoPi * middle(weak) * (weak.frequency - strong.frequency), kTwoPi);
  return spread >= 1 || std::abs(apart) <= 3 * spread;
}

IndexRange columns_of(const Region& box) { return {box.x, box.right()}; }
IndexRange rows_of(const Region& box) { return {box.y, box.bottom()}; }
IndexRange common(const IndexRange& a, const IndexRange& b) {
  return {std::max(a.begin, b.begin), std::min(a.end, b.end)};
}

}  // namespace

bool one_light_across(const LitFrame& frame, const Region& a, const Region& b, double frequency) {
  const auto& [left, right] = std::minmax(a, b, [](const Region& one, const Region& other) { return one.x < other.x; });
  const std::size_t length = hann_length(frequency);
  const IndexRange rows = common(rows_of(left), rows_of(right));
  const IndexRange between{left.right(), right.x};
  const std::size_t overlap = between.begin > between.end ? between.begin - between.end : 0;
  if (2 * rows.size() < std::min(left.height, right.height) || rows.size() == 0 ||
      between.size() > std::max(left.width, right.width) || 2 * overlap > std::min(left.width, right.width))
    return false;
  const auto one = mean_swing(frame, columns_of(left), rows, length);
  const auto other = mean_swing(frame, columns_of(right), rows, length);
  if (likeness(one, other) < kTogether) return false;
  return between.size() == 0 || likeness(one, mean_swing(frame, between, rows, length)) >= kTogether;
}

double likeness_of_frames(LitFrame frame, std::size_t other, const RefinedLight& light) {
  const std::size_t length = hann_length(light.frequency);
  const auto here = mean_swing(frame, columns_of(light.box), rows_of(light.box), length);
  frame.index = other;
  return likeness(here, mean_swing(frame, columns_of(light.box), rows_of(light.box), length));
}

bool is_tone(const Detection& one) { return one.data ? one.light.only_tone : one.light.periodic >= kPeriodic; }

bool is_settled(const Detection& one) {
  const double cycles = static_cast<double>(one.light.box.height) * one.light.frequency;
  return one.data || one.expected || (is_tone(one) && cycles >= kSettledCycles);
}

bool same_frequency(const RefinedLight& weak, const RefinedLight& strong) {
  const double spread = 3 * std::hypot(weak.frequency_std, strong.frequency_std) + 0.002 * strong.frequency;
  return std::abs(weak.frequency - strong.frequency) <= spread;
}

bool near_frequency(double suspected, double frequency) { return std::abs(suspected - frequency) <= 0.25 * frequency; }

bool covers(const Region& box, const Region& part) { return 2 * shared_pixels(part, box) > part.pixels(); }

bool is_explained(const Suspect& suspect, const RefinedLight& light) {
  return covers(widened(light.box, static_cast<std::size_t>(std::lround(1 / light.frequency))), suspect.box);
}

bool contains(const Suspect& suspect, const RefinedLight& light) {
  return 2 * shared_pixels(suspect.box, light.box) > light.box.pixels() &&
         near_frequency(suspect.frequency, light.frequency);
}

bool are_doubles(const Detection& a, const Detection& b) {
  return shared_of_smaller(a.light.box, b.light.box) > 0.5 &&
         !(a.expected && b.expected && !one_frequency(a.light.frequency, b.light.frequency));
}

bool is_double_of_any(const Detection& one, const std::vector<Detection>& others) {
  return std::ranges::any_of(others, [&](const Detection& other) { return are_doubles(one, other); });
}

std::vector<Detection> without_doubles(std::vector<Detection> found) {
  std::ranges::stable_sort(found, std::greater{}, strength);
  std::vector<Detection> kept;
  for (const Detection& one : found) {
    const auto twin = std::ranges::find_if(kept, [&](const Detection& other) { return are_doubles(one, other); });
    if (twin == kept.end())
      kept.push_back(one);
    else
      ++twin->merged;
  }
  return kept;
}

std::vector<Detection> with_joined_parts(const LitFrame& frame, std::vector<Detection> found) {
  for (std::size_t i = 0; i < found.size(); ++i)
    for (std::size_t k = i + 1; k < found.size();) {
      Detection &one = found[i], &other = found[k];
      const double slower = std::min(one.light.frequency, other.light.frequency);
      if (!one_light_across(frame, one.box, other.box, slower)) {
        ++k;
        continue;
      }
      one.expected = one.expected || other.expected;
      one.probability = std::max(one.probability, other.probability);
      one.data = one.data || other.data || !one_frequency(one.light.frequency, other.light.frequency);
      one.merged += 1 + other.merged;
      one.joined = true;
      one.box = hull(one.box, other.box);
      found.erase(found.begin() + static_cast<std::ptrdiff_t>(k));
      k = i + 1;
    }
  return found;
}

std::vector<Detection> with_reflections(std::vector<Detection> found) {
  for (std::size_t i = 1; i < found.size(); ++i)
    for (std::size_t k = 0; k < i && !found[i].reflection_of && !found[i].expected; ++k) {
      if (found[k].reflection_of || !is_reflection(found[i].light, found[k].light)) continue;
      found[i].reflection_of = k;
      found[i].reflection_by_phase = phase_spread(found[i].light, found[k].light) < 1;
    }
  return found;
}

std::vector<Detection> by_probability(const std::vector<Detection>& found) {
  std::vector<std::size_t> order(found.size()), place(found.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, std::greater{}, [&](std::size_t i) { return found[i].probability; });
  for (std::size_t k = 0; k < order.size(); ++k) place[order[k]] = k;
  std::vector<Detection> sorted;
  for (const std::size_t i : order) {
    sorted.push_back(found[i]);
    if (auto& of = sorted.back().reflection_of) of = place[*of];
  }
  return sorted;
}

}  // namespace ocisac
