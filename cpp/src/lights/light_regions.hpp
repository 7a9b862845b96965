// Regions of the lights that carry data: boxes with one light's chips each.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Boxes of lights beside each other (groups of columns with different swings: light_groups) and above each other
// (separated by rows without swings), cut until each contains one. Rows without swings at the ends are
// removed if there are many. Order: from the left, then from the top; the whole frame unless several lights are
// detected. Lights that touch above each other are not separated. None where more than `most` are detected: a texture
// resembles any number of lights.
std::vector<Region> light_regions(const AnyFramesView& frame, const ToneCurve& curve, std::size_t most);

// The part of a region from the first to the last row with a common swing of its columns; the whole region if that is
// more than 90 % of it, or without swings.
Region swinging_rows(const AnyFramesView& frame, const Region& region, const ToneCurve& curve);

}  // namespace ocisac
