// Light beside a lamp, in the columns that vary least.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

struct SideLight {
  std::vector<double> rows;  // (rows) DN above dark: mean of the columns
  double varying = 0;        // standard deviation of what is not the lamp's and not straight along the rows
  double noise = 0;          // standard deviation of `rows` about the light of the columns
};

// Mean of the quarter of the unsaturated columns that vary least along the rows; absent for fewer than eight columns.
// What is not the lamp's is the residual of a straight line and the lamp's signal, the weighted mean of the columns;
// the noise follows from the difference of every second column from the others.
std::optional<SideLight> side_light(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                                    std::span<const double> weights);

// One frame less a light of each row, in linear light. Saturated columns are 0.
class FrameWithout {
 public:
  FrameWithout(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve, std::span<const double> light);

  [[nodiscard]] AnyFramesView view() const { return dense_view<const float>(pixels_.data(), 1, rows_, columns_); }

 private:
  std::size_t rows_, columns_;
  std::vector<float> pixels_;
};

}  // namespace ocisac
