// Means of neighbouring pixels that are known.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/cleaning/light_share.hpp"

namespace ocisac {

// Light and its noise variance (rows × columns); infinite variance: unknown.
struct Blocks {
  std::size_t rows = 0, columns = 0;
  std::vector<double> light, variance;

  [[nodiscard]] BandedPicture picture() const { return {light, variance, 1, rows, columns}; }
};

// A picture's pixels; the sums of those of several colours.
Blocks copy_of(const BandedPicture& picture);
Blocks sum_of(std::span<const BandedPicture> colours);

// Means of the known ones of `count` neighbours, down the rows or along them; the last ones have what is left.
Blocks merged_down(const Blocks& from, std::size_t count);
Blocks merged_along(const Blocks& from, std::size_t count);

}  // namespace ocisac
