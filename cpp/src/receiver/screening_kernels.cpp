#include "receiver/screening_kernels.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <numbers>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "receiver/screening_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

void ChunkMomentsOf(const float* rows, std::size_t stride, std::size_t groups, const ChunkMoments& out) {
  const hn::CappedTag<float, 16> d;
  const std::size_t lanes = hn::Lanes(d);
  for (std::size_t g = 0; g < groups; g += lanes) {
    const auto first = hn::LoadU(d, rows + g), first1 = hn::LoadU(d, rows + g + 1), first2 = hn::LoadU(d, rows + g + 2);
    auto sum = hn::Zero(d), slope = sum, square = sum, next = sum, second = sum;
    for (std::size_t n = 1; n < chunk_rows; ++n) {
      const float* row = rows + n * stride + g;
      const auto x = hn::Sub(hn::LoadU(d, row), first);
      const auto y = hn::Sub(hn::LoadU(d, row + 1), first1), z = hn::Sub(hn::LoadU(d, row + 2), first2);
      sum = hn::Add(sum, x);
      slope = hn::Add(slope, hn::Mul(x, hn::Set(d, static_cast<float>(n))));
      square = hn::Add(square, hn::Mul(x, x));
      next = hn::Add(next, hn::Mul(x, y));
      second = hn::Add(second, hn::Mul(x, z));
    }
    hn::StoreU(sum, d, out.sum + g);
    hn::StoreU(slope, d, out.slope + g);
    hn::StoreU(square, d, out.square + g);
    hn::StoreU(next, d, out.next + g);
    hn::StoreU(second, d, out.second + g);
  }
}

// Plain loops from here on: compilers turn them into the target's instructions.
void SumEightBytes(const std::uint8_t* HWY_RESTRICT row, std::size_t groups, float scale, float dark,
                   float* HWY_RESTRICT out) {
  constexpr std::uint64_t low = 0x00ff00ff00ff00ffU;
  for (std::size_t g = 0; g < groups; ++g) {
    std::uint64_t x;
    std::memcpy(&x, row + 8 * g, sizeof x);
    x = (x & low) + ((x >> 8) & low);
    x += x >> 32;
    const auto sum = static_cast<std::int32_t>((x + (x >> 16)) & 0xffffU);
    out[g] = static_cast<float>(sum) * scale - dark;
  }
}

// ln m = 2·artanh((m − 1)/(m + 1)) for the mantissa m.
void Logarithms(const float* HWY_RESTRICT light, std::size_t groups, float floor, float* HWY_RESTRICT out) {
  for (std::size_t g = 0; g < groups; ++g) {
    const auto bits = std::bit_cast<std::int32_t>(std::max(light[g], 0.0F) + floor);
    const auto exponent = static_cast<float>((bits >> 23) - 127);
    const auto mantissa = std::bit_cast<float>((bits & 0x007fffff) | 0x3f800000);
    const float t = (mantissa - 1) / (mantissa + 1), t2 = t * t;
    out[g] = exponent * std::numbers::ln2_v<float> + 2 * t * (1 + t2 * (1.0F / 3 + t2 * (0.2F + t2 / 7)));
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(ChunkMomentsOf);
HWY_EXPORT(SumEightBytes);
HWY_EXPORT(Logarithms);

void chunk_moments(const float* rows, std::size_t stride, std::size_t groups, const ChunkMoments& out) {
  HWY_DYNAMIC_DISPATCH(ChunkMomentsOf)(rows, stride, groups, out);
}

void sum_eight_bytes(const std::uint8_t* row, std::size_t groups, float scale, float dark, float* out) {
  HWY_DYNAMIC_DISPATCH(SumEightBytes)(row, groups, scale, dark, out);
}

void logarithms(const float* light, std::size_t groups, float floor, float* out) {
  HWY_DYNAMIC_DISPATCH(Logarithms)(light, groups, floor, out);
}

}  // namespace ocisac::kernels
#endif
