#include "lights/screening_kernels.hpp"

#include <array>
#include <cstring>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "lights/screening_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

void ChunkMomentsOf(std::size_t stride, std::size_t groups, std::size_t tile, const Chunk& chunk) {
  const hn::CappedTag<float, 16> d;
  const std::size_t lanes = hn::Lanes(d);
  for (std::size_t g = 0; g < groups; g += lanes) {
    const auto first = hn::LoadU(d, chunk.first + g), first1 = hn::LoadU(d, chunk.first + g + 1),
               first2 = hn::LoadU(d, chunk.first + g + 2);
    auto sum = hn::Zero(d), slope = sum, square = sum, next = sum, second = sum;
    hn::StoreU(sum, d, chunk.common + g);
    for (std::size_t n = 1; n < kChunkRows; ++n) {
      const float* row = chunk.first + n * stride + g;
      const auto x = hn::Sub(hn::LoadU(d, row), first);
      const auto y = hn::Sub(hn::LoadU(d, row + 1), first1), z = hn::Sub(hn::LoadU(d, row + 2), first2);
      sum = hn::Add(sum, x);
      slope = hn::Add(slope, hn::Mul(x, hn::Set(d, static_cast<float>(n))));
      square = hn::Add(square, hn::Mul(x, x));
      next = hn::Add(next, hn::Mul(x, y));
      second = hn::Add(second, hn::Mul(x, z));
      const auto two = tile > 1 ? hn::Add(x, y) : x;
      hn::StoreU(tile > 2 ? hn::Add(two, z) : two, d, chunk.common + n * stride + g);
    }
    hn::StoreU(sum, d, chunk.sum + g);
    hn::StoreU(slope, d, chunk.slope + g);
    hn::StoreU(square, d, chunk.square + g);
    hn::StoreU(next, d, chunk.next + g);
    hn::StoreU(second, d, chunk.second + g);
  }
}

using FloatTag = hn::CappedTag<float, 16>;
using Floats = hn::Vec<FloatTag>;

// Products of groups `apart` over the window, with mean and slope of each removed.
struct WindowProducts {
  const WindowScratch& of;
  const Chunk &earlier, &later;
  float per_row, per_slope;

  HWY_INLINE Floats operator()(const float* before, const float* after, std::size_t g, std::size_t apart) const {
    const FloatTag d;
    const std::size_t h = g + apart;
    const auto step = hn::LoadU(d, of.step + g), other = hn::LoadU(d, of.step + h);
    const auto sum = hn::LoadU(d, later.sum + g), other_sum = hn::LoadU(d, later.sum + h);
    auto total = hn::Add(hn::LoadU(d, before + g), hn::LoadU(d, after + g));
    total = hn::MulAdd(step, other_sum, total);
    total = hn::MulAdd(other, sum, total);
    total = hn::MulAdd(hn::Mul(hn::Set(d, static_cast<float>(kChunkRows)), step), other, total);
    const auto means = hn::Mul(hn::LoadU(d, of.sum + g), hn::LoadU(d, of.sum + h));
    const auto slopes = hn::Mul(hn::LoadU(d, of.slope + g), hn::LoadU(d, of.slope + h));
    total = hn::NegMulAdd(means, hn::Set(d, per_row), total);
    return hn::NegMulAdd(slopes, hn::Set(d, per_slope), total);
  }
};

