// Sums over the surroundings of every pixel that end at edges: a recursive edge-aware filter (cf. Gastal and Oliveira
// 2011, domain transform).
#pragma once

#include <cstddef>
#include <vector>

namespace ocisac {

// Sums over columns and rows of a picture; each value is weighted with the product of the passages on the way. `down`,
// `across`: (rows × columns), passage from each pixel to the next row and column; the last ones are not used.
class EdgeAwareFilter {
 public:
  EdgeAwareFilter(std::size_t rows, std::size_t columns);

  void along_columns(const std::vector<double>& down, std::vector<double>& values);

  // Along columns, rows, rows and columns, in three passes over the picture.
  void all_around(const std::vector<double>& down, const std::vector<double>& across, std::vector<double>& values);

 private:
  void sum_from_below(const std::vector<double>& down, const std::vector<double>& values);
  void add_columns(const std::vector<double>& down, std::size_t row, std::vector<double>& values) const;
  void sum_from_above(const std::vector<double>& down, std::size_t row, const std::vector<double>& values);
  void add_from_below(const std::vector<double>& down, std::vector<double>& values);
  void along_rows_twice(const std::vector<double>& across, std::size_t first, std::size_t end,
                        std::vector<double>& values);

  std::size_t rows_, columns_;
  std::vector<double> back_;  // one picture
  std::vector<double> lines_;
};

}  // namespace ocisac
