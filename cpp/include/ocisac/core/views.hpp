// Non-owning strided views of pixels: (frames, rows, columns), rows in time order.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <variant>

#include "ocisac/core/require.hpp"

namespace ocisac {

// Strides count elements, not bytes, and may be negative or zero. The viewed memory belongs to the caller.
template <class T>
struct FramesView {
  T* data = nullptr;
  std::size_t frames = 0;
  std::size_t rows = 0;
  std::size_t columns = 0;
  std::ptrdiff_t frame_stride = 0;
  std::ptrdiff_t row_stride = 0;
  std::ptrdiff_t column_stride = 0;

  [[nodiscard]] T* at(std::size_t frame, std::size_t row, std::size_t column) const {
    return data + static_cast<std::ptrdiff_t>(frame) * frame_stride + static_cast<std::ptrdiff_t>(row) * row_stride +
           static_cast<std::ptrdiff_t>(column) * column_stride;
  }
  T& operator()(std::size_t frame, std::size_t row, std::size_t column) const { return *at(frame, row, column); }

  [[nodiscard]] FramesView frame(std::size_t index) const {
    FramesView one = *this;
    one.data = at(index, 0, 0);
    one.frames = 1;
    return one;
  }
};

// A view of densely packed memory (C order).
template <class T>
FramesView<T> dense_view(T* data, std::size_t frames, std::size_t rows, std::size_t columns) {
  const auto row_stride = static_cast<std::ptrdiff_t>(columns);
  return {data, frames, rows, columns, static_cast<std::ptrdiff_t>(rows) * row_stride, row_stride, 1};
}

template <class T>
FramesView<const T> as_const(const FramesView<T>& view) {
  return {view.data, view.frames, view.rows, view.columns, view.frame_stride, view.row_stride, view.column_stride};
}

// Pixels of any supported type; std::visit gives the typed view.
using AnyFramesView = std::variant<FramesView<const std::uint8_t>, FramesView<const std::uint16_t>,
                                   FramesView<const float>, FramesView<const double>>;

// Pixels: x, columns, and y, rows in time order, of the top left corner.
struct Region {
  std::size_t x = 0, y = 0, width = 0, height = 0;
  friend bool operator==(const Region&, const Region&) = default;
};

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

// Length of the intersection of [a, a + a_size) and [b, b + b_size).
inline std::size_t shared_length(std::size_t a, std::size_t a_size, std::size_t b, std::size_t b_size) {
  const std::size_t begin = std::max(a, b), end = std::min(a + a_size, b + b_size);
  return end > begin ? end - begin : 0;
}

// Number of pixels in the intersection of two regions.
inline std::size_t shared_pixels(const Region& a, const Region& b) {
  return shared_length(a.x, a.width, b.x, b.width) * shared_length(a.y, a.height, b.y, b.height);
}

// The smallest region that contains both.
inline Region region_around(const Region& a, const Region& b) {
  const std::size_t x = std::min(a.x, b.x), y = std::min(a.y, b.y);
  return {x, y, std::max(a.x + a.width, b.x + b.width) - x, std::max(a.y + a.height, b.y + b.height) - y};
}

// The part of all frames of a view within a region; it must lie inside.
inline AnyFramesView part_of(const AnyFramesView& frames, const Region& region) {
  return std::visit(
      [&](auto view) -> AnyFramesView {
        view.data = view.at(0, region.y, region.x);
        view.rows = region.height;
        view.columns = region.width;
        return view;
      },
      frames);
}

}  // namespace ocisac
