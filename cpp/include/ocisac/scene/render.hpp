// Frames from the parts of a planned scene.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "ocisac/core/views.hpp"

namespace ocisac {

// A rectangle of pixels whose light follows one table of row integrals (eq. 4):
//
//   value(y, x) = gain(y, x)·table[y·phases + phase(y, x)]   (DN), y and x within the rectangle
//
// The memory belongs to the caller.
struct ScenePart {
  Region region;
  float gain = 1;                        // of every pixel where `gains` is absent
  const float* gains = nullptr;          // height × width
  const std::uint32_t* spans = nullptr;  // height × 2: first pixel and the one after the last; absent: all of them
  std::size_t phases = 1;
  const std::uint16_t* phase = nullptr;  // height × width, below `phases`; absent: 0 everywhere
  const float* table = nullptr;          // height × phases: the mean light over each row's exposure
};

// Throws for a part that leaves the frame, a phase at or above `phases`, a span outside the rectangle.
void check(const ScenePart& part, std::size_t rows, std::size_t columns);

// Light (DN) under the parts: an image of rows × columns where `image` is given, else `level` everywhere.
struct SceneBase {
  float level = 0;
  const float* image = nullptr;
};

// Sum of the parts over the base. Integers are rounded to nearest and clipped to [0, `white`] (DN); floats are not.
// Rows that only parts of uniform gain reach are filled in runs, at memory speed. The parts must have passed `check`
// for this frame.
template <class T>
void render_parts(std::span<const ScenePart> parts, const SceneBase& base, float white, int threads,
                  const FramesView<T>& frame);

}  // namespace ocisac
