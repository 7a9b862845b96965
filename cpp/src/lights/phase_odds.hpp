// Odds of a light over a texture from several frames: the phase of a light moves with the clock, that of a texture
// stays.
#pragma once

#include <cstddef>
#include <span>

#include "lights/merging.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Change of phase from one frame to another, rad, and its standard error.
struct PhaseChange {
  double angle, std;
};

// Odds of a light over a texture, by which prior odds are multiplied. A light has any phase in another frame, except
// the few in step with the frames; a texture has the same one, except where the camera moves:
//   (0.9·U + 0.1·S) / (0.8·S + 0.2·U),   U = (1/2π)^K,   S = Π normal(angle; 0, std)
// 1 without changes.
double phase_odds(std::span<const PhaseChange> changes);

// The same for the tone of a box in a frame (frequency in Hz), from up to three other frames, the nearest.
double phase_odds(const AnyFramesView& frames, std::size_t frame, const Camera& camera, const Region& box,
                  double frequency);

// The same for a waveform, by its least correlation with those of the other frames.
double waveform_odds(const LitFrame& frame, const LightPart& part);

}  // namespace ocisac
