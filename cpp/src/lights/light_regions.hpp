// Where the lights are that carry data: boxes that each hold one light's chips.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Boxes of lights beside each other (columns that swing differently: light_groups) and above each other (rows between
// them in which nothing swings), cut in turn until each holds one, without rows at its ends in which nothing does,
// where these are many. From the left, then from the top; the whole frame where nothing tells more than one light.
// Lights that touch above each other are not told apart.
std::vector<Region> light_regions(const AnyFramesView& frame, const ToneCurve& curve);

// The part of a region from the first to the last of its rows in which its columns swing together; the whole region
// where that is more than 90 % of it, or nothing swings.
Region swinging_rows(const AnyFramesView& frame, const Region& region, const ToneCurve& curve);

}  // namespace ocisac
