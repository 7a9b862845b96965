#include "ocisac/exposure/exposure_controller.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "core/levels.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

namespace reason = exposure_reason;

constexpr double kStepBack = 0.7;    // factor on exposure·gain after saturation
constexpr double kRecovery = 1.002;  // growth per frame of a limit set by saturation

void check(const ExposureControllerOptions& o) {
  require_positive("shortest", o.range.low);
  require_positive("longest", o.range.high);
  require(o.range.low <= o.range.high, "longest", o.range.high, "the shortest exposure or longer");
  require_not_negative("step", o.range.step);
  require_positive("lowest_gain", o.lowest_gain);
  require_positive("highest_gain", o.highest_gain);
  require(o.lowest_gain <= o.highest_gain, "highest_gain", o.highest_gain, "the lowest gain or above");
  require_not_negative("weights", o.comm_weight);
  require_not_negative("weights", o.sense_weight);
  require(o.comm_weight + o.sense_weight > 0, "weights", "0 and 0", "at least one above 0");
  require_not_negative("hysteresis", o.hysteresis);
  require_not_negative("level_floor", o.level_floor);
  require(o.level_floor < 1, "level_floor", o.level_floor, "below 1");
  require(o.level_aim > 0 && o.level_aim < 1, "level_aim", o.level_aim, "above 0 and below 1");
  require(o.level_ceiling > 0 && o.level_ceiling <= 1, "level_ceiling", o.level_ceiling, "above 0 up to 1");
  require(o.max_saturated >= 0 && o.max_saturated < 1, "max_saturated", o.max_saturated, "from 0 to below 1");
  require_not_negative("min_snr", o.min_snr);
  require(o.noise_level > 0, "noise_level", o.noise_level, "a number above 0, or infinity");
}

void require_if_known(const char* name, double value, bool above_zero) {
  if (std::isnan(value)) return;
  if (above_zero)
    require_positive(name, value);
  else
    require_not_negative(name, value);
}

void check(const ExposureMeasurement& m) {
  require(m.tones.size() <= kMaxWeightedTones, "tones", m.tones.size(), "at most 32");
  for (const MeasuredTone& tone : m.tones) {
    require_if_known("frequency", tone.frequency, true);
    require_not_negative("share", tone.share);
    if (!std::isnan(tone.snr)) require(tone.snr >= 0, "snr", tone.snr, "0 or above");
    require_if_known("gain", tone.gain, false);
    require_if_known("gain_std", tone.gain_std, false);
  }
  require_if_known("exposure", m.exposure, true);
  require_if_known("camera_gain", m.gain, true);
  require_if_known("level", m.level, false);
  require_if_known("peak", m.peak, false);
  require(m.saturated >= 0 && m.saturated <= 1, "saturated", m.saturated, "from 0 to 1");
}

using Tones = std::array<WeightedTone, kMaxWeightedTones>;

// Tones in use with their weights, in `tones`; the shares of each kind are normalised to its weight.
std::span<const WeightedTone> weighted(std::span<const MeasuredTone> measured, const ExposureControllerOptions& options,
                                       Tones& tones, std::uint32_t& reasons) {
  std::size_t count = 0;
  for (const bool is_sensing : {false, true}) {
    const std::size_t begin = count;
    double total = 0;
    for (const MeasuredTone& tone : measured) {
      if (tone.is_sensing != is_sensing) continue;
      if (std::isnan(tone.frequency) || tone.snr < options.min_snr) {
        reasons |= reason::weak_left_out;
        continue;
      }
      total += tone.share;
      tones[count++] = {tone.frequency, tone.share};
    }
    const double weight = is_sensing ? options.sense_weight : options.comm_weight;
    if (!(total > 0 && weight > 0)) count = begin;
    for (std::size_t i = begin; i < count; ++i) tones[i].weight *= weight / total;
  }
  return std::span(tones).first(count);
}

bool gains_disagree(std::span<const MeasuredTone> tones, double exposure) {
  if (std::isnan(exposure)) return false;
  return std::ranges::any_of(tones, [&](const MeasuredTone& tone) {
    const double turn = std::numbers::pi * tone.frequency * exposure;
    const double allowed = kSure * tone.gain_std + kNextToNone;
    return std::abs(tone.gain - std::abs(std::sin(turn) / turn)) > allowed;  // false where a value is kNaN
  });
}

}  // namespace

ExposureController::ExposureController(const ExposureControllerOptions& options) : options_(options) {
  check(options);
  if (options.range.step > 0)  // throws for a range without a multiple
    best_noisy_exposure(std::array{WeightedTone{0.5 / options.range.high, 1}}, kInfinity, options.range);
  reset();
}

void ExposureController::reset() {
  exposure_ = gain_ = limit_radiance_ = kNaN;
  limit_ = kInfinity;
}

ExposureController::Present ExposureController::present_of(const ExposureMeasurement& measurement) const {
  const double exposure = std::isnan(measurement.exposure) ? exposure_ : measurement.exposure;
  double gain = std::isnan(measurement.gain) ? gain_ : measurement.gain;
  if (std::isnan(gain)) gain = options_.lowest_gain;
  return {exposure, gain, measurement.level / (exposure * gain)};
}

