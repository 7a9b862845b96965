#include "chips/lamp_chips.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace ocisac {

namespace {

constexpr std::size_t kMinChips = 24;
constexpr double kOutlier = 8;           // nats: the largest cost of a distance
constexpr std::size_t kMinBeyond = 3;    // the first value is the level, with which others agree
constexpr double kSure = 0.05;           // probability that a chip taken for the lamp's is none
constexpr double kMedianSquare = 0.455;  // of a squared normal variable
constexpr double kMinNoise = 0.02;       // of the swing: levels are no more exact where chips are few
constexpr double kMaxSlow = 1.0 / 16;    // cycles per chip: what varies faster may be chips

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

// Light that changes along a line whose slope changes at random (integrated random walk).
struct Course {
  double slope = 0;   // standard deviation of the first slope, per chip
  double change = 0;  // standard deviation of the slope's change from chip to chip
};

// Costs (nats) of the last n chips as light of this course, n = 0 … size: squared innovations of a Kalman filter, and
// the logarithm of their variance relative to the noise. An outlier does not move the state.
std::vector<double> costs_from_end(std::span<const double> values, double noise, const Course& course) {
  std::vector<double> costs(values.size() + 1, 0.0);
  double level = values.back(), slope = 0;
  std::array<double, 3> p{noise * noise, 0, course.slope * course.slope};  // covariance: level, both, slope
  for (std::size_t n = 1; n < values.size(); ++n) {
    level += slope;
    p = {p[0] + 2 * p[1] + p[2], p[1] + p[2], p[2] + course.change * course.change};
    const double variance = p[0] + noise * noise;
    const double innovation = values[values.size() - 1 - n] - level, square = innovation * innovation / variance;
    costs[n + 1] = costs[n] + std::min(0.5 * square, kOutlier) + 0.5 * std::log(variance / (noise * noise));
    if (0.5 * square > kOutlier) continue;
    const double gain = p[0] / variance, slope_gain = p[1] / variance;
    level += gain * innovation;
    slope += slope_gain * innovation;
    p = {(1 - gain) * p[0], (1 - gain) * p[1], p[2] - slope_gain * p[1]};
  }
  return costs;
}

// Cost of each dark chip given the number of equal ones before it, by the share of chips with at least as many before
// them that ended their run (estimator of Krichevsky and Trofimov). The first and the last run may be those of dark
// rows. Bright chips cost nothing: a long run of them is the lamp's.
std::vector<double> costs_of_bits(std::span<const std::uint8_t> bits) {
  std::vector<std::size_t> position(bits.size(), 1);  // in its run
  for (std::size_t k = 1; k < bits.size(); ++k)
    if (bits[k] == bits[k - 1]) position[k] = position[k - 1] + 1;
  // Runs of at least a length, and their chips from there on.
  std::vector<double> ended(bits.size() + 2), reached(bits.size() + 2);
  const auto first = std::ranges::find(position.begin() + 1, position.end(), 1) - position.begin();
  for (auto k = static_cast<std::size_t>(first); k + 1 < bits.size(); ++k)
    if (position[k + 1] == 1) {
      for (std::size_t length = 1; length <= position[k]; ++length) {
        ended[length] += 1;
        reached[length] += static_cast<double>(position[k] - length + 1);
      }
    }
  std::vector<double> costs(bits.size(), std::numbers::ln2);
  for (std::size_t k = 1; k < bits.size(); ++k) {
    const std::size_t before = position[k - 1];
    const double ends = (ended[before] + 0.5) / (reached[before] + 1);
    costs[k] = -std::log(position[k] == 1 ? ends : 1 - ends);
  }
  for (std::size_t k = 0; k < bits.size(); ++k)
    if (bits[k]) costs[k] = 0;
  return costs;
}

// Number of chips at the end that are not surely the lamp's; `costs`: of each chip as one of the lamp.
std::size_t chips_beyond(std::span<const double> values, std::span<const double> costs, double noise, double swing,
                         double slow) {
  const double turn = 2 * std::numbers::pi * std::min(slow, kMaxSlow), amplitude = 0.5 * swing;
  const auto steady = costs_from_end(values, noise, {amplitude / static_cast<double>(values.size()), 0});
  const auto varying = costs_from_end(values, noise, {amplitude * turn, amplitude * turn * turn});
  const double end = std::log(static_cast<double>(values.size()));  // of the place
  std::vector<double> saved(values.size() + 1);
  double of_lamp = 0;
  for (std::size_t n = 1; n <= values.size(); ++n) {
    of_lamp += costs[values.size() - n];
    if (n >= kMinBeyond) saved[n] = of_lamp - std::min(steady[n], varying[n]) - end;
  }
  const double most = *std::ranges::max_element(saved);
  if (most <= 0) return 0;
  double total = 0, as_many = 0;
  for (const double saves : saved) total += std::exp(saves - most);
  std::size_t beyond = values.size();
  while ((as_many += std::exp(saved[beyond] - most)) < kSure * total) --beyond;
  return beyond;
}

}  // namespace

ChipRange lamp_chips(std::span<const double> values, const SlicedChips& seen, double slow) {
  const std::size_t count = values.size();
  if (count < kMinChips) return {0, count};
  std::vector<double> squares(count), swings(count);
  for (std::size_t k = 0; k < count; ++k) {
    squares[k] = std::pow(values[k] - (seen.bits[k] ? seen.bright[k] : seen.dark[k]), 2);
    swings[k] = seen.bright[k] - seen.dark[k];
  }
  const double swing = median(swings);
  const double noise = std::max(std::sqrt(median(squares) / kMedianSquare), kMinNoise * std::abs(swing));
  if (!(noise > 0)) return {0, count};
  std::vector<double> costs = costs_of_bits(seen.bits);
  for (std::size_t k = 0; k < count; ++k) costs[k] += std::min(0.5 * squares[k] / (noise * noise), kOutlier);
  const std::size_t after = chips_beyond(values, costs, noise, swing, slow);
  const std::vector<double> reversed(values.rbegin(), values.rend());
  std::ranges::reverse(costs);
  const std::size_t before = chips_beyond(reversed, costs, noise, swing, slow);
  if (before + after >= count) return {0, count};
  return {before, count - after};
}

}  // namespace ocisac
