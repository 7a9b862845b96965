#include "light/waveform_kernels.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
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

// Exact products by one fused multiply-add instead of ten operations.
constexpr bool kFused = kHasFusedProduct || HWY_TARGET <= HWY_AVX2;

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
    out[i] += own.level * (1 + own.swing * cosine_of(own.counter.at<kFused>(x[i]).fraction));
}

// Light of the last part of a cycle before `end`, in cycles: that of the pulse about whole cycles and of the one
// before, whose edges lie before every end.
HWY_INLINE double light_of_part(const SquareMeans& light, const Position& end) {
  const double since_rise = (end.fraction + light.half_duty) + end.rest;
  const double since_fall = (end.fraction - light.half_duty) + end.rest;
  const double of_this =
      std::min(std::max(since_rise, 0.0), light.part) - std::min(std::max(since_fall, 0.0), light.part);
  return of_this + (std::min(since_rise + 1, light.part) - std::min(since_fall + 1, light.part));
}

void AddSquare(const SquareMeans& light, const double* x, std::size_t count, double* HWY_RESTRICT out) {
  const SquareMeans own = light;  // out may not change it
  const double scale = own.level / own.length;
  for (std::size_t i = 0; i < count; ++i) {
    const Position end = own.counter.at<kFused>(x[i]);
    out[i] += (own.whole_light + light_of_part(own, end)) * scale;
  }
}

// Index of a whole number below 2³¹.
HWY_INLINE std::int32_t index_of(double whole) { return static_cast<std::int32_t>(whole); }

constexpr std::size_t kAtOnce = 64;
using Some = double[kAtOnce];
using SomePairs = double[2 * kAtOnce];
using SomeIndices = std::int32_t[kAtOnce];

// A loop of its own collects the values of the tables between two of arithmetic: few processors gather well, and
// compilers leave the whole loop in scalars then. So they do where arithmetic has a condition: factors of 0 and 1 stand
// for it.
template <bool kSlopes, bool kLows>
HWY_INLINE void add_some_cells(const CellMeans& own, const double* x, std::size_t count, double* HWY_RESTRICT out) {
  const CellTables& of = own.cells;
  const double rounds = 1 / of.count, scale = own.level / own.length;
  const std::int32_t cells = index_of(of.count);
  const double total_high = of.chain[2 * cells], total_low = kLows ? of.before_low[cells] : 0.0;
  Some offset, left_over, cut, wraps;
  SomeIndices at, at_first;
  for (std::size_t i = 0; i < count; ++i) {
    const Position end = own.counter.at<kFused>(x[i]);
    const double since_whole = (end.fraction + end.rest) + 0.0;  // not −0
    const double below = 0.5 - std::copysign(0.5, since_whole);  // 1 or 0, without a condition
    offset[i] = since_whole + below;
    const double cell = end.whole - below;
    std::int32_t last =
        index_of(cell - nearest_whole(cell * rounds) * of.count);  // the nearest round or the next to it
    last += last < 0 ? cells : 0;
    last -= last >= cells ? cells : 0;
    left_over[i] = own.part - offset[i];
    const std::int32_t between = std::max(index_of(left_over[i]), 0);  // whole cells
    cut[i] = left_over[i] - between;                                   // of the cell in which the exposure begins
    const std::int32_t first = last - 1 - between;
    wraps[i] = first < 0 ? 1 : 0;
    at[i] = 2 * last;
    at_first[i] = 2 * (first + (first < 0 ? cells : 0));
  }
  const bool rounds_more = own.part < own.length;
  SomePairs at_end, at_begin;  // light before the cell and its value; the value and the light before the next cell
  Some slope, first_slope, low, low_of_next;
  for (std::size_t i = 0; i < count; ++i) {
    auto last = static_cast<std::size_t>(at[i]), first = static_cast<std::size_t>(at_first[i]);
#if HWY_ARCH_X86 && (HWY_COMPILER_GCC || HWY_COMPILER_CLANG)
    asm("" : "+r"(last), "+r"(first));  // keeps the loop scalar: vectors of addresses are taken apart again
#endif
    std::memcpy(at_end + 2 * i, of.chain + last, 2 * sizeof(double));
    std::memcpy(at_begin + 2 * i, of.chain + first + 1, 2 * sizeof(double));
    if constexpr (kSlopes) {
      slope[i] = of.slopes[last / 2];
      first_slope[i] = of.slopes[first / 2];
    }
    if constexpr (kLows) {
      low[i] = of.before_low[last / 2];
      low_of_next[i] = of.before_low[first / 2 + 1];
    }
  }
  for (std::size_t i = 0; i < count; ++i) {
    const double high = at_end[2 * i], value = at_end[2 * i + 1];
    const double first_value = at_begin[2 * i], high_of_next = at_begin[2 * i + 1];
    double whole_cells = (high - high_of_next) + wraps[i] * total_high;
    if constexpr (kLows) whole_cells += (low[i] - low_of_next[i]) + wraps[i] * total_low;
    const double last_part = kSlopes ? offset[i] * (value + slope[i] * offset[i] / 2) : offset[i] * value;
    const double first_part =
        kSlopes ? cut[i] * (first_value + first_slope[i] * (1 - cut[i] / 2)) : cut[i] * first_value;
    // of an exposure within one cell
    const double level = kSlopes ? value + slope[i] * (offset[i] - own.part / 2) : value;
    const double beyond = left_over[i] > 0 ? 1 : 0, averaged = rounds_more ? 1 : beyond;
    const double light_of_part = beyond * ((last_part + first_part) + whole_cells) + (1 - beyond) * (own.part * level);
    out[i] += averaged * (own.whole_light + light_of_part) * scale + (1 - averaged) * (own.level * level);
  }
}

template <bool kSlopes, bool kLows>
HWY_INLINE void add_cells(const CellMeans& light, const double* x, std::size_t count, double* HWY_RESTRICT out) {
  const CellMeans own = light;  // out may not change it
  for (std::size_t i = 0; i < count; i += kAtOnce)
    add_some_cells<kSlopes, kLows>(own, x + i, std::min(kAtOnce, count - i), out + i);
}

void AddCells(const CellMeans& light, const double* x, std::size_t count, double* HWY_RESTRICT out) {
  const bool lows = light.cells.before_low != nullptr;
  if (light.cells.slopes)
    lows ? add_cells<true, true>(light, x, count, out) : add_cells<true, false>(light, x, count, out);
  else
    lows ? add_cells<false, true>(light, x, count, out) : add_cells<false, false>(light, x, count, out);
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(AddTone);
HWY_EXPORT(AddSquare);
HWY_EXPORT(AddCells);

void add_means(const ToneMeans& light, const double* x, std::size_t count, double* out) {
  HWY_DYNAMIC_DISPATCH(AddTone)(light, x, count, out);
}

void add_means(const CellMeans& light, const double* x, std::size_t count, double* out) {
  HWY_DYNAMIC_DISPATCH(AddCells)(light, x, count, out);
}

void add_means(const SquareMeans& light, const double* x, std::size_t count, double* out) {
  HWY_DYNAMIC_DISPATCH(AddSquare)(light, x, count, out);
}

}  // namespace ocisac::kernels
#endif
