// Frames in which there is nothing to search.
#pragma once

#include <span>

namespace ocisac {

// White noise, or nothing, about a level that varies slowly along the rows.
bool is_noise(std::span<const double> signal);

}  // namespace ocisac
