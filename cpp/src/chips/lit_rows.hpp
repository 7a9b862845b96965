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

// Standard deviations that a turn of the light has at least: 300 rows of noise span 6.
inline constexpr double kTurnErrors = 8;
// Rows that are dark if as long: times the second longest run of the light; shortest runs, over which two frames are
// not alike by chance either.
inline constexpr double kDarkRuns = 4, kDarkChips = 16;

// What is known of rows that the lamp does not reach.
struct DarkRows {
  double least_departure = 0.125;  // of the light's swing: a row further from the dark level is lit, whatever the noise
  double texture = 0;              // standard deviation of the light there, of its level
  double most_noise = 0.04;        // of the light's swing: more may be chips
  bool expected = false;           // at both ends, as beyond the rows in which the light was seen
  std::size_t before = 0, after = 0;  // that the lamp did not reach in another frame: most of them suffice
};

// All rows, less the steady ones at either end that are too many for a run of chips: more than four times as many as
// between any two turning points of the light but one pair, half more than between that, and sixteen times as many as
// their lower quartile. They end where two rows
// leave the level there by more than its noise, its texture and the least departure, the second one by half as much.
// `noise`: standard deviation of the signal, NaN where unknown. `seen`: rows in which the light was found, with a
// margin. At an end beyond them dark rows are expected: one and a half times as many as between any two turning points
// suffice, and where there are none the result ends with `seen`.
LitRows lit_rows(std::span<const double> signal, double noise, const RowRange& seen, const DarkRows& dark = {});
inline LitRows lit_rows(std::span<const double> signal, double noise) {
  return lit_rows(signal, noise, {0, signal.size()});
}

}  // namespace ocisac
