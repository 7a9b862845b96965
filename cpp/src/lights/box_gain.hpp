// Gain of a light's tone in its box.
#pragma once

#include <cmath>

#include "core/levels.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/lights/known_light.hpp"
#include "ocisac/tones/tone_gain.hpp"

namespace ocisac {

// All columns of the box are pooled; the view holds one frame. frequency: Hz.
inline MeasuredLight box_gain(const AnyFramesView& frame, const Camera& camera, const Region& box, double frequency) {
  const ToneGain found = tone_gain(part_of(frame, box), camera, {&frequency, 1}, {.pooled = true});
  const double cycles =
      std::fmod(frequency * camera.row_time * static_cast<double>(box.y), 1.0);  // before its first row
  return {.box = box,
          .frequency = frequency,
          .gain = found.gain[0],
          .gain_std = found.gain_std[0],
          .phase = std::remainder(found.phase[0] - kTwoPi * cycles, kTwoPi),
          .mean = found.mean[0],
          .flags = found.flags[0]};
}

}  // namespace ocisac
