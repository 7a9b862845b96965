// The columns of one light, followed from frame to frame at little cost.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Combines the columns of a frame into one signal, as combine_columns does, with weights that come from the frames
// before: each frame takes one step of the power method on the columns' covariance towards its first eigenvector, the
// columns' share of the light. After start() nothing is allocated.
class ColumnFollower {
 public:
  explicit ColumnFollower(const ToneCurve& curve) : curve_(curve) {}

  // Columns [first, first + count) of a frame of one picture are looked at from here on, with weights found anew.
  void start(const AnyFramesView& frame, std::size_t first, std::size_t count);

  // The signal of a frame: (rows) linear light, DN above dark. `can_move`: the columns looked at go along with the
  // light.
  std::span<const double> combine(const AnyFramesView& frame, bool can_move);

  [[nodiscard]] std::size_t first() const { return first_; }
  [[nodiscard]] std::size_t count() const { return weights_.size(); }
  // (count) sum 1.
  [[nodiscard]] std::span<const double> weights() const { return weights_; }
  [[nodiscard]] bool saturated() const { return saturated_; }

 private:
  template <class T>
  void weigh(const FramesView<const T>& view);
  template <class T>
  void update(const FramesView<const T>& view);
  template <class T>
  double light(T value) const;
  void centre(std::size_t columns);

  ToneCurve curve_;
  std::size_t first_ = 0;
  bool saturated_ = false;
  std::vector<double> table_;  // light of every value of bytes or 16-bit samples, where the curve is not linear
  std::vector<double> weights_, loadings_, means_;  // (count)
  std::vector<std::size_t> clipped_;                // (count) rows
  std::vector<double> signal_, swings_;             // (rows)
};

}  // namespace ocisac
