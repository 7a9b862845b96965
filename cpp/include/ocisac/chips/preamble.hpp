// A known sequence of chips found in a column, at any exposure; the channel comes with it.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

struct PreambleSearch {
  double rows_per_chip;                 // nominal
  double tolerance = 0.02;              // the true one lies within this share of it
  std::optional<double> exposure_rows;  // rows; absent: estimated
  double max_exposure_chips = 14;       // chips, where it is estimated
  std::size_t max_matches = 1;          // matches to give
};

struct PreambleMatch {
  ChannelEstimate channel;  // clock.phase: where the preamble's first chip begins
  double explained = 0;     // share of the variance of its rows that the preamble explains
  double certainty = 0;     // ln of the odds against random chips of the same rate, less the places tried
};

// Places of a sequence of chips (levels 0 … 1) that lies whole in the frame, the surest first; none where nothing like
// it is seen. Correlation of all places over a grid of exposures and rates with the exposed sequence, mean and slope
// taken out, then fit_channel from the best. At least kFewestChipsSeen chips must be longer than the exposure.
std::vector<PreambleMatch> find_preamble(std::span<const double> signal, std::span<const double> preamble,
                                         const PreambleSearch& search);

inline constexpr double kFewestChipsSeen = 6;

}  // namespace ocisac