bool TileEnergies(const Chunk& earlier, const Chunk& later, std::size_t tiles, const TileBound& bound,
                  const WindowScratch& scratch, float* energy) {
  const FloatTag d;
  const std::size_t lanes = hn::Lanes(d), groups = tiles + bound.groups - 1;
  constexpr float kRows = kChunkRows, kMiddle = kChunkRows - 0.5F;
  constexpr float kLaterSlope = 0.5F * kRows * kRows;  // Σ of n − 15.5 over the later chunk
  for (std::size_t g = 0; g < groups; g += lanes) {
    const auto step = hn::Sub(hn::LoadU(d, later.first + g), hn::LoadU(d, earlier.first + g));
    const auto before = hn::LoadU(d, earlier.sum + g), after = hn::LoadU(d, later.sum + g);
    hn::StoreU(step, d, scratch.step + g);
    hn::StoreU(hn::MulAdd(hn::Set(d, kRows), step, hn::Add(before, after)), d, scratch.sum + g);
    auto slope = hn::Add(hn::LoadU(d, earlier.slope + g), hn::LoadU(d, later.slope + g));
    slope = hn::NegMulAdd(hn::Set(d, kMiddle), before, slope);
    slope = hn::MulAdd(hn::Set(d, kRows - kMiddle), after, slope);
    hn::StoreU(hn::MulAdd(hn::Set(d, kLaterSlope), step, slope), d, scratch.slope + g);
  }
  const WindowProducts products{scratch, earlier, later, 0.5F / kRows, 1 / bound.slope_energy};
  for (std::size_t g = 0; g < groups; g += lanes) {
    hn::StoreU(products(earlier.square, later.square, g, 0), d, scratch.own + g);
    hn::StoreU(products(earlier.next, later.next, g, 1), d, scratch.near + g);
    hn::StoreU(products(earlier.second, later.second, g, 2), d, scratch.far + g);
  }
  const auto min_energy = hn::Set(d, bound.min_energy);
  const auto min_share = hn::Set(d, bound.min_share * static_cast<float>(bound.groups));
  bool any = false;
  for (std::size_t g = 0; g < tiles; g += lanes) {
    auto all = hn::LoadU(d, scratch.own + g), common = hn::Zero(d);
    for (std::size_t k = 1; k < bound.groups; ++k) {
      all = hn::Add(all, hn::LoadU(d, scratch.own + g + k));
      common = hn::Add(common, hn::LoadU(d, scratch.near + g + k - 1));
    }
    if (bound.groups > 2) common = hn::Add(common, hn::LoadU(d, scratch.far + g));
    const auto bounded = hn::Add(all, hn::Add(common, common));
    const auto candidate = hn::And(hn::Gt(all, min_energy), hn::Ge(bounded, hn::Mul(min_share, all)));
    any = any || !hn::AllFalse(d, hn::And(candidate, hn::FirstN(d, tiles - g)));
    hn::StoreU(hn::IfThenElseZero(candidate, all), d, energy + g);
  }
  return any;
}

void WaveSums(const float* earlier, const float* later, float step, std::size_t stride, const float* cosine,
              const float* sine, std::size_t waves, float* even, float* odd) {
  std::array<float, kChunkRows> sum, difference;
  for (std::size_t n = 0; n < kChunkRows; ++n) {
    const float before = earlier[n * stride], after = later[(kChunkRows - 1 - n) * stride] + step;
    sum[n] = after + before;
    difference[n] = after - before;
  }
  const hn::CappedTag<float, 8> d;
  for (std::size_t k = 0; k < waves; k += hn::Lanes(d)) {
    auto a = hn::Zero(d), b = a;
    for (std::size_t n = 0; n < kChunkRows; ++n) {
      a = hn::MulAdd(hn::Set(d, sum[n]), hn::LoadU(d, cosine + n * waves + k), a);
      b = hn::MulAdd(hn::Set(d, difference[n]), hn::LoadU(d, sine + n * waves + k), b);
    }
    hn::StoreU(a, d, even + k);
    hn::StoreU(b, d, odd + k);
  }
}

// A plain loop, which the compiler vectorises for the target.
void SumEightBytes(const std::uint8_t* HWY_RESTRICT row, std::size_t groups, float scale, float dark,
                   float* HWY_RESTRICT out) {
  constexpr std::uint64_t kLow = 0x00ff00ff00ff00ffU;
  for (std::size_t g = 0; g < groups; ++g) {
    std::uint64_t x;
    std::memcpy(&x, row + 8 * g, sizeof x);
    x = (x & kLow) + ((x >> 8) & kLow);
    x += x >> 32;
    const auto sum = static_cast<std::int32_t>((x + (x >> 16)) & 0xffffU);
    out[g] = static_cast<float>(sum) * scale - dark;
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(ChunkMomentsOf);
HWY_EXPORT(TileEnergies);
HWY_EXPORT(WaveSums);
HWY_EXPORT(SumEightBytes);

void chunk_moments(std::size_t stride, std::size_t groups, std::size_t tile, const Chunk& chunk) {
  HWY_DYNAMIC_DISPATCH(ChunkMomentsOf)(stride, groups, tile, chunk);
}

bool tile_energies(const Chunk& earlier, const Chunk& later, std::size_t tiles, const TileBound& bound,
                   const WindowScratch& scratch, float* energy) {
  return HWY_DYNAMIC_DISPATCH(TileEnergies)(earlier, later, tiles, bound, scratch, energy);
}

void wave_sums(const float* earlier, const float* later, float step, std::size_t stride, const float* cosine,
               const float* sine, std::size_t waves, float* even, float* odd) {
  HWY_DYNAMIC_DISPATCH(WaveSums)(earlier, later, step, stride, cosine, sine, waves, even, odd);
}

void sum_eight_bytes(const std::uint8_t* row, std::size_t groups, float scale, float dark, float* out) {
  HWY_DYNAMIC_DISPATCH(SumEightBytes)(row, groups, scale, dark, out);
}

}  // namespace ocisac::kernels
#endif
