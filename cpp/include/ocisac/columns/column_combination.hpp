// From pixels to one signal: which columns carry the light, and how much each of them counts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/views.hpp"

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

// Columns that see one light where several lights are in the picture.
struct LightGroup {
  std::vector<std::uint8_t> columns;  // (columns) 1: sees it
  std::vector<double> swings;         // (rows) its swings about their moving mean, of length 1
};

// The lights that stand side by side, the strongest first: groups of columns whose swings agree with each other (cosine
// above 0.6) and not with another group's (below 0.3). Empty where all columns may see one light. Saturated columns are
// in none.
std::vector<LightGroup> light_groups(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve);

// Cosine of a signal's swings about their moving mean with a group's.
double agreement(std::span<const double> signal, const LightGroup& group);

// Weights that maximise the signal-to-noise ratio: with a one-factor model of the columns' covariance (all see the
// same light, each has noise and texture of its own), gain over own variance. Neighbouring columns share a weight.
// `columns`: 1 for those that may be used, empty for all.
CombinedColumn combine_columns(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                               SaturatedColumns saturated = SaturatedColumns::leave_out,
                               std::span<const std::uint8_t> columns = {});

// combine_columns for the frames of one light in turn: the first frame's weights are found anew, the next ones' by one
// step of the factor model from those before, which takes O(blocks · rows) instead of O(blocks² · rows).
class ColumnFollower {
 public:
  explicit ColumnFollower(const ToneCurve& curve);
  ColumnFollower(ColumnFollower&&) noexcept;
  ColumnFollower& operator=(ColumnFollower&&) noexcept;
  ~ColumnFollower();

  // `frame`: one picture. Weights are found anew where its width is another, or the weights before give no signal.
  CombinedColumn combine(const AnyFramesView& frame);

  // The next frame begins so many columns further right.
  void move(std::ptrdiff_t columns);

  // The weights of the next frame are found anew.
  void forget() { weights_.clear(); }

 private:
  struct Memory;
  ToneCurve curve_;
  std::vector<double> weights_;     // (columns) of the frame before
  std::unique_ptr<Memory> memory_;  // used again from frame to frame
};

// One-factor model C = a·aᵀ + diag(v) of a covariance (size × size) by principal-factor iteration.
struct CommonFactor {
  std::vector<double> loadings;  // a
  std::vector<double> own;       // v
};
CommonFactor common_factor(std::span<const double> covariance, std::size_t size);

}  // namespace ocisac
