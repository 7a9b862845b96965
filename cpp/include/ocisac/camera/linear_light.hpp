// Pixel columns as signals of linear light.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Columns [first, first + count) of one frame as dense signals (count × rows) of linear light above dark, float64.
std::vector<double> column_signals(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                                   const ToneCurve& curve);

struct Shape {
  std::size_t frames, rows, columns;
};
Shape shape_of(const AnyFramesView& frames);

// The largest value that the samples can hold; NaN for floating point, which has no such value.
double saturation_level(const AnyFramesView& frames);

// Refuses views without rows or columns, and floating-point samples that are not finite.
void check(const AnyFramesView& frames);

}  // namespace ocisac
