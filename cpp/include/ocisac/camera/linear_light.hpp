// Pixel columns as signals of linear light.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Columns [first, first + count) of one frame as dense signals (count × rows) of linear light above dark, float64.
std::vector<double> column_signals(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                                   const ToneCurve& curve);

// Linear light above dark of each value of an integer sample.
struct LightTable {
  std::vector<double> light;
  std::vector<float> rounded;  // the same in float32, for passes over frames
};
// For uint8 and uint16; null for floating-point samples. Kept for later calls (the 4 last used).
std::shared_ptr<const LightTable> light_table(const AnyFramesView& frames, const ToneCurve& curve);

struct Shape {
  std::size_t frames, rows, columns;
};
Shape shape_of(const AnyFramesView& frames);
AnyFramesView frame_of(const AnyFramesView& frames, std::size_t index);

// Those of the samples' type.
double sample_maximum(const AnyFramesView& frames);
double saturation_level(const AnyFramesView& frames, const ToneCurve& curve);

bool holds_integers(const AnyFramesView& frames);

inline constexpr double kMostLight = 1e60;  // whose fourth powers are numbers

// Refuse views without rows or columns; floating-point samples that are not finite, or above `most`; both.
void check_shape(const AnyFramesView& frames);
void check_samples(const AnyFramesView& frames, double most = kInfinity);
void check(const AnyFramesView& frames, double most = kInfinity);

}  // namespace ocisac
