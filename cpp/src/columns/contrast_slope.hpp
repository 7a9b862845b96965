// Light multiplies a picture, so its rows keep the contrast between their columns; lines of text, of bricks and of
// boards have more of it in dark rows.
#pragma once

#include <cstddef>
#include <limits>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Slope of relative squared contrast over log light, and its standard error, infinite where the rows tell none. A light
// that multiplies has 0; a veil, which adds to a steady picture, −2; unstated dark levels, and the shade of a lamp on
// an even ground, more than 0.
struct ContrastSlope {
  double slope = 0, std = std::numeric_limits<double>::infinity();

  // True if neither a light nor a veil explains the slope.
  [[nodiscard]] bool is_of_texture() const;
};

// The contrast of rows n and n + 1 is the sum of (y[n, c + 2] − y[n, c])·(y[n + 1, c + 2] − y[n + 1, c]), which white
// noise does not bias, over the product of their means, for columns that show the light in the same depth and do not
// saturate. The sum of a row over the columns is the instrumental variable. The standard error is a jackknife over
// groups of rows, since texture has no independent rows.
ContrastSlope contrast_slope(const AnyFramesView& frames, std::size_t frame, const Region& box, const ToneCurve& curve);

}  // namespace ocisac
