// Rows of samples pooled by weights of their columns, compiled once for each SIMD target.
#pragma once

#include <cstddef>
#include <cstdint>

namespace ocisac::kernels {

// Rows of contiguous columns, `stride` samples apart.
template <class T>
struct PooledRows {
  const T* samples;
  std::ptrdiff_t stride;
  std::size_t rows, columns;
};

// (rows) Σ weight·sample over the columns, in float64 with the same rounding on every target: eight sums of every
// eighth column, then these in order, then the columns that are left.
template <class T>
void pool_rows(const PooledRows<T>& from, const double* weights, double* to);

}  // namespace ocisac::kernels
