// Means of neighbouring rows.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

// Means of `count` rows within each frame; the last of a frame has what is left. row_light: (frames × rows).
inline std::vector<double> means_of_rows(std::span<const double> row_light, std::size_t rows, std::size_t count) {
  std::vector<double> means;
  for (std::size_t frame = 0; frame < row_light.size(); frame += rows)
    for (std::size_t first = 0; first < rows; first += count) {
      const std::size_t end = std::min(first + count, rows);
      double sum = 0;
      for (std::size_t n = first; n < end; ++n) sum += row_light[frame + n];
      means.push_back(sum / static_cast<double>(end - first));
    }
  return means;
}

}  // namespace ocisac
