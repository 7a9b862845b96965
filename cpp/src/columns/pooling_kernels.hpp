// Rows of samples pooled by weights of their columns, compiled once for each SIMD target.
#pragma once

#include "columns/row_kernels.hpp"

namespace ocisac::kernels {

// (rows) Σ weight·sample over the columns, in float64 with the same rounding on every target: eight sums of every
// eighth column, then these in order, then the columns that are left.
template <class T>
void pool_rows(const StoredRows<T>& from, const double* weights, double* to);

}  // namespace ocisac::kernels
