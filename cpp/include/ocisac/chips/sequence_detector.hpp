// Maximum-likelihood detection of chips with intersymbol interference by the exposure.
#pragma once

#include <vector>

#include "ocisac/chips/refine_channel.hpp"

namespace ocisac {

// Longest exposure in chips: 2^15 sequences are compared at each chip.
inline constexpr double kLongestDetectedExposure = 15;

// The exposure is a box, so a row is a known weighted sum of the chips in it:
//
//   s_n = (1/L)·∫ chips over L chips up to the row's end,   L = exposure / rows per chip
//
// The detector finds the sequence of maximum likelihood given all rows. A state is the last ⌈L⌉ chips. Forward and
// backward recursions over the trellis give the least squares for each chip bright and dark (max-log; Viterbi 1967,
// Bahl et al. 1974). Rows per chip and L need not be whole.
//
// Returns (chips) ln p(rows | bright) − ln p(rows | dark), by the most likely sequence of either kind. Above 0: bright.
// 0 for a chip that no row covers.
//
// Throws std::invalid_argument for an exposure beyond kLongestDetectedExposure chips, and for values that are not
// finite or out of range. Run time and memory are proportional to chips·2^⌈L⌉ (memory: 4 bytes each).
std::vector<double> detect_sequence(const ChipQuestion& question);

// Distance, over the swing, between the rows of two sequences that differ by 01 for 10: the closest pair for exposures
// from about two chips on. Root mean square over the chips' positions relative to the rows. Noise σ of a row gives
// about Q(distance/(2σ)) errors per chip.
double closest_pair_distance(double rows_per_chip, double exposure_rows);

}  // namespace ocisac
