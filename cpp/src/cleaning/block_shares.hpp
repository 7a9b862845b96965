// Checks of shares of blocks.
#pragma once

#include <cstddef>

#include "ocisac/cleaning/restore_picture.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

constexpr std::size_t blocks_of(std::size_t length, std::size_t block) { return (length + block - 1) / block; }

inline void check(const BlockShares& shares, std::size_t rows, std::size_t columns) {
  require(shares.block_rows > 0 && shares.block_columns > 0, "block_rows, block_columns", 0, "1 or more");
  require(shares.share.size() == blocks_of(rows, shares.block_rows) * blocks_of(columns, shares.block_columns), "share",
          shares.share.size(), "one value a block");
}

}  // namespace ocisac
