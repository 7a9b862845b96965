// Reduced sequence detection over the most likely sequences: nearly maximum likelihood, at any exposure.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/chips/chip_equations.hpp"

namespace ocisac {

inline constexpr double kLongestReducedExposure = 24;  // chips

struct ReducedSearch {
  std::size_t max_sequences = 1024;  // sequences kept per chip
  std::size_t max_first_sequences =
      16384;                       // the same in the first four exposures: what lies before the frame is not known
  double reach = 10;               // nats; sequences whose cost exceeds the best by more are discarded
  SearchEffort* effort = nullptr;  // counted down by the sequences kept, no more in the first exposures than later
};

// M-algorithm (Anderson and Mohan 1984) on ChipEquations. At each chip it keeps the most likely sequences that differ
// in the last band() chips; the known part of the later rows' cost is included. A backward pass over the kept sequences
// gives the soft outputs (Franz and Anderson 1998): (count) log-likelihood ratios as of detect_sequence(). If no kept
// sequence has the opposite chip, the ratio comes from the most likely sequence that differs from the best in a run of
// up to four chips, or in two such runs an exposure apart. Run time is proportional to the sequences kept, which are
// few at high signal-to-noise ratios. All ratios are 0 once the effort is used up.
std::vector<double> search_reduced(const ChipEquations& equations, const ReducedSearch& search = {});

}  // namespace ocisac
