// Sums of neighbouring columns: few signals of low noise represent a wide frame.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/core/views.hpp"

namespace ocisac {

// Groups of neighbouring columns of a frame: a light of 1/64 of its width fills one.
inline constexpr std::size_t kMaxBlocks = 64;

// Block b of a frame is the sum of columns [b·width, (b+1)·width), in DN: a memoryless tone curve preserves every
// period, so a frequency estimate needs no linear light.
struct ColumnBlocks {
  std::size_t frames, rows, columns;
  std::size_t blocks;                   // per frame
  std::size_t width;                    // columns in a block; the last one may have fewer
  std::vector<double> signals;          // (frames · blocks × rows), mean removed
  std::vector<double> saturated_share;  // (blocks): fraction of pixels at or above the saturation level
};

// At most 64 blocks per frame, fewer for many frames. `saturation`: DN; NaN without such a level.
ColumnBlocks column_blocks(const AnyFramesView& frames, double saturation);

}  // namespace ocisac
