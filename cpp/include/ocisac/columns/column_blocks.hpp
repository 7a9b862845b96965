// Neighbouring columns summed: few signals of low noise in place of a wide frame.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/core/views.hpp"

namespace ocisac {

// Block b of a frame is the sum of columns [b·width, (b+1)·width), in DN: a memoryless tone curve keeps every period,
// so that a frequency needs no linear light.
struct ColumnBlocks {
  std::size_t frames, rows, columns;
  std::size_t blocks;                   // in a frame
  std::size_t width;                    // columns in a block; the last one may have fewer
  std::vector<double> signals;          // (frames · blocks × rows), each less its mean
  std::vector<double> saturated_share;  // (blocks): pixels at or above the saturation level
};

// At most 64 blocks a frame, fewer when there are many frames. `saturation`: DN; NaN where there is no such level.
ColumnBlocks column_blocks(const AnyFramesView& frames, double saturation);

}  // namespace ocisac
