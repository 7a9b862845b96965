// The least-squares solution of mean + tones + harmonics (cf. IEEE Std 1057), as the weights that streaming gains need.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/core/flags.hpp"

namespace ocisac {

// One tone of the model: cycles per row ν = f·T_r, and the multiples of ν that are fitted with it.
struct ModelTone {
  double cycles_per_row;
  std::vector<int> harmonics;  // starts with 1
  bool operator==(const ModelTone&) const = default;
};

// The least-squares solution of a constant and tones as plain row weights, u counted from the middle row:
//   y(n) = c + Σ_k Σ_h [a_kh·cos(2π h ν_k u) + b_kh·sin(2π h ν_k u)] + noise,
// and parameters = weights·y, where only c and the fundamentals a_k1, b_k1 have weights, in this order:
// c, a_1, b_1, a_2, b_2, … Sines and cosines are orthogonal, which splits the model
// into two of half the size.
struct HarmonicModel {
  std::size_t rows = 0;
  double middle = 0;           // row from which u counts, fractional
  std::size_t estimates = 0;   // 1 + 2·tones: number of parameters with weights
  std::size_t parameters = 0;  // all fitted; the noise has rows − parameters degrees of freedom
  Eigen::MatrixXd weights;     // (rows × estimates)
  Eigen::MatrixXd covariance;  // (estimates × estimates), of the estimates for noise of variance 1
  Eigen::MatrixXd basis;       // (rows × parameters): orthonormal basis of the model
  // One flag word per tone: few_cycles, aliased, unresolvable, ill_conditioned, harmonics_dropped. An unresolvable tone
  // has weights of 0 and an infinite variance.
  std::vector<Flags> tone_flags;
};

inline constexpr std::size_t kColumnsInCache = 64;  // their light and what a model leaves of it

// True for the flags of a tone of at least a cycle that the rows tell from all else.
constexpr bool is_well_posed(Flags flags) {
  return (flags & (flag::few_cycles | flag::unresolvable | flag::ill_conditioned)) == 0;
}

// Throws std::invalid_argument for 0 rows and for frequencies that are not finite and positive.
HarmonicModel harmonic_model(std::size_t rows, std::span<const ModelTone> tones);

}  // namespace ocisac
