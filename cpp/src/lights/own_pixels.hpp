// Tone of a light's own pixels by least squares: what lies around a short lamp does not matter to it.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "lights/light_patch.hpp"
#include "lights/refinement.hpp"

namespace ocisac {

// Log light of a part of the patch, each group less its level: (rows × groups), and which pixels are the light's own;
// their mean in each row, and their number.
struct OwnPixels {
  std::vector<double> light;
  std::vector<std::uint8_t> own;
  std::vector<double> profile, weight;
  Region box = {};        // of all pixels
  std::size_t group = 1;  // columns of a group
};

// Pixels of the box and `reach` rows above and below it; the light's own are those of the box whose swing along the
// phase of its sum exceeds `least`.
OwnPixels own_pixels(const Patch& patch, const ComplexValues& swing, const Region& box, std::size_t reach,
                     double least);

// The frequency in [lower, upper], cycles per row, with most energy in the fit of mean, slope and up to three harmonics
// to the profile; `lower` or `upper` if the energy grows beyond it.
double strongest_frequency(const OwnPixels& pixels, double lower, double upper);

// The light's outline and its frequency together, alternately: given the tone, the rows of each group are those of the
// largest likelihood ratio against texture that swings as much; given them, the frequency is the strongest. A swing
// under a window is half a cycle blurred; this is not. `frequency`: to start with. Absent if the two do not settle.
std::optional<double> fit_outline(OwnPixels& pixels, double frequency);

// Box of the light's own.
Region own_box(const OwnPixels& pixels);

// Measures of the fit, without box, amplitude, depth and contour. `noise`: variance of a pixel.
RefinedLight refined_light(const OwnPixels& pixels, double frequency, double noise);

}  // namespace ocisac
