#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/levels.hpp"
#include "ocisac/receiver/frame_reading.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

constexpr double kNuisanceSettled = 0.95;             // relative to the noise of the last round
constexpr double kMostOctaves = 4;                    // of the longer over the shorter of two exposures
constexpr double kSlowest = 2;                        // chips, of rise and fall
constexpr double kShapeStep = 0.02;                   // chips
constexpr double kMinShapeGain = 1e-3;                // relative fall of the noise, for another step
constexpr double kWarpMean = 0.25, kWarpSlope = 1.5;  // of a warp, rows and rows per frame, over its root mean square
constexpr int kWarpPatience = 4;                      // rounds without a gain, while more than noise is left
constexpr double kWarpSettled = 0.99;                 // ratio of the noise to the best so far
constexpr double kMaxWarpLeft = 0.8;                  // of the residual's squares, for a warp to be believed

}  // namespace

// Golden-section search for where `left_at` is least.
template <typename LeftAt>
static double least_between(double low, double high, const LeftAt& left_at) {
  constexpr double kGolden = 0.6180339887498949;
  double a = high - kGolden * (high - low), b = low + kGolden * (high - low);
  double at_a = left_at(a), at_b = left_at(b);
  for (int step = 0; step < kMaxIterations; ++step) {
    if (at_a < at_b) {
      high = std::exchange(b, a);
      at_b = at_a;
      at_a = left_at(a = high - kGolden * (high - low));
    } else {
      low = std::exchange(a, b);
      at_a = at_b;
      at_b = left_at(b = low + kGolden * (high - low));
    }
  }
  return 0.5 * (low + high);
}

// Within a quarter of a frame's spectral line about the tone's frequency.
static void move_tone(std::span<const double> signal, std::span<const double> exposed, RowNuisance& nuisance,
                      double& tone) {
  const double reach = kToneReach / static_cast<double>(signal.size());
  tone = least_between(tone - reach, tone + reach, [&](double frequency) {
    tone = frequency;
    const auto fit = remove_nuisance(signal, nuisance, exposed);
    return fit ? fit->residual_energy : std::numeric_limits<double>::infinity();
  });
}

std::optional<FrameReading> refine_nuisance(std::span<const double> signal, FrameReading reading, RowNuisance nuisance,
                                            bool exposure_known, SearchEffort* effort) {
  for (int round = 0; round < kMaxIterations; ++round) {
    const auto exposed = exposed_rows(reading, signal.size());
    for (double& tone : nuisance.tones) move_tone(signal, exposed, nuisance, tone);
    const auto fit = remove_nuisance(signal, nuisance, exposed);
    auto again = fit ? read_frame(fit->rest, reading.channel, exposure_known, effort) : std::nullopt;
    if (!again) return std::nullopt;
    const bool stays = again->first == reading.first && exposed_rows(*again, signal.size()) == exposed;
    const bool settled = again->relative_noise > kNuisanceSettled * reading.relative_noise;
    reading = std::move(*again);
    if (stays || (settled && round > 0)) break;
  }
  reading.nuisance = std::move(nuisance);
  return reading;
}

std::optional<FrameReading> refine_turns(std::span<const double> signal, const FrameReading& reading,
                                         std::ptrdiff_t long_row, bool exposure_known, SearchEffort* effort) {
  ChannelEstimate channel = reading.channel;
  ChipClock& clock = channel.clock;
  clock.long_row = long_row;
  const auto chips = hard_chips(reading);
  const std::size_t reach = signal.size() / 8;
  const auto left_at = [&](double octaves, double later) {
    clock.shorter = std::exp2(-octaves);
    clock.later = later;
    const auto left = channel_residual(signal, {chips, reading.first}, channel);
    double squares = 0;
    for (std::size_t n = reach; n + reach < left.size(); ++n)
      if (!clock.is_long(static_cast<std::ptrdiff_t>(n))) squares += std::pow(left[n] / clock.shorter, 2);
    return squares;
  };
  const auto scan = [](double low, double high, double step, const auto& left) {
    double best = low, least = left(low);
    for (double at = low + step; at <= high; at += step)
      if (const double squares = left(at); squares < least) {
        least = squares;
        best = at;
      }
    return best;
  };
  const double farthest = static_cast<double>(reach), step = 0.25 * clock.rows_per_chip, half = kMostOctaves / 8;
  double later = scan(-farthest, farthest, step, [&](double at) { return left_at(0.5 * kMostOctaves, at); });
  double octaves = scan(half, kMostOctaves, half, [&](double at) { return left_at(at, later); });
  for (int round = 0; round < kMaxIterations; ++round) {
    later = least_between(later - step, later + step, [&](double at) { return left_at(octaves, at); });
    octaves = least_between(octaves - half, octaves + half, [&](double at) { return left_at(at, later); });
  }
  clock.shorter = std::exp2(-std::max(octaves, half));
  clock.later = later;
  return read_frame(signal, channel, exposure_known, effort);
}

