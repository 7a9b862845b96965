// How much rows a few apart differ: the criterion by which row lights and shares are compared.
#pragma once

#include <cstddef>
#include <span>

#include "ocisac/cleaning/light_share.hpp"

namespace ocisac {

// Mean of log(τ² + (difference² + noise variance)/mean²), τ = 0.05, over pairs of pixels `lag` rows apart in one
// column. Lower is more likely; the logarithm limits the influence of edges. 0 without pairs: pixels of infinite
// variance and pairs without light do not count.
double pair_misfit(const BandedPicture& picture, std::size_t lag);

// The same after division by the light. row_light: (frames × rows), mean about 1; share: one for all, one a column, or
// one a pixel (rows × columns).
double row_misfit(const BandedPicture& picture, std::span<const double> row_light, std::span<const double> share,
                  std::size_t lag);

}  // namespace ocisac
