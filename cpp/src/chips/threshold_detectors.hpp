// The detectors that weigh the rows around a chip's middle and compare the sum with a threshold.
#pragma once

#include <vector>

#include "ocisac/chips/refine_channel.hpp"

namespace ocisac {

// Log-likelihood ratios, and shares of wrong chips, as detect_chips.hpp and error_rates.hpp say. `clock`: an exposure
// or more from the frame's ends.
std::vector<double> slice_chips(const ChipQuestion& question);
std::vector<double> invert_and_slice_chips(const ChipQuestion& question);
double slicer_error_rate(const ChipClock& clock, double noise);
double inverse_error_rate(const ChipClock& clock, double noise);

}  // namespace ocisac
