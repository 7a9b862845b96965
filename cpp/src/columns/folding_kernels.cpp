#include "columns/folding_kernels.hpp"

#include <algorithm>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "columns/folding_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

const hn::ScalableTag<double> d64;
using Vector = hn::Vec<decltype(d64)>;

HWY_INLINE Vector load(const double* from) { return hn::LoadU(d64, from); }
HWY_INLINE Vector load(const float* from) {
  return hn::PromoteTo(d64, hn::LoadU(hn::Rebind<float, decltype(d64)>(), from));
}
template <class T>
HWY_INLINE Vector load(const T* from) {
  const hn::Rebind<std::int32_t, decltype(d64)> d32;
  return hn::PromoteTo(d64, hn::PromoteTo(d32, hn::LoadU(hn::Rebind<T, decltype(d64)>(), from)));
}

// kVectors vectors of columns: their sums stay in registers.
template <std::size_t kVectors, class T>
HWY_INLINE void fold_columns(const FoldedRows<T>& from, std::size_t column, const double* weights, double* folded,
                             const DifferenceSums& sums) {
  const std::size_t lanes = hn::Lanes(d64);
  Vector start[kVectors], sum[kVectors], squares[kVectors];
  for (std::size_t v = 0; v < kVectors; ++v) {
    start[v] = load(from.rows + column + v * lanes);
    sum[v] = squares[v] = hn::Zero(d64);
  }
  for (std::size_t m = 0; m < from.length; ++m) {
    Vector cosine[kVectors], sine[kVectors];
    for (std::size_t v = 0; v < kVectors; ++v) cosine[v] = sine[v] = hn::Zero(d64);
    for (std::size_t j = 0; j < from.folds; ++j) {
      const T* row = from.rows + static_cast<std::ptrdiff_t>(j * from.length + m) * from.stride + column;
      const Vector of_cosine = hn::Set(d64, weights[j]), of_sine = hn::Set(d64, weights[from.folds + j]);
      for (std::size_t v = 0; v < kVectors; ++v) {
        const Vector value = hn::Sub(load(row + v * lanes), start[v]);
        cosine[v] = hn::MulAdd(of_cosine, value, cosine[v]);
        sine[v] = hn::MulAdd(of_sine, value, sine[v]);
        sum[v] = hn::Add(sum[v], value);
        squares[v] = hn::MulAdd(value, value, squares[v]);
      }
    }
    for (std::size_t v = 0; v < kVectors; ++v) {
      double* const to = folded + m * from.count + column + v * lanes;
      hn::StoreU(cosine[v], d64, to);
      hn::StoreU(sine[v], d64, to + from.length * from.count);
    }
  }
  for (std::size_t v = 0; v < kVectors; ++v) {
    hn::StoreU(sum[v], d64, sums.sum + column + v * lanes);
    hn::StoreU(squares[v], d64, sums.squares + column + v * lanes);
  }
}

// The last columns, fewer than a vector: in a padded copy.
template <class T>
void fold_rest(const FoldedRows<T>& from, std::size_t column, const double* weights, double* folded,
               const DifferenceSums& sums) {
  const std::size_t lanes = hn::Lanes(d64), rest = from.count - column, rows = from.folds * from.length;
  std::vector<T> padded(rows * lanes);
  for (std::size_t n = 0; n < rows; ++n)
    std::copy_n(from.rows + static_cast<std::ptrdiff_t>(n) * from.stride + column, rest, &padded[n * lanes]);
  std::vector<double> out((2 * from.length + 2) * lanes);
  double* const sum = out.data() + 2 * from.length * lanes;
  fold_columns<1, T>({padded.data(), static_cast<std::ptrdiff_t>(lanes), lanes, from.folds, from.length}, 0, weights,
                     out.data(), {sum, sum + lanes});
  for (std::size_t m = 0; m < 2 * from.length; ++m)
    std::copy_n(&out[m * lanes], rest, folded + m * from.count + column);
  std::copy_n(sum, rest, sums.sum + column);
  std::copy_n(sum + lanes, rest, sums.squares + column);
}

template <class T>
void fold_all(const FoldedRows<T>& from, const double* weights, double* folded, const DifferenceSums& sums) {
  constexpr std::size_t kVectors = 4;
  const std::size_t lanes = hn::Lanes(d64);
  std::size_t c = 0;
  for (; c + kVectors * lanes <= from.count; c += kVectors * lanes)
    fold_columns<kVectors>(from, c, weights, folded, sums);
  for (; c + lanes <= from.count; c += lanes) fold_columns<1>(from, c, weights, folded, sums);
  if (c < from.count) fold_rest(from, c, weights, folded, sums);
}

void FoldUint8(const FoldedRows<std::uint8_t>& from, const double* weights, double* to, const DifferenceSums& sums) {
  fold_all(from, weights, to, sums);
}
void FoldUint16(const FoldedRows<std::uint16_t>& from, const double* weights, double* to, const DifferenceSums& sums) {
  fold_all(from, weights, to, sums);
}
void FoldFloat(const FoldedRows<float>& from, const double* weights, double* to, const DifferenceSums& sums) {
  fold_all(from, weights, to, sums);
}
void FoldDouble(const FoldedRows<double>& from, const double* weights, double* to, const DifferenceSums& sums) {
  fold_all(from, weights, to, sums);
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(FoldUint8);
HWY_EXPORT(FoldUint16);
HWY_EXPORT(FoldFloat);
HWY_EXPORT(FoldDouble);

template <>
void fold(const FoldedRows<std::uint8_t>& from, const double* weights, double* folded, const DifferenceSums& sums) {
  HWY_DYNAMIC_DISPATCH(FoldUint8)(from, weights, folded, sums);
}
template <>
void fold(const FoldedRows<std::uint16_t>& from, const double* weights, double* folded, const DifferenceSums& sums) {
  HWY_DYNAMIC_DISPATCH(FoldUint16)(from, weights, folded, sums);
}
template <>
void fold(const FoldedRows<float>& from, const double* weights, double* folded, const DifferenceSums& sums) {
  HWY_DYNAMIC_DISPATCH(FoldFloat)(from, weights, folded, sums);
}
template <>
void fold(const FoldedRows<double>& from, const double* weights, double* folded, const DifferenceSums& sums) {
  HWY_DYNAMIC_DISPATCH(FoldDouble)(from, weights, folded, sums);
}

}  // namespace ocisac::kernels
#endif
