// Shares of a slow light that is not alike on all of the picture.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/cleaning/slow_light.hpp"

namespace ocisac {

// In consecutive frames the phase moves and the picture hardly, so that the mean of a cell changes by its share of the
// light. `tones`: as in the first of the frames. Empty where cells of their own explain the changes no better than one
// share, or where the frames are too few.
std::vector<double> slow_shares(std::span<const CommonCourse> courses, const std::vector<SlowTone>& tones,
                                std::size_t rows);

}  // namespace ocisac
