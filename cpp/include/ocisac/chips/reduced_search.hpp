// Sequence detection that follows the likeliest sequences only: nearly maximum likelihood, at any exposure.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/chips/chip_equations.hpp"

namespace ocisac {

inline constexpr double kLongestReducedExposure = 24;  // chips

struct ReducedSearch {
  std::size_t max_sequences = 1024;  // sequences kept at a chip
  std::size_t max_first_sequences =
      16384;          // the same in the first four exposures: what lies before the frame is not known
  double reach = 10;  // nats; sequences that much less likely than the best are given up
};

// The M-algorithm (Anderson and Mohan 1984) on ChipEquations: at each chip the likeliest sequences of those that
// differ in the last band() chips are kept, what later rows will say of them counted in as far as it is known; then
// backward over what was kept (Franz and Anderson 1998). (count) log-likelihood ratios as in SequenceDetection; where
// no sequence with the other chip was kept, by the likeliest that differs from the best in a run of up to four chips,
// or in two an exposure apart. Time grows with the sequences kept: few where chips are sure.
std::vector<double> search_reduced(const ChipEquations& equations, const ReducedSearch& search = {});

}  // namespace ocisac
