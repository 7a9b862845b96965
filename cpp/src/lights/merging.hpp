// Separates parts of one light from adjacent lights: between parts of one light the swing is the same.
#pragma once

#include <cstddef>

#include "lights/light_patch.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Box of a light in a frame, and its cycles per row.
struct LightPart {
  Region box;
  double frequency;
};

// True if parts beside each other belong to one light: log light, minus its mean over two cycles, correlates (0.8) in
// the rows of both and in the columns between. False for parts farther apart than their width.
bool one_light_across(const LitFrame& frame, const LightPart& a, const LightPart& b);

// The same for parts above each other in about the same columns: in the rows between, at least a cycle, the left and
// the right half correlate (0.9) and swing at least 0.7 times as much as the parts. A tone would have been detected as
// a whole, so such a light sends data. False for parts farther apart than their total height.
bool one_light_down(const LitFrame& frame, const LightPart& a, const LightPart& b);

// Correlation of the swing of a part's rows in two frames: 1 for a texture, or light in step with the frames.
double likeness_of_frames(LitFrame frame, std::size_t other, const LightPart& part);

}  // namespace ocisac
