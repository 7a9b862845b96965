// Maximum-likelihood detection of chips that the exposure has run into each other.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/chips/refine_channel.hpp"

namespace ocisac {

// The longest exposure that is detected, in chips: 2^15 sequences are compared at each chip.
inline constexpr double kLongestDetectedExposure = 15;

// The exposure is a box, so a row is a known weighted sum of the chips that it sees:
//
//   s_n = (1/L)·∫ chips over L chips up to the row's end,   L = exposure / rows per chip
//
// and all rows together are most likely for one sequence of chips. A state is the last ⌈L⌉ chips; forward and backward
// over the trellis give, for each chip, the least squares with it bright and with it dark (max-log; Viterbi 1967, Bahl
// et al. 1974). Rows per chip and L need not be whole.
struct SequenceDetection {
  // (chips) ln p(rows | bright) − ln p(rows | dark), by the likeliest sequences of either kind. Above 0: bright. A chip
  // that no row sees has 0.
  std::vector<double> llr;
};

// Throws std::invalid_argument for an exposure beyond kLongestDetectedExposure chips, and for values that are not
// finite or out of range. Time and memory grow with chips·2^⌈L⌉ (memory: 4 bytes each).
SequenceDetection detect_sequence(const ChipQuestion& question);

// Swings between what the rows read for two sequences that differ by 01 against 10 somewhere: the closest pair there is
// for exposures from about two chips on. The least over where the chips may lie to the rows. Noise σ of a row then
// makes about Q(distance/(2σ)) errors a chip.
double closest_pair_distance(double rows_per_chip, double exposure_rows);

}  // namespace ocisac
