// Detection of a known chip sequence in a column at any exposure, and the channel estimate from it.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

struct PreambleSearch {
  double rows_per_chip;                 // nominal
  double tolerance = 0.02;              // max relative error of rows_per_chip
  std::optional<double> exposure_rows;  // rows; absent: estimated
  double max_exposure_chips = 14;       // chips, if the exposure is estimated
  std::size_t max_matches = 1;          // maximum number of results
};

struct PreambleMatch {
  ChannelEstimate channel;  // clock.phase: start of the preamble's first chip
  double explained = 0;     // fraction of the variance of its rows explained by the preamble
  double certainty = 0;     // log-odds against random chips of the same rate, minus the log of the places tried
};

// Positions of a chip sequence (levels 0 … 1) that lies whole in the frame, in order of certainty; empty if nothing
// matches. Correlates all positions with the exposed sequence, mean and slope removed, over a grid of exposures and
// rates; then runs fit_channel from the best. The preamble must be longer than the exposure by at least
// kMinChipsSeen chips.
std::vector<PreambleMatch> find_preamble(std::span<const double> signal, std::span<const double> preamble,
                                         const PreambleSearch& search);

inline constexpr double kMinChipsSeen = 6;
inline constexpr double kMinCertainty = 5.5;  // nats; of a preamble, and of a lattice of edges

}  // namespace ocisac
