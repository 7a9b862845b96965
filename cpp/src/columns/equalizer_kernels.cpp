#include "columns/equalizer_kernels.hpp"

#include <algorithm>
#include <array>

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

template <class T, class D>
HWY_INLINE hn::Vec<D> load_as(const double* values, D d) {
  std::array<T, kBlockAlignment> converted;
  for (std::size_t i = 0; i < hn::Lanes(d); ++i) converted[i] = static_cast<T>(values[i]);
  return hn::LoadU(d, converted.data());
}

template <class T>
void lines_added(T* block, std::size_t rows, std::size_t width, const ColumnLines& lines, const double* scale,
                 double later) {
  const hn::ScalableTag<T> d;
  const double middle = (static_cast<double>(rows) - 1) / 2;
  for (std::size_t c = 0; c < width; c += hn::Lanes(d)) {
    const auto mean = load_as<T>(lines.mean + c, d), slope = load_as<T>(lines.slope + c, d),
               factor = load_as<T>(scale + c, d);
    for (std::size_t n = 0; n < rows; ++n) {
      T* const at = block + n * width + c;
      const auto line = hn::MulAdd(slope, hn::Set(d, static_cast<T>(static_cast<double>(n) + later - middle)), mean);
      hn::StoreU(hn::MulAdd(hn::LoadU(d, at), factor, line), d, at);
    }
  }
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

// A multiply-add waits for the one before it in the same sum: many sums at a time, as many as fit into 16 registers.
template <std::size_t kVectors, class T>
HWY_INLINE void product_columns(const T* matrix, std::size_t outputs, std::size_t inputs, const T* in,
                                std::ptrdiff_t stride, T* out, std::ptrdiff_t out_stride) {
  const auto tiles = [&]<std::size_t kOutputs>() {
    for (; outputs >= kOutputs; outputs -= kOutputs, matrix += kOutputs * inputs) {
      product_tile<kOutputs, kVectors>(matrix, inputs, in, stride, out, out_stride);
      out += static_cast<std::ptrdiff_t>(kOutputs) * out_stride;
    }
  };
  tiles.template operator()<6>();
  tiles.template operator()<3>();
  tiles.template operator()<2>();
  tiles.template operator()<1>();
}

template <class T>
void rows_product(const T* matrix, std::size_t outputs, std::size_t inputs, const T* in, std::ptrdiff_t stride, T* out,
                  std::ptrdiff_t out_stride, std::size_t width) {
  const std::size_t lanes = hn::Lanes(hn::ScalableTag<T>());
  std::size_t c = 0;
  for (; outputs <= 2 && c + 4 * lanes <= width; c += 4 * lanes)
    product_columns<4>(matrix, outputs, inputs, in + c, stride, out + c, out_stride);
  for (; c + 2 * lanes <= width; c += 2 * lanes)
    product_columns<2>(matrix, outputs, inputs, in + c, stride, out + c, out_stride);
  for (; c < width; c += lanes) product_columns<1>(matrix, outputs, inputs, in + c, stride, out + c, out_stride);
}

EqualizerLoops<float> EqualizerFloats() { return {lines_of_columns<float>, lines_added<float>, rows_product<float>}; }
EqualizerLoops<double> EqualizerDoubles() {
  return {lines_of_columns<double>, lines_added<double>, rows_product<double>};
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