// Gauss–Newton on rise and fall with known chips; all other unknowns are fitted anew at each (variable projection).
static ChannelEstimate fit_shape(std::span<const double> signal, const KnownChips& chips, ChannelEstimate best,
                                 bool exposure_known) {
  const ChannelModel model{best.dark.size() - 1, best.swing.size() - 1, exposure_known};
  const auto fitted_at = [&](double rise, double fall) {
    ChipClock clock = best.clock;
    clock.rise = std::clamp(rise, 0.0, kSlowest);
    clock.fall = std::clamp(fall, 0.0, kSlowest);
    return fit_channel(signal, chips, clock, model);
  };
  for (int step = 0; step < kMaxIterations; ++step) {
    const double rise = best.clock.rise, fall = best.clock.fall;
    const auto riser = fitted_at(rise + kShapeStep, fall), faller = fitted_at(rise, fall + kShapeStep);
    if (!riser || !faller) break;
    const auto left = channel_residual(signal, chips, best), left_riser = channel_residual(signal, chips, *riser),
               left_faller = channel_residual(signal, chips, *faller);
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (std::size_t n = best.rows.begin; n < best.rows.end; ++n) {
      const Eigen::Vector2d slope(left_riser[n] - left[n], left_faller[n] - left[n]);
      normal += slope * slope.transpose();
      right -= left[n] * slope;
    }
    const auto solved = solve_normal(normal, right);
    if (!solved) break;
    const double to_rise = kShapeStep * solved->values[0], to_fall = kShapeStep * solved->values[1];
    double share = std::min(1.0, kMostly / std::max({std::abs(to_rise), std::abs(to_fall), 1e-12}));
    const double before = best.noise;
    for (int halving = 0; halving < kMaxIterations && !(best.noise < before); ++halving, share *= 0.5)
      if (auto moved = fitted_at(rise + share * to_rise, fall + share * to_fall); moved && moved->noise < best.noise)
        best = std::move(*moved);
    if (!(best.noise < (1 - kMinShapeGain) * before)) break;
  }
  return best;
}

std::vector<double> sharpened(std::span<const double> signal, double rows) {
  std::vector<double> sharp(signal.begin(), signal.end());
  for (std::size_t n = 1; n + 1 < sharp.size(); ++n) sharp[n] += 0.5 * rows * (signal[n + 1] - signal[n - 1]);
  return sharp;
}

std::optional<FrameReading> refine_shape(std::span<const double> signal, FrameReading reading, bool exposure_known,
                                         SearchEffort* effort) {
  bool better = false;
  for (int round = 0; round < kMaxIterations; ++round) {
    const auto chips = hard_chips(reading);
    const ChannelEstimate moved = fit_shape(signal, {chips, reading.first}, reading.channel, exposure_known);
    auto again = read_frame(signal, moved, exposure_known, effort);
    if (!again || (round > 0 && !(again->relative_noise < reading.relative_noise))) break;
    const bool settled = round > 0 && again->relative_noise > (1 - kMinShapeGain) * reading.relative_noise;
    again->nuisance = std::move(reading.nuisance);
    reading = std::move(*again);
    better = true;
    if (settled) break;
  }
  return better ? std::optional(std::move(reading)) : std::nullopt;
}

// Mean and slope of a warp along the frame are those of the clock, too.
static void add_warp_errors(const RowWarp& warp, ChannelEstimate& channel) {
  double squares = 0;
  for (const double rows : warp) squares += rows * rows / static_cast<double>(warp.size());
  const double rate = kWarpSlope * channel.clock.rows_per_chip / static_cast<double>(warp.size());
  channel.errors.covariance[0] += kWarpMean * kWarpMean * squares;
  channel.errors.covariance[4] += rate * rate * squares;
}

FrameReading refine_warp(std::span<const double> signal, FrameReading reading, bool exposure_known,
                         SearchEffort* effort) {
  if (reading.trust == Trust::fits) return reading;
  FrameReading best = reading;
  std::optional<FrameReading> now = reading;
  for (int round = 0, vain = 0; round < kManyIterations && vain < (best.trust != Trust::fits ? kWarpPatience : 1);
       ++round) {
    const auto chips = hard_chips(*now);
    auto warp = fit_warp(unwarped(signal, now->warp), now->warp, {chips, now->first}, now->channel, vain == 0);
    now = read_frame(unwarped(signal, warp), now->channel, exposure_known, effort);
    if (!now) break;
    now->warp = std::move(warp);
    vain = now->channel.noise < kWarpSettled * best.channel.noise ? 0 : vain + 1;
    if (now->channel.noise < best.channel.noise) best = *now;
  }
  if (reading.warp.empty() && std::pow(best.channel.noise / reading.channel.noise, 2) > kMaxWarpLeft) return reading;
  add_warp_errors(best.warp, best.channel);
  return best;
}

}  // namespace ocisac
