// Pictures reduced for comparison: whether one changed beside its lights.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/core/views.hpp"

namespace ocisac {

// Mean of every fourth column of one frame, in groups of eight.
class PictureOverview {
 public:
  explicit PictureOverview(const AnyFramesView& frame);

  // True if a later frame of the same shape differs by more than noise outside of the lights' boxes, in a tile of 32
  // rows and a group or in eight tiles beside each other. A light's faint rim, which changes with it, is left out too.
  [[nodiscard]] bool has_changed(const PictureOverview& now, std::span<const Region> lights) const;

 private:
  std::size_t rows_, groups_ = 0;
  double least_ = 0;          // DN², below which nothing changes
  std::vector<float> light_;  // (rows × groups) DN
};

}  // namespace ocisac
