#include "tones/harmonic_kernels.hpp"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tones/harmonic_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

const hn::ScalableTag<double> d64;
using Harmonics = hn::Vec<decltype(d64)>;

// The harmonics of a vector from `first` on: one in each lane.
class Wave {
 public:
  HWY_INLINE Wave(const Rotations& of, std::size_t first)
      : turn_cosine_(hn::LoadU(d64, of.turn_cosine + first)),
        turn_sine_(hn::LoadU(d64, of.turn_sine + first)),
        leap_cosine_(hn::LoadU(d64, of.leap_cosine + first)),
        leap_sine_(hn::LoadU(d64, of.leap_sine + first)),
        anchor_cosine_(hn::LoadU(d64, of.cosine + first)),
        anchor_sine_(hn::LoadU(d64, of.sine + first)) {}

  // Rotations from row to row restart every kRowsPerLeap rows, which bounds their errors.
  HWY_INLINE void restart() {
    cosine = anchor_cosine_;
    sine = anchor_sine_;
    rotate(leap_cosine_, leap_sine_, anchor_cosine_, anchor_sine_);
  }
  HWY_INLINE void next() { rotate(turn_cosine_, turn_sine_, cosine, sine); }

  Harmonics cosine, sine;

 private:
  static HWY_INLINE void rotate(Harmonics by_cosine, Harmonics by_sine, Harmonics& cosine, Harmonics& sine) {
    const Harmonics before = cosine;
    cosine = hn::NegMulAdd(sine, by_sine, hn::Mul(before, by_cosine));
    sine = hn::MulAdd(sine, by_cosine, hn::Mul(before, by_sine));
  }

  Harmonics turn_cosine_, turn_sine_, leap_cosine_, leap_sine_, anchor_cosine_, anchor_sine_;
};

HWY_INLINE void add_harmonics(const SignalParts& signal, const Rotations& harmonics, std::size_t first,
                              const HarmonicSums& to) {
  Wave wave(harmonics, first);
  Harmonics cosine = hn::Zero(d64), sine = cosine, u_sine = cosine, u_cosine = cosine;
  for (std::size_t begin = 0; begin < signal.rows; begin += kRowsPerLeap) {
    wave.restart();
    for (std::size_t i = begin; i < std::min(begin + kRowsPerLeap, signal.rows); ++i) {
      const double u = signal.first + static_cast<double>(i), even = signal.even[i * signal.step],
                   odd = signal.odd[i * signal.step];
      cosine = hn::MulAdd(wave.cosine, hn::Set(d64, even), cosine);
      sine = hn::MulAdd(wave.sine, hn::Set(d64, odd), sine);
      u_sine = hn::MulAdd(wave.sine, hn::Set(d64, u * even), u_sine);
      u_cosine = hn::MulAdd(wave.cosine, hn::Set(d64, u * odd), u_cosine);
      wave.next();
    }
  }
  hn::StoreU(cosine, d64, to.cosine + first);
  hn::StoreU(sine, d64, to.sine + first);
  hn::StoreU(u_sine, d64, to.u_sine + first);
  hn::StoreU(u_cosine, d64, to.u_cosine + first);
}

void SumsOfHarmonics(const SignalParts& signal, const Rotations& harmonics, const HarmonicSums& sums) {
  for (std::size_t first = 0; first < harmonics.count; first += hn::Lanes(d64))
    add_harmonics(signal, harmonics, first, sums);
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(SumsOfHarmonics);

void harmonic_sums(const SignalParts& signal, const Rotations& harmonics, const HarmonicSums& sums) {
  HWY_DYNAMIC_DISPATCH(SumsOfHarmonics)(signal, harmonics, sums);
}

}  // namespace ocisac::kernels
#endif
