// Parts that loops over bytes and over other samples share, in the namespace of each SIMD target.
#if defined(OCISAC_PROJECTION_KERNELS_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef OCISAC_PROJECTION_KERNELS_INL_HPP
#undef OCISAC_PROJECTION_KERNELS_INL_HPP
#else
#define OCISAC_PROJECTION_KERNELS_INL_HPP
#endif

#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "columns/row_kernels.hpp"

#ifndef OCISAC_INLINE_LAMBDA
#define OCISAC_INLINE_LAMBDA __attribute__((always_inline))
#endif

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

// Vectors as wide as a cache line and twice the number of registers: AVX-512.
constexpr bool kWide = HWY_TARGET <= HWY_AVX3;

template <std::size_t kLines, bool kEarly = false>
HWY_INLINE void ask_for(const std::uint8_t* run) {
  for (std::size_t i = 0; i < kLines; ++i) kEarly ? ask_early_for(run + i * kLine) : hwy::Prefetch(run + i * kLine);
}

template <std::size_t kLines>
HWY_INLINE void read_lines(const std::uint8_t* run) {
  for (std::size_t i = 0; i < kLines; ++i) static_cast<void>(static_cast<const volatile std::uint8_t*>(run)[i * kLine]);
}

// Calls body(i) for every i below kCount, i a constant: arrays that are indexed by nothing else stay in registers,
// which loops leave to chance (GCC 12: 46 or 60 µs for a frame of bytes in the cache).
template <std::size_t kCount, class Body>
HWY_INLINE void for_each_constant(Body body) {
  [&]<std::size_t... kIndex>(std::index_sequence<kIndex...>) OCISAC_INLINE_LAMBDA {
    (body(std::integral_constant<std::size_t, kIndex>()), ...);
  }
  (std::make_index_sequence<kCount>());
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#endif
