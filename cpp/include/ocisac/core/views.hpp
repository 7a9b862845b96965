// Non-owning strided views of pixels: (frames, rows, columns), rows in time order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <variant>

#include "ocisac/core/region.hpp"

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

// Every `step`-th frame of a view, from frame `first` on.
inline AnyFramesView every_frame(const AnyFramesView& frames, std::size_t first, std::size_t step) {
  return std::visit(
      [&](auto view) -> AnyFramesView {
        view.data = view.at(first, 0, 0);
        view.frames = (view.frames - first + step - 1) / step;
        view.frame_stride *= static_cast<std::ptrdiff_t>(step);
        return view;
      },
      frames);
}

}  // namespace ocisac
