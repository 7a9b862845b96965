// Sums over the surroundings of every pixel that end at edges: a recursive edge-aware filter (cf. Gastal and Oliveira
// 2011, domain transform).
#pragma once

#include <cstddef>
#include <vector>

namespace ocisac {

// Each value becomes the sum of those of its line, weighted with the product of the passages on the way. `down`,
// `across`: (rows × columns), passage from each pixel to the next row and column; the last ones are not used.
void sum_along_columns(const std::vector<double>& down, std::size_t columns, std::vector<double>& values);
void sum_along_rows(const std::vector<double>& across, std::size_t columns, std::vector<double>& values);

}  // namespace ocisac
