// Odds of a light over a texture from several frames: the phase of a light moves with the clock, that of a texture
// stays.
#pragma once

#include "lights/light_patch.hpp"
#include "lights/merging.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/core/region.hpp"

namespace ocisac {

// Odds of a light over a texture, by which prior odds are multiplied, for the tone of a box (Hz and its standard
// error), from its changes of phase d to up to three other frames, the nearest:
//   light:   p·A + (1 − p)·U,   A = Π normal(d; advance, std)   p: that light and frames keep the clocks stated
//   texture: 0.8·S + 0.2·U,     S = Π normal(d; 0, std),  U = (1/2π)^K   one texture in five moves with the camera
// The advance is frequency × frame time. Where that is whole within its error, half of the lights are in step: (A +
// S)/2. Where it is unknown a light has any phase; one in 300 is in step. 1 without other frames, or if the tone is
// gone from one.
double phase_odds(const LitFrame& frame, const Camera& camera, const Region& box, double frequency,
                  double frequency_std);

// The same for a waveform, by its least correlation with those of the other frames.
double waveform_odds(const LitFrame& frame, const LightPart& part);

}  // namespace ocisac
