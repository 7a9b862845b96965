// Sums of rows for a pruned DFT; compiled once for each SIMD target.
#pragma once

#include <cstddef>
#include <cstdint>

namespace ocisac::kernels {

// Rows `stride` apart of `count` samples. Row n = j·length + m.
template <class T>
struct FoldedRows {
  const T* rows;
  std::ptrdiff_t stride;
  std::size_t count, folds, length;
};

// (count) each: sums over rows of x(n) − x(0) and of its square, exactly 0 for steady columns.
struct DifferenceSums {
  double *sum, *squares;
};

// folded (2 × length × count): cosine and sine parts Σ_j weights(j)·(x(j·length + m) − x(0)); weights: (2 × folds).
// T: std::uint8_t, std::uint16_t, float, double.
template <class T>
void fold(const FoldedRows<T>& from, const double* weights, double* folded, const DifferenceSums& sums);

}  // namespace ocisac::kernels
