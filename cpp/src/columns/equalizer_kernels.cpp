#include "columns/equalizer_kernels.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "columns/equalizer_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kGroup = 16;  // rows summed in T before they are added in double

template <class T>
void lines_of_columns(const T* block, std::size_t rows, std::size_t width, const ColumnLines& lines) {
  const hn::ScalableTag<T> d;
  const std::size_t lanes = hn::Lanes(d);
  const double count = static_cast<double>(rows), middle = (count - 1) / 2;
  const double squares = count * (count * count - 1) / 12;
  for (std::size_t c = 0; c < width; c += lanes) {
    const auto start = hn::LoadU(d, block + c);
    auto reach = hn::Zero(d);
    std::array<double, kBlockAlignment> sums{}, moments{};
    for (std::size_t first = 0; first < rows; first += kGroup) {
      auto sum = hn::Zero(d), moment = hn::Zero(d);
      for (std::size_t n = first; n < std::min(first + kGroup, rows); ++n) {
        const auto value = hn::Sub(hn::LoadU(d, block + n * width + c), start);
        reach = hn::Max(reach, hn::Abs(value));
        sum = hn::Add(sum, value);
        moment = hn::MulAdd(hn::Set(d, static_cast<T>(n - first)), value, moment);
      }
      std::array<T, kBlockAlignment> part, of_moment;
      hn::StoreU(sum, d, part.data());
      hn::StoreU(moment, d, of_moment.data());
      for (std::size_t i = 0; i < lanes; ++i) {
        sums[i] += static_cast<double>(part[i]);
        moments[i] +=
            static_cast<double>(of_moment[i]) + (static_cast<double>(first) - middle) * static_cast<double>(part[i]);
      }
    }
    std::array<T, kBlockAlignment> reaches;
    hn::StoreU(reach, d, reaches.data());
    for (std::size_t i = 0; i < lanes; ++i) {
      lines.mean[c + i] = static_cast<double>(block[c + i]) + sums[i] / count;
      lines.slope[c + i] = squares > 0 ? moments[i] / squares : 0;
      lines.reach[c + i] = static_cast<double>(reaches[i]);
    }
  }
}

// Line of a column at rows from the middle, in T.
template <class T, class D>
HWY_INLINE void load_line(const ColumnLines& lines, std::size_t c, D d, hn::Vec<D>& mean, hn::Vec<D>& slope) {
  std::array<T, kBlockAlignment> means, slopes;
  for (std::size_t i = 0; i < hn::Lanes(d); ++i) {
    means[i] = static_cast<T>(lines.mean[c + i]);
    slopes[i] = static_cast<T>(lines.slope[c + i]);
  }
  mean = hn::LoadU(d, means.data());
  slope = hn::LoadU(d, slopes.data());
}

template <class T, class D>
HWY_INLINE hn::Vec<D> load_as(const double* values, D d) {
  std::array<T, kBlockAlignment> converted;
  for (std::size_t i = 0; i < hn::Lanes(d); ++i) converted[i] = static_cast<T>(values[i]);
  return hn::LoadU(d, converted.data());
}

// Replaces each value by change(value, line, factor); the line is that of a row `later` rows behind.
template <class T, class Change>
HWY_INLINE void change_by_line(T* block, std::size_t rows, std::size_t width, const ColumnLines& lines,
                               const double* scale, double later, Change change) {
  const hn::ScalableTag<T> d;
  const double middle = (static_cast<double>(rows) - 1) / 2;
  for (std::size_t c = 0; c < width; c += hn::Lanes(d)) {
    hn::Vec<decltype(d)> mean, slope;
    load_line<T>(lines, c, d, mean, slope);
    const auto factor = load_as<T>(scale + c, d);
    for (std::size_t n = 0; n < rows; ++n) {
      T* const at = block + n * width + c;
      const auto line = hn::MulAdd(slope, hn::Set(d, static_cast<T>(static_cast<double>(n) + later - middle)), mean);
      hn::StoreU(change(hn::LoadU(d, at), line, factor), d, at);
    }
  }
}

template <class T>
void take_off(T* block, std::size_t rows, std::size_t width, const ColumnLines& lines, const double* scale) {
  change_by_line(block, rows, width, lines, scale, 0.0,
                 [](auto value, auto line, auto factor) HWY_ATTR { return hn::Mul(hn::Sub(value, line), factor); });
}

template <class T>
void put_back(T* block, std::size_t rows, std::size_t width, const ColumnLines& lines, const double* scale,
              double later) {
  change_by_line(block, rows, width, lines, scale, later,
                 [](auto value, auto line, auto factor) HWY_ATTR { return hn::MulAdd(value, factor, line); });
}

