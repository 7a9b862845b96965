// Means of neighbouring pixels that are known, and of rows.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/cleaning/light_share.hpp"
#include "ocisac/cleaning/restore_picture.hpp"

namespace ocisac {

constexpr std::size_t kEnoughPixels = 1U << 17U;  // for what is estimated once or varies slowly
constexpr std::size_t kEnoughColumns = 64;        // or bundles of them, for what the columns have in common
constexpr std::size_t kMostGroups = 12;           // of columns, whose agreement is compared

// Means of the known ones of `height` × `width` pixels of the sum of several colours; the last blocks have what is
// left.
Blocks block_means(std::span<const BandedPicture> colours, std::size_t height, std::size_t width);
Blocks block_means(const BandedPicture& picture, std::size_t height, std::size_t width);

// Means of the unsaturated pixels of `merged` neighbouring columns. `stored`: one frame, each value below the table's
// length.
template <class Sample>
Blocks merge_columns(const FramesView<const Sample>& stored, std::size_t merged, const StoredTable& table);

// Means of `count` rows within each frame; the last of a frame has what is left. row_light: (frames × rows).
std::vector<double> means_of_rows(std::span<const double> row_light, std::size_t rows, std::size_t count);

}  // namespace ocisac
