#include "lights/phase_odds.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "ocisac/camera/linear_light.hpp"
#include "ocisac/tones/tone_gain.hpp"

namespace ocisac {

namespace {

constexpr double light_in_step = 0.1, texture_moves = 0.2;   // probabilities
constexpr double least_std = 0.1;                            // rad: noise that texture hides, a pixel of movement
constexpr double largest_std = 1;                            // rad, of a usable phase
constexpr std::size_t compared = 3;                          // frames
constexpr double same_waveform = 0.9, other_waveform = 0.6;  // correlation
constexpr double turn = 2 * std::numbers::pi;

// Up to `compared` other frames, the nearest.
std::vector<std::size_t> other_frames(std::size_t frame, std::size_t count) {
  const std::size_t first = std::min(frame - std::min<std::size_t>(frame, 1), count - std::min(count, compared + 1));
  std::vector<std::size_t> others;
  for (std::size_t other = first; other < std::min(first + compared + 1, count); ++other)
    if (other != frame) others.push_back(other);
  return others;
}

}  // namespace

double phase_odds(std::span<const PhaseChange> changes) {
  double step = 1;  // S/U
  for (const auto& [angle, std] : changes) {
    const double away = std::remainder(angle, turn) / std;
    step *= turn * std::exp(-0.5 * away * away) / (std * std::sqrt(turn));
  }
  if (!std::isfinite(step)) return light_in_step / (1 - texture_moves);
  return (1 - light_in_step + light_in_step * step) / ((1 - texture_moves) * step + texture_moves);
}

double phase_odds(const AnyFramesView& frames, std::size_t frame, const Camera& camera, const Region& box,
                  double frequency) {
  const auto others = other_frames(frame, shape_of(frames).frames);
  if (others.empty()) return 1;
  const auto phase_in = [&](std::size_t index) {
    const ToneGain gain = pooled_tone_gain(part_of(frame_of(frames, index), box), camera, std::span(&frequency, 1), {});
    return PhaseChange{gain.phase[0], gain.gain_std[0] / gain.gain[0]};
  };
  std::vector<PhaseChange> changes;
  const PhaseChange own = phase_in(frame);
  for (const std::size_t other : others) {
    const PhaseChange there = phase_in(other);
    const double std = std::hypot(own.std, there.std);
    if (std < largest_std) changes.push_back({there.angle - own.angle, std::max(std, least_std)});
  }
  return phase_odds(changes);
}

double waveform_odds(const LitFrame& frame, const LightPart& part) {
  double least = 1;
  const auto others = other_frames(frame.index, shape_of(frame.frames).frames);
  for (const std::size_t other : others) least = std::min(least, likeness_of_frames(frame, other, part));
  if (others.empty() || (least >= other_waveform && least <= same_waveform)) return 1;
  return least > same_waveform ? light_in_step / (1 - texture_moves) : (1 - light_in_step) / texture_moves;
}

}  // namespace ocisac
