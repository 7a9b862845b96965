// From pixels to one signal: which columns carry the light, and how much each of them counts.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/views.hpp"

namespace ocisac {

struct CombinedColumn {
  std::vector<double> signal;   // (rows), linear light, DN above dark
  std::vector<double> weights;  // (columns), sum 1; 0: left out
  double noise = 0;             // standard deviation of `signal` about the common light; NaN for a single column
  double quality = 0;           // power of the common light over noise after combining; one column: its power
  bool saturated = false;       // columns with saturated pixels had to be used, or are all there is
};

enum class SaturatedColumns { leave_out, use };

// Share of the rows in which each column of a frame is saturated (within 2 % of the top of the scale). Floating-point
// samples saturate only where the curve names a white level.
std::vector<double> saturated_share(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve);

// Weights that maximise the signal-to-noise ratio: with a one-factor model of the columns' covariance (all see the
// same light, each has noise and texture of its own), gain over own variance. Neighbouring columns share a weight.
CombinedColumn combine_columns(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                               SaturatedColumns saturated = SaturatedColumns::leave_out);

// One-factor model C = a·aᵀ + diag(v) of a covariance (size × size) by principal-factor iteration.
struct CommonFactor {
  std::vector<double> loadings;  // a
  std::vector<double> own;       // v
};
CommonFactor common_factor(std::span<const double> covariance, std::size_t size);

}  // namespace ocisac
