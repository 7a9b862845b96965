#include "ocisac/camera/packed_samples.hpp"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "camera/packed_samples.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// A group of kSamples samples is as many bytes with their high bits, and one with kLow low bits of each.
template <std::size_t kSamples, int kLow>
struct Groups {
  static constexpr std::size_t kBytes = kSamples + 1;
  static constexpr int kMask = (1 << kLow) - 1;

  static std::uint16_t sample(const std::uint8_t* row, std::size_t at) {
    const std::uint8_t* group = row + at / kSamples * kBytes;
    const int low = group[kSamples] >> (at % kSamples * kLow);
    return static_cast<std::uint16_t>(group[at % kSamples] << kLow | (low & kMask));
  }

#if HWY_TARGET != HWY_SCALAR
  // Eight samples at a time of `count`, which begin at a group; returns how many.
  static std::size_t unpack_vectors(const std::uint8_t* groups, std::size_t count, std::uint16_t* to) {
    constexpr std::size_t kAtOnce = 8, kStep = kAtOnce / kSamples * kBytes;
    constexpr std::uint8_t kNone = 0x80;  // gives 0
    alignas(16) std::uint8_t high_at[16], low_at[16];
    alignas(16) std::uint16_t up[kAtOnce];  // moves the low bits of each sample to the same place
    for (std::size_t i = 0; i < kAtOnce; ++i) {
      const std::size_t group = i / kSamples * kBytes;
      high_at[2 * i] = static_cast<std::uint8_t>(group + i % kSamples);
      low_at[2 * i] = static_cast<std::uint8_t>(group + kSamples);
      high_at[2 * i + 1] = low_at[2 * i + 1] = kNone;
      up[i] = static_cast<std::uint16_t>(1 << kLow * (kSamples - 1 - i % kSamples));
    }
    const hn::Full128<std::uint8_t> d8;
    const hn::Full128<std::uint16_t> d16;
    const auto highs = hn::Load(d8, high_at), lows = hn::Load(d8, low_at);
    const auto factor = hn::Load(d16, up), mask = hn::Set(d16, static_cast<std::uint16_t>(kMask));
    const std::size_t bytes = (count + kSamples - 1) / kSamples * kBytes;
    std::size_t done = 0;
    for (std::size_t at = 0; done + kAtOnce <= count && at + hn::Lanes(d8) <= bytes; at += kStep, done += kAtOnce) {
      const auto packed = hn::LoadU(d8, groups + at);
      const auto high = hn::BitCast(d16, hn::TableLookupBytesOr0(packed, highs));
      const auto low = hn::Mul(hn::BitCast(d16, hn::TableLookupBytesOr0(packed, lows)), factor);
      const auto placed = hn::And(hn::ShiftRight<kLow*(static_cast<int>(kSamples) - 1)>(low), mask);
      hn::StoreU(hn::Or(hn::ShiftLeft<kLow>(high), placed), d16, to + done);
    }
    return done;
  }
#endif

  static void unpack(const std::uint8_t* row, std::size_t first, std::size_t count, std::uint16_t* to) {
    const std::size_t end = first + count;
    for (; first < end && first % kSamples != 0; ++first) *to++ = sample(row, first);
    std::size_t done = 0;
#if HWY_TARGET != HWY_SCALAR
    done = unpack_vectors(row + first / kSamples * kBytes, end - first, to);
#endif
    for (std::size_t i = done; first + i < end; ++i) to[i] = sample(row, first + i);
  }
};

void Unpack10(const std::uint8_t* row, std::size_t first, std::size_t count, std::uint16_t* to) {
  Groups<4, 2>::unpack(row, first, count, to);
}
void Unpack12(const std::uint8_t* row, std::size_t first, std::size_t count, std::uint16_t* to) {
  Groups<2, 4>::unpack(row, first, count, to);
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac {
namespace kernels {

HWY_EXPORT(Unpack10);
HWY_EXPORT(Unpack12);

}  // namespace kernels

void unpack_samples(Packing packing, const std::uint8_t* row, std::size_t first, std::size_t count, std::uint16_t* to) {
  using namespace kernels;
  if (packing == Packing::raw10)
    HWY_DYNAMIC_DISPATCH(Unpack10)(row, first, count, to);
  else
    HWY_DYNAMIC_DISPATCH(Unpack12)(row, first, count, to);
}

}  // namespace ocisac
#endif
