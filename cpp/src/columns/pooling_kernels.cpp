// Rows of samples pooled by weights of their columns, compiled once for each SIMD target.
#include <algorithm>
#include <type_traits>

#include "columns/row_kernels.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "columns/pooling_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/cache_control.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kSums = 8;   // of a row, for vectors of any target
constexpr std::size_t kGroup = 4;  // rows pooled at once: they share weights and hide each other's latency
constexpr std::size_t kAhead = 8;  // rows that are asked for early: the processor foresees no line of the next row

const hn::CappedTag<double, kSums> d_sum;

template <class T>
HWY_INLINE hn::Vec<decltype(d_sum)> load(const T* samples) {
  const auto stored = hn::LoadU(hn::Rebind<T, decltype(d_sum)>(), samples);
  if constexpr (std::is_integral_v<T>)
    return hn::PromoteTo(d_sum, hn::PromoteTo(hn::Rebind<std::int32_t, decltype(d_sum)>(), stored));
  else if constexpr (std::is_same_v<T, float>)
    return hn::PromoteTo(d_sum, stored);
  else
    return stored;
}

template <class T>
HWY_INLINE double pooled(const double* sums, const T* row, const double* weights, std::size_t first, std::size_t end) {
  double sum = 0;
  for (std::size_t k = 0; k < kSums; ++k) sum += sums[k];
  for (std::size_t c = first; c < end; ++c) sum += weights[c] * static_cast<double>(row[c]);
  return sum;
}

// The rows need not be different.
template <class T>
HWY_INLINE void pool_group(const T* const (&rows)[kGroup], std::size_t columns, const double* weights,
                           double* const (&to)[kGroup]) {
  alignas(64) double sums[kGroup][kSums];
  const std::size_t whole = columns / kSums * kSums;
  for (std::size_t part = 0; part < kSums; part += hn::Lanes(d_sum)) {
    auto a = hn::Zero(d_sum), b = a, c = a, d = a;
    for (std::size_t column = part; column < whole; column += kSums) {
      const auto weight = hn::LoadU(d_sum, weights + column);
      a = hn::Add(a, hn::Mul(weight, load(rows[0] + column)));
      b = hn::Add(b, hn::Mul(weight, load(rows[1] + column)));
      c = hn::Add(c, hn::Mul(weight, load(rows[2] + column)));
      d = hn::Add(d, hn::Mul(weight, load(rows[3] + column)));
    }
    hn::Store(a, d_sum, sums[0] + part);
    hn::Store(b, d_sum, sums[1] + part);
    hn::Store(c, d_sum, sums[2] + part);
    hn::Store(d, d_sum, sums[3] + part);
  }
  for (std::size_t r = 0; r < kGroup; ++r) *to[r] = pooled(sums[r], rows[r], weights, whole, columns);
}

template <class T>
HWY_INLINE void pool_all(const StoredRows<T>& from, const double* weights, double* to) {
  for (std::size_t first = 0; first < from.rows; first += kGroup) {
    const T* rows[kGroup];
    double* sums[kGroup];
    for (std::size_t row = first + kAhead; row < std::min(first + kAhead + kGroup, from.rows); ++row)
      for (std::size_t column = 0; column < from.columns; column += kLine / sizeof(T))
        hwy::Prefetch(from.samples + static_cast<std::ptrdiff_t>(row) * from.stride + column);
    for (std::size_t r = 0; r < kGroup; ++r) {
      const std::size_t row = std::min(first + r, from.rows - 1);
      rows[r] = from.samples + static_cast<std::ptrdiff_t>(row) * from.stride;
      sums[r] = to + row;
    }
    pool_group(rows, from.columns, weights, sums);
  }
}

void PoolRows(const AnyStoredRows& from, const double* weights, double* to) {
  std::visit([=](const auto& rows) HWY_ATTR { pool_all(rows, weights, to); }, from);
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace ocisac::kernels {

HWY_EXPORT(PoolRows);

void pool_rows(const AnyStoredRows& from, const double* weights, double* to) {
  HWY_DYNAMIC_DISPATCH(PoolRows)(from, weights, to);
}

}  // namespace ocisac::kernels
#endif
