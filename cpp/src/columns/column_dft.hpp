// Filters of many columns at once by their DFT, one pair of columns in each lane of a vector.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "columns/column_dft_kernels.hpp"

namespace ocisac {

// A block is (length × 2·kColumnPairs<T>): column c is the real part of a complex signal, column c + kColumnPairs the
// imaginary one. All is done in place, and spectra stay in the order in which the steps of the transform leave them:
// row n of a spectrum is the frequency order()[n]. T: float or double.
template <class T>
class ColumnDft {
 public:
  // length: 2^a·3^b·5^c
  explicit ColumnDft(std::size_t length);
  ColumnDft(ColumnDft&&) noexcept = default;  // not copied: steps_ points into turns_
  ColumnDft& operator=(ColumnDft&&) noexcept = default;

  [[nodiscard]] std::size_t length() const { return order_.size(); }
  [[nodiscard]] std::span<const std::size_t> order() const { return order_; }

  // Transforms the first `pairs` pairs; the others may change.
  void forward(T* block, std::size_t pairs) const { run(0, block, nullptr, pairs, true, false); }
  void inverse(T* block, std::size_t pairs) const { run(0, block, nullptr, pairs, false, true); }  // not scaled

  // The DFT, its product with a gain and the inverse: gain (length × 2) in the order of spectra, real and imaginary
  // part, with the scale of the inverse.
  void filter(T* block, const T* gain, std::size_t pairs) const { run(0, block, gain, pairs, true, true); }

 private:
  void run(std::size_t first, T* rows, const T* gain, std::size_t pairs, bool forward, bool inverse) const;

  std::vector<std::size_t> order_;
  std::vector<std::vector<T>> turns_;
  std::vector<kernels::DftStep<T>> steps_;
};

}  // namespace ocisac
