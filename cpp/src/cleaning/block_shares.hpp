// Shares of blocks: checks, and places between the blocks.
#pragma once

#include <algorithm>
#include <cstddef>

#include "ocisac/cleaning/restore_picture.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

constexpr std::size_t blocks_of(std::size_t length, std::size_t block) { return (length + block - 1) / block; }

// Share of a pixel in a picture with `columns` columns.
inline double share_at(const BlockShares& shares, std::size_t row, std::size_t column, std::size_t columns) {
  const std::size_t across = blocks_of(columns, shares.block_columns);
  return shares.share[row / shares.block_rows * across + column / shares.block_columns];
}

// Linear interpolation between the centres of blocks along one axis; constant beyond the outer ones.
struct BetweenBlocks {
  std::size_t before, after;
  double weight;  // of `after`
};

inline BetweenBlocks place_in_blocks(std::size_t pixel, std::size_t block, std::size_t count) {
  const double at = (static_cast<double>(pixel) + 0.5) / static_cast<double>(block) - 0.5;
  const double within = std::clamp(at, 0.0, static_cast<double>(count - 1));
  const auto before = static_cast<std::size_t>(within);
  return {before, std::min(before + 1, count - 1), within - static_cast<double>(before)};
}

inline void check(const BlockShares& shares, std::size_t rows, std::size_t columns) {
  require(shares.block_rows > 0 && shares.block_columns > 0, "block_rows, block_columns", 0, "1 or more");
  require(shares.share.size() == blocks_of(rows, shares.block_rows) * blocks_of(columns, shares.block_columns), "share",
          shares.share.size(), "one value a block");
}

}  // namespace ocisac
