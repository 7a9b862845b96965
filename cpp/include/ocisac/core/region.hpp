// A rectangle of pixels.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>

#include "ocisac/core/require.hpp"

namespace ocisac {

// Pixels: x, columns, and y, rows, of the top left corner. Rows are in time order, unless a name says stored.
struct Region {
  std::size_t x = 0, y = 0, width = 0, height = 0;

  [[nodiscard]] std::size_t right() const { return x + width; }  // the first column behind it
  [[nodiscard]] std::size_t bottom() const { return y + height; }
  [[nodiscard]] std::size_t pixels() const { return width * height; }
  friend bool operator==(const Region&, const Region&) = default;
};

// [begin, end) of rows, columns or groups of them.
struct IndexRange {
  std::size_t begin = 0, end = 0;

  [[nodiscard]] std::size_t size() const { return end > begin ? end - begin : 0; }
};

// From the first to the last value that is not 0; empty where all are.
template <class Values>
IndexRange extent_of(const Values& values) {
  std::size_t begin = 0, end = values.size();
  while (begin < end && values[begin] == 0) ++begin;
  while (end > begin && values[end - 1] == 0) --end;
  return {begin, end};
}

// Length of the intersection of [a, a + a_size) and [b, b + b_size).
inline std::size_t shared_length(std::size_t a, std::size_t a_size, std::size_t b, std::size_t b_size) {
  const std::size_t begin = std::max(a, b), end = std::min(a + a_size, b + b_size);
  return end > begin ? end - begin : 0;
}

// Number of pixels in the intersection of two regions.
inline std::size_t shared_pixels(const Region& a, const Region& b) {
  return shared_length(a.x, a.width, b.x, b.width) * shared_length(a.y, a.height, b.y, b.height);
}

// Shared pixels divided by those of the smaller region, and of the larger one; 0 where that is empty.
inline double shared_of_smaller(const Region& a, const Region& b) {
  const std::size_t pixels = std::min(a.pixels(), b.pixels());
  return static_cast<double>(shared_pixels(a, b)) / static_cast<double>(std::max<std::size_t>(pixels, 1));
}
inline double shared_of_larger(const Region& a, const Region& b) {
  const std::size_t pixels = std::max(a.pixels(), b.pixels());
  return static_cast<double>(shared_pixels(a, b)) / static_cast<double>(std::max<std::size_t>(pixels, 1));
}

// The smallest region that contains both.
inline Region hull(const Region& a, const Region& b) {
  const std::size_t x = std::min(a.x, b.x), y = std::min(a.y, b.y);
  return {x, y, std::max(a.right(), b.right()) - x, std::max(a.bottom(), b.bottom()) - y};
}

// Wider by `margin` on each side, but not beyond the first row and column.
inline Region widened(const Region& region, std::size_t margin) {
  const std::size_t left = std::min(region.x, margin), up = std::min(region.y, margin);
  return {region.x - left, region.y - up, region.width + left + margin, region.height + up + margin};
}

// Holds for every value of `region`: no sum wraps.
inline bool is_inside(const Region& region, std::size_t columns, std::size_t rows) {
  return region.width >= 1 && region.height >= 1 && region.width <= columns && region.height <= rows &&
         region.x <= columns - region.width && region.y <= rows - region.height;
}

inline void require_inside(std::string_view argument, const Region& region, std::size_t columns, std::size_t rows) {
  if (is_inside(region, columns, rows)) return;
  refuse(argument,
         std::to_string(region.x) + "," + std::to_string(region.y) + "," + std::to_string(region.width) + "," +
             std::to_string(region.height),
         "inside the picture of " + std::to_string(columns) + "x" + std::to_string(rows));
}

}  // namespace ocisac
