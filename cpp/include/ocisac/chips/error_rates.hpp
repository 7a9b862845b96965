// Predicted error rates of the detectors from rows per chip, exposure and noise.
#pragma once

#include <span>

#include "ocisac/chips/chip_equations.hpp"

namespace ocisac {

// Error rate of the sign of gain·x + Σ others_j·x_j + noise, all x = ±½ at random: the mean of Q((gain/2 + Σ
// ±others_j/2)/noise) over the signs, by Beaulieu's series (1990) for many others. Exact to 1e-13; for many others,
// noise is at least 1e-5 of the range of the sum.
double sliced_error_rate(double gain, std::span<const double> others, double noise);

// Error rates of the detectors, for chips an exposure or more from the frame's ends, averaged over their places.
//
//   slicer, inverse, wiener: exact for their row weights (inverse: far from the ends)
//   dfe:   as wiener with earlier chips known, without error propagation
//   mlse:  Σ w·Q(distance/(2σ)) over the most likely error events, w: wrong chips times the probability of their
//          pattern
//
// The events are one chip; 01 for 10; 010 for 101; 01 for 10 twice, an exposure apart. Their sum is limited to 1/2. It
// is no bound: it counts overlaps twice, and leaves other events out.
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