// kOutputs × kVectors sums stay in registers.
template <std::size_t kOutputs, std::size_t kVectors, class T>
HWY_INLINE void product_tile(const T* matrix, std::size_t inputs, const T* in, std::ptrdiff_t stride, T* out,
                             std::ptrdiff_t out_stride) {
  const hn::ScalableTag<T> d;
  const std::size_t lanes = hn::Lanes(d);
  hn::Vec<decltype(d)> sum[kOutputs][kVectors];
  for (std::size_t i = 0; i < kOutputs; ++i)
    for (std::size_t v = 0; v < kVectors; ++v) sum[i][v] = hn::Zero(d);
  for (std::size_t j = 0; j < inputs; ++j, in += stride) {
    hn::Vec<decltype(d)> row[kVectors];
    for (std::size_t v = 0; v < kVectors; ++v) row[v] = hn::LoadU(d, in + v * lanes);
    for (std::size_t i = 0; i < kOutputs; ++i) {
      const auto weight = hn::Set(d, matrix[i * inputs + j]);
      for (std::size_t v = 0; v < kVectors; ++v) sum[i][v] = hn::MulAdd(weight, row[v], sum[i][v]);
    }
  }
  for (std::size_t i = 0; i < kOutputs; ++i, out += out_stride)
    for (std::size_t v = 0; v < kVectors; ++v) hn::StoreU(sum[i][v], d, out + v * lanes);
}

// The same for a number of outputs up to kMost.
template <std::size_t kMost, std::size_t kVectors, class T>
HWY_INLINE void product_tile_of(std::size_t outputs, const T* matrix, std::size_t inputs, const T* in,
                                std::ptrdiff_t stride, T* out, std::ptrdiff_t out_stride) {
  if (outputs == kMost) return product_tile<kMost, kVectors>(matrix, inputs, in, stride, out, out_stride);
  if constexpr (kMost > 1) product_tile_of<kMost - 1, kVectors>(outputs, matrix, inputs, in, stride, out, out_stride);
}

// Tiles of up to kMost outputs, of about the same number each. Inputs that are read more than once are copied next to
// each other, unless they are near: rows of a block, a power of two apart, would evict one another from the first-level
// cache.
template <std::size_t kMost, std::size_t kVectors, class T>
HWY_INLINE void product_columns(const T* matrix, std::size_t outputs, std::size_t inputs, const T* in,
                                std::ptrdiff_t stride, T* out, std::ptrdiff_t out_stride) {
  constexpr std::size_t kNear = 2;
  const hn::ScalableTag<T> d;
  const std::size_t width = kVectors * hn::Lanes(d);
  thread_local std::vector<T> packed;  // reused from call to call
  if (outputs > kMost && std::abs(stride) > static_cast<std::ptrdiff_t>(kNear * width)) {
    packed.resize(inputs * width);
    for (std::size_t j = 0; j < inputs; ++j)
      std::copy_n(in + static_cast<std::ptrdiff_t>(j) * stride, width, &packed[j * width]);
    in = packed.data();
    stride = static_cast<std::ptrdiff_t>(width);
  }
  for (std::size_t tiles = (outputs + kMost - 1) / kMost; tiles > 0; --tiles) {
    const std::size_t here = (outputs + tiles - 1) / tiles;
    product_tile_of<kMost, kVectors>(here, matrix, inputs, in, stride, out, out_stride);
    matrix += here * inputs;
    out += static_cast<std::ptrdiff_t>(here) * out_stride;
    outputs -= here;
  }
}

// A multiply-add waits for the one before it in the same sum: many sums at a time, as many as fit into 16 registers.
template <class T>
void rows_product(const T* matrix, std::size_t outputs, std::size_t inputs, const T* in, std::ptrdiff_t stride, T* out,
                  std::ptrdiff_t out_stride, std::size_t width) {
  const std::size_t lanes = hn::Lanes(hn::ScalableTag<T>());
  std::size_t c = 0;
  for (; outputs <= 2 && c + 4 * lanes <= width; c += 4 * lanes)
    product_columns<2, 4>(matrix, outputs, inputs, in + c, stride, out + c, out_stride);
  for (; c + 2 * lanes <= width; c += 2 * lanes)
    product_columns<6, 2>(matrix, outputs, inputs, in + c, stride, out + c, out_stride);
  for (; c < width; c += lanes) product_columns<6, 1>(matrix, outputs, inputs, in + c, stride, out + c, out_stride);
}

EqualizerLoops<float> EqualizerFloats() {
  return {lines_of_columns<float>, take_off<float>, put_back<float>, rows_product<float>};
}
EqualizerLoops<double> EqualizerDoubles() {
  return {lines_of_columns<double>, take_off<double>, put_back<double>, rows_product<double>};
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(EqualizerFloats);
HWY_EXPORT(EqualizerDoubles);

template <>
EqualizerLoops<float> equalizer_loops() {
  return HWY_DYNAMIC_DISPATCH(EqualizerFloats)();
}
template <>
EqualizerLoops<double> equalizer_loops() {
  return HWY_DYNAMIC_DISPATCH(EqualizerDoubles)();
}

}  // namespace ocisac::kernels
#endif
