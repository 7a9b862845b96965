// Blocks of columns in the order of memory, for kernels with one column in each lane.
#pragma once

#include <algorithm>
#include <cstddef>
#include <variant>

#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

// Linear light of columns first … first + count in memory order: (rows × width), 0 in columns beyond `count`.
template <class T>
void light_rows(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                const ToneCurve& curve, std::size_t width, T* block) {
  if (curve.kind != ToneCurve::Kind::linear) {
    const auto signals = column_signals(frames, frame, first, count, curve);
    const std::size_t rows = signals.size() / count;
    for (std::size_t row = 0; row < rows; ++row)
      for (std::size_t c = 0; c < width; ++c)
        block[row * width + c] = c < count ? static_cast<T>(signals[c * rows + row]) : T{0};
    return;
  }
  const T dark = static_cast<T>(curve.dark_level);
  std::visit(
      [&]<class S>(const FramesView<const S>& view) {
        for (std::size_t row = 0; row < view.rows; ++row) {
          const S* const samples = view.at(frame, row, first);
          T* const to = block + row * width;
          if (view.column_stride == 1)
            for (std::size_t c = 0; c < count; ++c) to[c] = static_cast<T>(samples[c]) - dark;
          else
            for (std::size_t c = 0; c < count; ++c) to[c] = static_cast<T>(view(frame, row, first + c)) - dark;
          std::fill(to + count, to + width, T{0});
        }
      },
      frames);
}

}  // namespace ocisac
