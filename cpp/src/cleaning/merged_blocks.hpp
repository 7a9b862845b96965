// Means of neighbouring pixels that are known.
#pragma once

#include <cstddef>
#include <vector>

namespace ocisac {

// Light and its noise variance (rows × columns); infinite variance: unknown.
struct Blocks {
  std::size_t rows = 0, columns = 0;
  std::vector<double> light, variance;
};

// Means of the known ones of `count` neighbours, down the rows or along them; the last ones have what is left.
Blocks merged_down(const Blocks& from, std::size_t count);
Blocks merged_along(const Blocks& from, std::size_t count);

}  // namespace ocisac
