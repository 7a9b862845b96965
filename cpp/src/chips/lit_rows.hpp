// The rows in which a lamp stands, where it leaves a part of the frame dark.
#pragma once

#include <cstddef>
#include <span>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

struct LitRows {
  RowRange rows;
  std::size_t shortest = 0;  // rows from a turning point of the light to the next, lower quartile: about a chip
};

// All rows, less the steady ones at either end that are too many for a run of chips: more than four times as many as
// between any two turning points of the light but one pair, half more than between that, and sixteen times as many as
// their lower quartile. They end where the signal leaves its level there by more than its
// noise and an eighth of the light's swing. `noise`: standard deviation of the signal, NaN where unknown. `seen`: rows
// in which the light was found, with a margin. At an end beyond them dark rows are expected: one and a half times as
// many as between any two turning points suffice, and where there are none the result ends with `seen`.
LitRows lit_rows(std::span<const double> signal, double noise, const RowRange& seen);
inline LitRows lit_rows(std::span<const double> signal, double noise) {
  return lit_rows(signal, noise, {0, signal.size()});
}

}  // namespace ocisac
