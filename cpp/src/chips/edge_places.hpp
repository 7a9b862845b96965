// Edges of the light that lie off the chip clock (a sender's jitter, runs of one kind that last longer, chopped light):
// their noise where chips are to be detected, and their places beside known chips.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

// Cholesky factors LLᵀ of a positive definite matrix with `band` diagonals beside the main one.
class BandedFactors {
 public:
  BandedFactors(std::size_t size, std::size_t band) : size_(size), band_(band), values_(size * (band + 1), 0.0) {}

  // Of the matrix, after factor() of L: (row, row − back).
  [[nodiscard]] double& at(std::size_t row, std::size_t back) { return values_[row * (band_ + 1) + back]; }
  void factor();
  // x becomes L⁻¹x, its first element being that of row `first`, before which it is 0.
  void forward(std::span<double> x, std::size_t first = 0) const;
  void backward(std::span<double> x) const;  // (size) L⁻ᵀx

 private:
  [[nodiscard]] double value(std::size_t row, std::size_t back) const { return values_[row * (band_ + 1) + back]; }

  std::size_t size_, band_;
  std::vector<double> values_;
};

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

// Rows as if all edges of known chips lay on the clock: least squares of their places, at most half a chip off it and
// with the channel's edge_std as prior, and of the channel's levels, which are replaced, as is its noise.
std::vector<double> place_edges(std::span<const double> signal, const KnownChips& chips, ChannelEstimate& channel);

}  // namespace ocisac
