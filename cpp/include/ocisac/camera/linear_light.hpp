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
AnyFramesView frame_of(const AnyFramesView& frames, std::size_t index);

// That of the samples' type.
double saturation_level(const AnyFramesView& frames, const ToneCurve& curve);

bool holds_integers(const AnyFramesView& frames);

// Refuses views without rows or columns, and floating-point samples that are not finite.
void check(const AnyFramesView& frames);

}  // namespace ocisac
