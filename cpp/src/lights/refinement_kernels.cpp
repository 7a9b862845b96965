#include "lights/refinement_kernels.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <numbers>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "lights/refinement_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
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

// ln m = 2·artanh((m − 1)/(m + 1)) for a mantissa m between √½ and √2.
void LogarithmsOfDoubles(const double* light, std::size_t count, double floor, double* out) {
  const DoubleTag d;
  const hn::RebindToUnsigned<DoubleTag> bits;
  const auto one = hn::Set(d, 1.0);
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const auto x = hn::BitCast(bits, hn::Add(hn::Max(hn::LoadU(d, light + i), hn::Zero(d)), hn::Set(d, floor)));
    // Biased exponent as a floating-point number: 2^52 + exponent.
    const auto shifted = hn::Or(hn::ShiftRight<52>(x), hn::Set(bits, 0x4330000000000000ULL));
    auto exponent = hn::Sub(hn::BitCast(d, shifted), hn::Set(d, 4503599627370496.0 + 1023.0));
    auto m =
        hn::BitCast(d, hn::Or(hn::And(x, hn::Set(bits, 0x000fffffffffffffULL)), hn::Set(bits, 0x3ff0000000000000ULL)));
    const auto large = hn::Gt(m, hn::Set(d, std::numbers::sqrt2));
    m = hn::IfThenElse(large, hn::Mul(m, hn::Set(d, 0.5)), m);
    exponent = hn::IfThenElse(large, hn::Add(exponent, one), exponent);
    const auto t = hn::Div(hn::Sub(m, one), hn::Add(m, one)), t2 = hn::Mul(t, t);
    auto series = hn::Set(d, 1.0 / 21);
    for (int k = 19; k >= 1; k -= 2) series = hn::MulAdd(series, t2, hn::Set(d, 1.0 / k));
    hn::StoreU(hn::MulAdd(exponent, hn::Set(d, std::numbers::ln2), hn::Mul(hn::Add(t, t), series)), d, out + i);
  }
}

// The same in a plain loop, for the mantissa m, which the compiler vectorises for the target.
void LogarithmsOfFloats(const float* HWY_RESTRICT light, std::size_t count, float floor, float* HWY_RESTRICT out) {
  for (std::size_t g = 0; g < count; ++g) {
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
