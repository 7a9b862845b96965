// Rows as linear equations of the chips, for the detectors; the exposure's box makes them a narrow band.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "ocisac/chips/refine_channel.hpp"

namespace ocisac {

// Throws std::invalid_argument for an exposure beyond `longest` chips, and for values that are not finite or out of
// range.
void check(const ChipQuestion& question, double longest);

// Level of chip first + k if the question marks it as known.
std::optional<double> known_level(const ChipQuestion& question, std::size_t k);

// Cost of a chip at distance x from its known level: ½·kKnownPrecision·x² nats.
inline constexpr double kWholeChips = 1e-12;  // relative rounding of an exposure of a whole number of chips
inline constexpr double kKnownPrecision = 1e8;

// Let x = chip − ½ = ±½ and h_nk the share of chip k in the exposure of row n (Σ_k h_nk = 1). Then
//
//   −ln p(rows | chips) = ½·xᵀA·x − bᵀx + constant,   A = HᵀH/σ² + 4·I,   b = Hᵀ(rows − ½)/σ²
//
// The term 4·I is a prior of variance ¼. It changes no comparison of sequences, since x² = ¼ for each, but models the
// uncertainty of undecided chips. Known chips add kKnownPrecision to it. A has ⌈exposure in chips⌉ diagonals beside the
// main one. Edges that lie off the clock by e_k, of standard deviation clock.edge_std, add J·e to the rows, J_nk being
// 1/length while row n sees the edge before chip k: noise of covariance edge_std²·JJᵀ, whichever chips have an edge.
// With G = JᵀJ/σ² + I/edge_std² = LLᵀ and X = L⁻¹JᵀH/σ² (matrix inversion lemma)
//
//   A = HᵀH/σ² + 4·I − XᵀX,   b = Hᵀ(rows − ½)/σ² − XᵀL⁻¹Jᵀ(rows − ½)/σ²
//
// of which about two exposures of diagonals differ from 0.
// Factored from the last chip to the first, A = MᵀDM with M unit lower triangular, the cost is
//
//   Σ_k ½·d_k·(x_k − m_k)²,   m_k = z_k − Σ_j M_kj·x_j over j < k
//
// m_k and 1/d_k are mean and variance of chip k given the earlier chips and all rows, with Gaussian later chips.
class ChipEquations {
 public:
  // Throws as check().
  ChipEquations(const ChipQuestion& question, double longest);

  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] std::size_t band() const { return band_; }  // diagonals beside the main one

  // A_(k, k − back), back = 0 … band.
  [[nodiscard]] double normal(std::size_t chip, std::size_t back) const {
    return back > std::min(band_, chip) ? 0.0 : normal_[chip * (band_ + 1) + back];
  }
  [[nodiscard]] double precision(std::size_t chip) const { return factor_[chip * (band_ + 1)]; }  // d_k
  [[nodiscard]] const double* feedback(std::size_t chip) const {
    return &factor_[chip * (band_ + 1)];
  }                                                                              // [j]: M_(k,k−j)
  [[nodiscard]] double target(std::size_t chip) const { return target_[chip]; }  // z_k

  // Diagonal of A⁻¹: variance of each chip after the best linear estimate from all rows (prior: ¼).
  [[nodiscard]] std::vector<double> variances() const;

 private:
  void add_rows(const ChipQuestion& question);
  void factor();

  std::size_t count_, seen_, band_;               // seen_: ⌈exposure/rows per chip⌉
  std::vector<double> normal_, factor_, target_;  // (count × (band + 1)), the same, (count)
};

}  // namespace ocisac
