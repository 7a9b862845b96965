#include "lights/refinement_kernels.hpp"

#include <algorithm>
#include <numbers>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "lights/refinement_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/contrib/algo/transform-inl.h>
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using DoubleTag = hn::CappedTag<double, kPatchPadding>;
using Doubles = hn::Vec<DoubleTag>;

struct Sum {
  Doubles real, imaginary;

  // Adds x·carrier(i) and subtracts y·carrier(k).
  HWY_INLINE void slide(const ComplexValues& carrier, Doubles x, std::size_t i, Doubles y, std::size_t k) {
    const DoubleTag d;
    real = hn::MulAdd(x, hn::Set(d, carrier.real[i]), real);
    imaginary = hn::MulAdd(x, hn::Set(d, carrier.imaginary[i]), imaginary);
    real = hn::NegMulAdd(y, hn::Set(d, carrier.real[k]), real);
    imaginary = hn::NegMulAdd(y, hn::Set(d, carrier.imaginary[k]), imaginary);
  }
};

// Along the rows, one vector of groups at a time.
void HannDemodulate(const PatchView& x, const double* mean, const HannWindow& window, double* real, double* imaginary) {
  const DoubleTag d;
  const std::size_t reach = window.length / 2, last = x.rows - 1;
  const auto half = hn::Set(d, 0.5 / static_cast<double>(window.length));
  for (std::size_t g = 0; g < x.stride; g += hn::Lanes(d)) {
    const auto centre = hn::LoadU(d, mean + g), none = hn::Zero(d);
    const auto at = [&](std::size_t i) HWY_ATTR {  // from `reach` rows before the first
      return hn::Sub(hn::LoadU(d, x.values + std::min(i - std::min(i, reach), last) * x.stride + g), centre);
    };
    Sum below{none, none}, middle = below, above = below;
    for (std::size_t i = 0; i + 1 < window.length; ++i) {
      below.slide(window.below, at(i), i, none, 0);
      middle.slide(window.middle, at(i), i, none, 0);
      above.slide(window.above, at(i), i, none, 0);
    }
    auto leaving = none;
    for (std::size_t n = 0; n < x.rows; ++n) {
      const std::size_t next = n + window.length - 1, before = n - std::min<std::size_t>(n, 1);
      const auto entering = at(next);
      below.slide(window.below, entering, next, leaving, before);
      middle.slide(window.middle, entering, next, leaving, before);
      above.slide(window.above, entering, next, leaving, before);
      leaving = at(n);
      // 2·middle + turn·below + conj(turn)·above
      const auto c = hn::Set(d, window.turns.real[n]), s = hn::Set(d, window.turns.imaginary[n]);
      auto re = hn::MulAdd(c, hn::Add(below.real, above.real), hn::Add(middle.real, middle.real));
      re = hn::MulAdd(s, hn::Sub(above.imaginary, below.imaginary), re);
      auto im = hn::MulAdd(c, hn::Add(below.imaginary, above.imaginary), hn::Add(middle.imaginary, middle.imaginary));
      im = hn::MulAdd(s, hn::Sub(below.real, above.real), im);
      hn::StoreU(hn::Mul(half, re), d, real + n * x.stride + g);
      hn::StoreU(hn::Mul(half, im), d, imaginary + n * x.stride + g);
    }
  }
}

template <class T>
HWY_INLINE void logarithms_of(const T* light, std::size_t count, T floor, T* out) {
  hn::Transform1(hn::ScalableTag<T>(), out, count, light, [floor](auto d, auto, auto x) HWY_ATTR {
    return hn::Log(d, hn::Add(hn::Max(x, hn::Zero(d)), hn::Set(d, floor)));
  });
}

void LogarithmsOfFloats(const float* light, std::size_t count, float floor, float* out) {
  logarithms_of(light, count, floor, out);
}
void LogarithmsOfDoubles(const double* light, std::size_t count, double floor, double* out) {
  logarithms_of(light, count, floor, out);
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(HannDemodulate);
HWY_EXPORT(LogarithmsOfFloats);
HWY_EXPORT(LogarithmsOfDoubles);

void hann_demodulate(const PatchView& x, const double* mean, const HannWindow& window, double* real,
                     double* imaginary) {
  HWY_DYNAMIC_DISPATCH(HannDemodulate)(x, mean, window, real, imaginary);
}

void logarithms(const float* light, std::size_t count, float floor, float* out) {
  HWY_DYNAMIC_DISPATCH(LogarithmsOfFloats)(light, count, floor, out);
}

void logarithms(const double* light, std::size_t count, double floor, double* out) {
  HWY_DYNAMIC_DISPATCH(LogarithmsOfDoubles)(light, count, floor, out);
}

}  // namespace ocisac::kernels
#endif
