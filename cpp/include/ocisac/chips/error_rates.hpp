// Errors that a detector makes, foretold from rows per chip, exposure and noise.
#pragma once

#include <span>

#include "ocisac/chips/chip_equations.hpp"

namespace ocisac {

// Share of wrong decisions where a value is gain·x + Σ others_j·x_j + noise, all x = ±½ at random: the mean of
// Q((gain/2 + Σ ±others_j/2)/noise) over the signs, by Beaulieu's series (1990) where there are many. Exact to 1e-13;
// of many others, noise counts as at least 1e-5 of the range of the sum.
double sliced_error_rate(double gain, std::span<const double> others, double noise);

// Each of its own detector; all for chips that lie an exposure or more from the frame's ends, mean over their places.
//
//   slicer, inverse, wiener: exact for their weights of the rows (`inverse`: far from the ends)
//   dfe:   as wiener, with the chips before known; those that follow from a wrong one are not counted
//   mlse:  Σ w·Q(distance/(2σ)) over the sequences of chips that are likeliest taken for each other, w the wrong chips
//          times the share of places where they may stand: one chip; 01 for 10; 010 for 101; 01 for 10 twice, an
//          exposure apart. A union bound, so at most a little too high, and never above 1/2
struct DetectorErrorRates {
  double slicer, inverse, wiener, dfe, mlse;
};

// `exposure_rows` in rows, `noise` of a row over the swing. Throws std::invalid_argument as detect_chips.
DetectorErrorRates detector_error_rates(double rows_per_chip, double exposure_rows, double noise);

// The same from the equations of a frame.
double wiener_error_rate(const ChipEquations& equations);
double feedback_error_rate(const ChipEquations& equations);
double sequence_error_rate(const ChipEquations& equations);

}  // namespace ocisac
