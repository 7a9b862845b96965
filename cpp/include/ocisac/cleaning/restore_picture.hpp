// Stored integers to sums of linear light, and back to integers under steady light, by tables of all stored values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "ocisac/core/views.hpp"

namespace ocisac {

// Linear light of each stored value, ascending, and its noise variance: infinite where a value is saturated.
struct StoredLight {
  std::span<const double> light, variance;
};

struct MergedPicture {
  std::vector<double> light, variance;  // (rows × ceil(columns/merged)); variance infinite where all are saturated
};

// Means of the unsaturated pixels of `merged` neighbouring columns. `stored`: one frame, each value below the tables'
// length.
template <class Sample>
MergedPicture merge_columns(const FramesView<const Sample>& stored, std::size_t merged, const StoredLight& table);

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
// gains are bounded.
// `bounds`: (values − 1) light at which the stored value changes from one to the next. The picture may be the stored
// one.
template <class Sample>
void restore_picture(const FramesView<const Sample>& stored, const BlockShares& shares, const Restoration& to,
                     const StoredLight& table, std::span<const double> bounds, const RestoredPicture<Sample>& result);

}  // namespace ocisac
