// Gain of a light's tone in its box.
#pragma once

#include <cmath>
#include <numbers>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/tones/tone_gain.hpp"

namespace ocisac {

struct BoxGain {
  double gain, gain_std;
  double phase;  // rad in [−π, π], at the end of the exposure of row 0 of the frame
  double mean;   // DN above dark
  Flags flags;
};

// All columns of the box are pooled; the view holds one frame. frequency: Hz.
inline BoxGain box_gain(const AnyFramesView& frame, const Camera& camera, const Region& box, double frequency) {
  const ToneGain found = pooled_tone_gain(part_of(frame, box), camera, {&frequency, 1});
  const double cycles =
      std::fmod(frequency * camera.row_time * static_cast<double>(box.y), 1.0);  // before its first row
  return {found.gain[0], found.gain_std[0],
          std::remainder(found.phase[0] - 2 * std::numbers::pi * cycles, 2 * std::numbers::pi), found.mean[0],
          found.flags[0]};
}

}  // namespace ocisac
