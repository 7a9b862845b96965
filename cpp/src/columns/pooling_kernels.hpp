// Rows of samples pooled by weights of their columns, compiled once for each SIMD target.
#pragma once

#include <cstdint>
#include <variant>

#include "columns/row_kernels.hpp"

namespace ocisac::kernels {

using AnyStoredRows =
    std::variant<StoredRows<std::uint8_t>, StoredRows<std::uint16_t>, StoredRows<float>, StoredRows<double>>;

// (rows) Σ weight·sample over the columns, in float64 with the same rounding on every target: eight sums of every
// eighth column, then these in order, then the columns that are left.
void pool_rows(const AnyStoredRows& from, const double* weights, double* to);

}  // namespace ocisac::kernels
