// Stored samples of any layout as dense rows, for loops over frames.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

#include "columns/row_kernels.hpp"
#include "ocisac/core/region.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Largest blocks of copies: of bytes, both halves fit into the second-level cache; wider samples into the first.
struct BlockSize {
  std::size_t rows, columns;
};
inline constexpr BlockSize kCopied{128, 2048}, kTransposed{2048, 192};

// visit(part) for each part of `columns` columns.
template <class Visit>
void for_each_part(std::size_t columns, std::size_t largest, Visit visit) {
  for (std::size_t begin = 0; begin < columns; begin += largest)
    visit(IndexRange{begin, std::min(begin + largest, columns)});
}

// Stored samples of any layout as dense rows: the frame's own memory or copies, or what a table says of each sample.
template <class Stored, class Sample>
class DenseRows {
 public:
  DenseRows(const FramesView<const Stored>& view, std::size_t frame, std::span<const float> light)
      : view_(view), frame_(frame), dense_(view.column_stride == 1 || view.columns == 1), light_(light) {
    if constexpr (kFromBytes) table_.emplace(light);
  }

  [[nodiscard]] bool in_place() const { return dense_ && !kConverted; }
  // Bytes to the frame after this one, which the same thread reads next; 0: none, or copies.
  [[nodiscard]] std::ptrdiff_t to_next_frame() const {
    return in_place() && frame_ + 1 < view_.frames ? view_.frame_stride : 0;
  }
  // Read-out along the stored rows, of bytes.
  [[nodiscard]] bool is_transposed() const {
    return std::is_same_v<Stored, std::uint8_t> && !dense_ && std::abs(view_.row_stride) == 1;
  }

  // The largest block: in place it is that one.
  [[nodiscard]] BlockSize largest_block(BlockSize whole) const {
    return in_place() ? whole : is_transposed() ? kTransposed : kCopied;
  }

  // Valid until the next call, unless in place. `to_next`: offset to the samples that will be read next.
  kernels::StoredRows<Sample> read(std::size_t row, std::size_t rows, IndexRange columns, std::ptrdiff_t to_next = 0) {
    kernels::StoredRows<Stored> stored{view_.at(frame_, row, columns.begin), view_.row_stride, to_next, rows,
                                       columns.size()};
    if (!dense_) copy(row, columns, stored);
    if constexpr (!kConverted) {
      return stored;
    } else {
      converted_.resize(rows * columns.size());
      if constexpr (kFromBytes)
        kernels::look_up(stored, *table_, converted_.data());
      else
        kernels::look_up(stored, light_.data(), converted_.data());
      return {converted_.data(), static_cast<std::ptrdiff_t>(columns.size()), 0, rows, columns.size()};
    }
  }

 private:
  static constexpr bool kConverted = !std::is_same_v<Stored, Sample>;
  static constexpr bool kFromBytes = kConverted && std::is_same_v<Stored, std::uint8_t>;

  // Rows from `row` on, into dense memory.
  void copy(std::size_t row, IndexRange columns, kernels::StoredRows<Stored>& to) {
    copied_.resize(to.rows * columns.size());
    to.samples = copied_.data();
    to.stride = static_cast<std::ptrdiff_t>(columns.size());
    to.to_next = 0;
    if constexpr (std::is_same_v<Stored, std::uint8_t>) {
      if (is_transposed()) {
        const bool backwards = view_.row_stride < 0;
        kernels::transpose_bytes(view_.at(frame_, backwards ? row + to.rows - 1 : row, columns.begin),
                                 view_.column_stride, to.rows, columns.size(), copied_.data());
        if (!backwards) return;
        to.samples += static_cast<std::ptrdiff_t>(to.rows - 1) * to.stride;
        to.stride = -to.stride;
        return;
      }
      if (view_.column_stride > 1) {
        for (std::size_t r = 0; r < to.rows; ++r)
          kernels::take_every(view_.at(frame_, row + r, columns.begin), static_cast<std::size_t>(view_.column_stride),
                              columns.size(), copied_.data() + r * columns.size());
        return;
      }
    }
    for_each_part(columns.size(), kernels::kLine / sizeof(Stored), [&](IndexRange part) {
      for (std::size_t r = 0; r < to.rows; ++r)
        for (std::size_t c = part.begin; c < part.end; ++c)
          copied_[r * columns.size() + c] = view_(frame_, row + r, columns.begin + c);
    });
  }

  const FramesView<const Stored>& view_;
  std::size_t frame_;
  bool dense_;
  std::span<const float> light_;
  std::optional<kernels::ByteTable> table_;
  std::vector<Stored> copied_;
  std::vector<Sample> converted_;
};

}  // namespace ocisac
