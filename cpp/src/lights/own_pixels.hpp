// Tone of a light's own pixels by least squares: what lies around a short lamp does not matter to it.
#pragma once

#include <cstdint>
#include <vector>

#include "lights/light_patch.hpp"
#include "lights/refinement.hpp"

namespace ocisac {

// Log light of a box, each group less its mean over its own pixels: (rows × groups), and which are the light's own;
// their mean in each row, and their number.
struct OwnPixels {
  std::vector<double> light;
  std::vector<std::uint8_t> own;
  std::vector<double> profile, weight;
};

// The pixels whose swing along the phase of the box's sum exceeds `least`.
OwnPixels own_pixels(const Patch& patch, const SwingMap& swing, const PatchRange& box, double least);

// The frequency in [lower, upper], cycles per row, with most energy in the fit of mean, slope and up to three harmonics
// to the profile; `lower` or `upper` if the energy grows beyond it.
double strongest_frequency(const OwnPixels& pixels, double lower, double upper);

// Measures of the fit, without box, amplitude, depth and contour; its phase is that at the box's first row. `noise`:
// variance of a pixel.
RefinedLight light_of(const OwnPixels& pixels, double frequency, double noise);

}  // namespace ocisac
