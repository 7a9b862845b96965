#include "lights/phase_odds.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <numeric>
#include <span>
#include <vector>

#include "ocisac/camera/linear_light.hpp"
#include "ocisac/tones/tone_gain.hpp"

namespace ocisac {

namespace {

constexpr double kInStep = 0.003, kAsStated = 0.9, kTextureMoves = 0.2;  // probabilities
constexpr double kClockError = 1e-3;                                     // of a frame time as stated, relative
constexpr double kLeastStd = 0.1;            // rad: noise that texture hides, a pixel of movement
constexpr double kLargestStd = 1;            // rad, of a usable phase
constexpr std::size_t kCompared = 3;         // frames
constexpr double kSame = 0.9, kOther = 0.6;  // correlation of waveforms
constexpr double kTurn = 2 * std::numbers::pi;

// Up to kCompared other frames, the nearest.
std::vector<std::size_t> other_frames(std::size_t frame, std::size_t count) {
  const std::size_t first = std::min(frame - std::min<std::size_t>(frame, 1), count - std::min(count, kCompared + 1));
  std::vector<std::size_t> others;
  for (std::size_t other = first; other < std::min(first + kCompared + 1, count); ++other)
    if (other != frame) others.push_back(other);
  return others;
}

// Normal density of an angle relative to 1/2π.
double over_uniform(double angle, double std) {
  const double away = std::remainder(angle, kTurn) / std;
  return std::max(std::sqrt(kTurn) / std * std::exp(-0.5 * away * away), 1e-30);
}

}  // namespace

double phase_odds(const LitFrame& frame, const Camera& camera, const Region& box, double frequency,
                  double frequency_std) {
  const auto others = other_frames(frame.index, shape_of(frame.frames).frames);
  if (others.empty()) return 1;
  const auto gain_in = [&](std::size_t index) {
    return pooled_tone_gain(part_of(frame_of(frame.frames, index), box), camera, std::span(&frequency, 1), {});
  };
  const ToneGain own = gain_in(frame.index);
  double still = 1, advanced = 1;
  bool stated = false, whole = true;  // frequency × frame time: known to a sixth of a cycle; whole within its error
  for (const std::size_t other : others) {
    const ToneGain there = gain_in(other);
    const double std = std::hypot(own.gain_std[0] / own.gain[0], there.gain_std[0] / there.gain[0]);
    if ((there.gain[0] + 2 * there.gain_std[0]) * there.mean[0] < 0.5 * own.gain[0] * own.mean[0]) return 1;
    if (!(std < kLargestStd)) continue;
    const double change = there.phase[0] - own.phase[0], noise = std::max(std, kLeastStd);
    still *= over_uniform(change, noise);
    if (!camera.frame_time) continue;
    const double time = *camera.frame_time * (static_cast<double>(other) - static_cast<double>(frame.index));
    const double unknown = kTurn * std::abs(time) * std::hypot(frequency_std, kClockError * frequency);
    const double error = std::hypot(noise, unknown);
    if (!(error < kLargestStd)) continue;
    const double advance = kTurn * std::remainder(frequency * time, 1.0);
    advanced *= over_uniform(change - advance, error);
    stated = true, whole = whole && std::abs(advance) < 2 * error;
  }
  const double light = !stated ? kInStep * still + 1 - kInStep
                               : kAsStated * (whole ? std::midpoint(advanced, still) : advanced) + 1 - kAsStated;
  return light / ((1 - kTextureMoves) * still + kTextureMoves);
}

double waveform_odds(const LitFrame& frame, const LightPart& part) {
  double least = 1;
  const auto others = other_frames(frame.index, shape_of(frame.frames).frames);
  for (const std::size_t other : others) least = std::min(least, likeness_of_frames(frame, other, part));
  if (others.empty() || (least >= kOther && least <= kSame)) return 1;
  return least > kSame ? kInStep / (1 - kTextureMoves) : (1 - kInStep) / kTextureMoves;
}

}  // namespace ocisac
