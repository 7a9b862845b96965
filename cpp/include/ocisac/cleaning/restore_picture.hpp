// Stored integers to sums of linear light, and back to integers under steady light, by tables of all stored values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "ocisac/core/views.hpp"

namespace ocisac {

// Light and noise that each stored value stands for.
struct StoredTable {
  std::vector<double> light;     // linear, ascending
  std::vector<double> variance;  // of its noise; infinite where a value is saturated
  std::vector<double> bounds;    // (values − 1) light at which the stored value changes from one to the next
};

// Shares of the light in blocks of pixels; between the blocks' centres they are interpolated.
struct BlockShares {
  std::vector<double> share;  // (ceil(rows/block_rows) × ceil(columns/block_columns))
  std::size_t block_rows = 1, block_columns = 1;

  [[nodiscard]] bool is_one() const;  // all pixels have the same share
};

// Light of the rows of one frame, mean 1; level of the steady light; largest gain.
struct Restoration {
  std::span<const double> rows;
  double level = 1, max_gain = 8;
};

enum class PixelMark : std::uint8_t { restored = 0, saturated = 1, dark = 2 };

// Where one frame is written to; marks and shares without memory are not.
template <class Sample>
struct RestoredPicture {
  FramesView<Sample> picture;
  FramesView<std::uint8_t> marks = {};  // PixelMark
  FramesView<float> share = {};         // of each pixel
};

// v·(1 + q·(level − 1))/(1 + q·(L − 1)) of every pixel; saturated ones are unchanged, others stay below saturation, and
// gains are bounded. `stored`: one frame, each value below the table's length. The picture may be the stored one.
template <class Sample>
void restore_picture(const FramesView<const Sample>& stored, const BlockShares& shares, const Restoration& to,
                     const StoredTable& table, const RestoredPicture<Sample>& result);

}  // namespace ocisac
