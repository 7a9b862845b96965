// Edges of the light that lie off the chip clock (a sender's jitter, runs of one kind that last longer, chopped light):
// their noise where chips are to be detected, and their places beside known chips.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"
#include "rows/banded_factors.hpp"

namespace ocisac {

// J of ChipEquations: gathers JᵀJ, JᵀH and Jᵀ(rows − ½) over σ² row by row, then takes what they explain off A and b.
class EdgeNoise {
 public:
  // `seen`: ⌈exposure in chips⌉.
  EdgeNoise(std::size_t chips, std::size_t seen, double edge_std);

  // `shares` of the chips newest, newest − 1, …, the rows' weight 1/σ², and that times (row − ½).
  void add_row(std::size_t newest, std::span<const double> shares, double per_length, double weight, double value);
  // normal: (chips × (band + 1)).
  void take_off(std::size_t band, std::span<double> normal, std::span<double> target);

 private:
  std::size_t chips_, seen_;
  BandedFactors normal_;
  std::vector<double> cross_, right_;  // (edges × (2·seen + 1)), of the chips edge − seen … edge + seen; (edges)
};

struct PlacedEdges {
  std::vector<double> rest;  // rows as if all edges lay on the clock
  std::vector<double> off;   // (chips) of the edge before each from the clock, in edge_std; 0 without an edge
};

// Least squares of the places of known chips' edges, at most half a chip off the clock and with the channel's edge_std
// as prior, and of the channel's levels, which are replaced, as is its noise.
PlacedEdges place_edges(std::span<const double> signal, const KnownChips& chips, ChannelEstimate& channel);

}  // namespace ocisac
