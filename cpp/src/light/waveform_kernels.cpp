#include "light/waveform_kernels.hpp"

#include <cmath>
#include <numbers>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "light/waveform_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

// Plain loops, which the compiler turns into vectors of each target: every value is the same on all of them.
HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

// cos(2π·turns) for turns in [-1/2, 1/2], within 3e-16, as sin(x) = x − x³/3! + … at x = 2π(1/4 − |turns|).
HWY_INLINE double cosine_of(double turns) {
  const double x = 2 * std::numbers::pi * (0.25 - std::abs(turns));
  const double z = x * x;
  double series = 1.0 / 51090942171709440000.0;
  series = -1.0 / 121645100408832000.0 + z * series;
  series = 1.0 / 355687428096000.0 + z * series;
  series = -1.0 / 1307674368000.0 + z * series;
  series = 1.0 / 6227020800.0 + z * series;
  series = -1.0 / 39916800.0 + z * series;
  series = 1.0 / 362880.0 + z * series;
  series = -1.0 / 5040.0 + z * series;
  series = 1.0 / 120.0 + z * series;
  series = -1.0 / 6.0 + z * series;
  return x + x * z * series;
}

void AddTone(const ToneMeans& light, const double* x, std::size_t count, double* HWY_RESTRICT out) {
  const ToneMeans own = light;  // out may not change it
  for (std::size_t i = 0; i < count; ++i)
    out[i] += own.level * (1 + own.swing * cosine_of(own.counter.at(x[i]).fraction));
}

HWY_INLINE double within(double cycles, double part) {
  const double not_below = cycles > 0 ? cycles : 0;
  return not_below < part ? not_below : part;
}

// Overlap of the last part of a cycle before `end` with the pulse centred on `centre`.
HWY_INLINE double overlap(const SquareMeans& light, const Position& end, double centre) {
  const double since_rise = (end.fraction - (centre - light.half_duty)) + end.rest;
  const double since_fall = (end.fraction - (centre + light.half_duty)) + end.rest;
  return within(since_rise, light.part) - within(since_fall, light.part);
}

void AddSquare(const SquareMeans& light, const double* x, std::size_t count, double* HWY_RESTRICT out) {
  const SquareMeans own = light;  // out may not change it
  for (std::size_t i = 0; i < count; ++i) {
    const Position end = own.counter.at(x[i]);
    out[i] += own.level * ((own.whole_light + overlap(own, end, 0) + overlap(own, end, -1)) / own.length);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(AddTone);
HWY_EXPORT(AddSquare);

void add_means(const ToneMeans& light, const double* x, std::size_t count, double* out) {
  HWY_DYNAMIC_DISPATCH(AddTone)(light, x, count, out);
}

void add_means(const SquareMeans& light, const double* x, std::size_t count, double* out) {
  HWY_DYNAMIC_DISPATCH(AddSquare)(light, x, count, out);
}

}  // namespace ocisac::kernels
#endif