// Largest product of exposure and gain that keeps peak and saturated pixels within their limits.
double ExposureController::largest_product(const ExposureMeasurement& measurement, const Present& present,
                                           std::uint32_t& reasons) {
  const double product = present.exposure * present.gain;
  if (std::isnan(product)) return kInfinity;
  const bool saturated = measurement.saturated > options_.max_saturated;
  const double dimmer = limit_radiance_ / present.radiance;
  if (dimmer > 0 && std::isfinite(dimmer)) limit_ *= dimmer;
  limit_radiance_ = present.radiance > 0 ? present.radiance : kNaN;
  limit_ = saturated ? std::min(limit_, kStepBack * product) : limit_ * kRecovery;
  const double by_peak =
      !saturated && measurement.peak > 0 ? options_.level_ceiling / measurement.peak * product : kInfinity;
  if (limit_ < by_peak)
    reasons |= reason::saturation;
  else if (by_peak < kInfinity)
    reasons |= reason::ceiling;
  return std::min(limit_, by_peak);
}

// Exposures T for which some gain g of the camera satisfies smallest <= T·g <= largest.
ExposureWindow ExposureController::window_of(double smallest, double largest, std::uint32_t& reasons) const {
  const ExposureWindow& range = options_.range;
  ExposureWindow window{smallest / options_.highest_gain, largest / options_.lowest_gain, range.step};
  if (window.low > range.high) reasons |= reason::too_dark;
  if (window.high < range.low) reasons |= reason::too_bright;
  if (window.low <= range.low) reasons &= ~reason::brightness_floor;
  if (window.high >= range.high) reasons &= ~(reason::ceiling | reason::saturation);
  window.low = std::clamp(window.low, range.low, range.high);
  window.high = std::clamp(window.high, range.low, range.high);
  if (range.step > 0) {  // the multiple below the ceiling if none lies between
    const double below = std::floor(window.high / range.step * (1 + kShrink)) * range.step;
    if (below < window.low) window.low = std::max(below, range.low);
    const double above = std::ceil(window.low / range.step * (1 - kShrink)) * range.step;
    if (above > window.high) window.high = std::min(above, range.high);
  }
  return window;
}

double ExposureController::gain_of(double exposure, double radiance, double smallest, double largest) const {
  const double lowest = std::clamp(smallest / exposure, options_.lowest_gain, options_.highest_gain);
  const double highest = std::clamp(largest / exposure, options_.lowest_gain, options_.highest_gain);
  const double aim = options_.level_aim / (radiance * exposure);
  const double wanted = std::isnan(aim) ? (std::isnan(gain_) ? options_.lowest_gain : gain_) : aim;
  const bool near_aim = gain_ < aim * (1 + kSmallShare) && gain_ > aim / (1 + kSmallShare);
  return std::clamp(near_aim ? gain_ : wanted, lowest, std::max(lowest, highest));
}

// Choice by brightness alone.
double ExposureController::without_tones(const ExposureWindow& window, bool allowed, double present) const {
  if (allowed) return exposure_;
  const double from = std::isnan(exposure_) ? present : exposure_;
  const double next = std::isnan(from) ? window.high : std::clamp(from, window.low, window.high);
  if (window.step == 0) return next;
  const std::array only{WeightedTone{0.5 / next, 1}};  // maximum at `next`: selects the nearby multiple
  return best_noisy_exposure(only, kInfinity, window).exposure;
}

void ExposureController::choose(std::span<const WeightedTone> tones, double present, ExposureSuggestion& chosen) const {
  const ExposureWindow window{chosen.low, chosen.high, options_.range.step};
  const bool known = !std::isnan(exposure_);
  const bool allowed =
      known && exposure_ >= window.low * (1 - kNextToNone) && exposure_ <= window.high * (1 + kNextToNone);
  bool holds = allowed;
  if (tones.empty()) {
    chosen.reasons |= reason::no_tones;
    chosen.exposure = without_tones(window, allowed, present);
  } else {
    const BestExposure best = best_noisy_exposure(tones, chosen.noise_exposure, window);
    const double now = allowed ? noisy_exposure_objective(tones, chosen.noise_exposure, exposure_) : -1;
    holds = best.objective <= now * (1 + options_.hysteresis);
    chosen.exposure = holds ? exposure_ : best.exposure;
    chosen.objective = holds ? now : best.objective;
    chosen.best_exposure = best.exposure;
    chosen.best_objective = best.objective;
  }
  chosen.reasons |= !known ? reason::first : holds ? reason::held : reason::moved;
}

ExposureSuggestion ExposureController::update(const ExposureMeasurement& measurement) {
  check(measurement);
  ExposureSuggestion chosen{kNaN, kNaN, kNaN, kNaN, kNaN, 0, 0, kInfinity, kNaN, 0};
  const Present present = present_of(measurement);
  if (gains_disagree(measurement.tones, present.exposure)) chosen.reasons |= reason::gain_mismatch;
  const double largest = largest_product(measurement, present, chosen.reasons);
  double smallest = 0;
  if (std::isnan(present.radiance)) {
    chosen.reasons |= reason::no_brightness;
  } else {
    if (options_.level_floor > 0) {
      smallest = options_.level_floor / present.radiance;
      chosen.reasons |= reason::brightness_floor;
    }
    if (present.radiance > 0) chosen.noise_exposure = options_.noise_level / present.radiance;
  }
  if (smallest > largest) {
    smallest = largest;
    chosen.reasons |= reason::floor_given_up;
  }
  const ExposureWindow window = window_of(smallest, largest, chosen.reasons);
  chosen.low = window.low;
  chosen.high = window.high;
  Tones memory;
  const auto tones = weighted(measurement.tones, options_, memory, chosen.reasons);
  choose(tones, present.exposure, chosen);
  exposure_ = chosen.exposure;
  gain_ = chosen.gain = gain_of(chosen.exposure, present.radiance, smallest, largest);
  chosen.level = present.radiance * exposure_ * gain_;
  return chosen;
}

}  // namespace ocisac
