// Detectors that compare a weighted sum of the rows around a chip's middle with a threshold.
#pragma once

#include <vector>

#include "ocisac/chips/refine_channel.hpp"

namespace ocisac {

// Log-likelihood ratios and error rates as defined in detect_chips.hpp and error_rates.hpp. `clock`: an exposure or
// more from the frame's ends.
std::vector<double> slice_chips(const ChipQuestion& question);
std::vector<double> invert_and_slice_chips(const ChipQuestion& question);
double slicer_error_rate(const ChipClock& clock, double noise);
double inverse_error_rate(const ChipClock& clock, double noise);

}  // namespace ocisac
