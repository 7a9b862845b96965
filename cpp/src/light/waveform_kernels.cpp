#include "light/waveform_kernels.hpp"

#include <cmath>
#include <cstdint>
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

// Index of a whole number below 2³¹.
HWY_INLINE std::int32_t index_of(double whole) { return static_cast<std::int32_t>(whole); }

template <bool kSlopes, bool kLows>
HWY_INLINE void add_cells(const CellMeans& light, const double* x, std::size_t count, double* HWY_RESTRICT out) {
  const CellMeans own = light;  // out may not change it
  const CellTables& of = own.cells;
  const double rounds = 1 / of.count;
  const std::int32_t end_of_round = index_of(of.count);
  const double total_high = of.before_high[end_of_round], total_low = kLows ? of.before_low[end_of_round] : 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    const Position end = own.counter.at(x[i]);
    const double sign = end.fraction == 0 ? end.rest : end.fraction;
    const double below = sign < 0 ? 1 : 0;
    const double offset = (end.fraction + end.rest) + below;
    double cell = end.whole - below;
    cell -= nearest_whole(cell * rounds) * of.count;  // the nearest round or the next to it
    cell += cell < 0 ? of.count : 0;
    cell -= cell >= of.count ? of.count : 0;
    const double left_over = own.part - offset, from_before = left_over > 0 ? left_over : 0;
    const double nearest = nearest_whole(from_before);
    const double between = nearest > from_before ? nearest - 1 : nearest;  // whole cells
    const double cut = left_over - between;                                // of the cell in which the exposure begins
    const double first = cell - 1 - between, next = cell - between;
    const double wraps = next < 0 ? 1 : 0, stays = 1 - wraps;
    const double first_inside = first + (first < 0 ? of.count : 0), next_inside = next + wraps * of.count;
    const std::int32_t at = index_of(cell), at_first = index_of(first_inside), at_next = index_of(next_inside);
    const double high = of.before_high[at], high_of_next = of.before_high[at_next];
    const double low = kLows ? of.before_low[at] : 0.0, low_of_next = kLows ? of.before_low[at_next] : 0.0;
    const double until_high = stays * high + wraps * total_high, until_low = stays * low + wraps * total_low;
    const double whole_cells = ((until_high - high_of_next) + (until_low - low_of_next)) + wraps * (high + low);
    const double value = of.values[at], first_value = of.values[at_first];
    const double slope = kSlopes ? of.slopes[at] : 0.0, first_slope = kSlopes ? of.slopes[at_first] : 0.0;
    const double last_part = kSlopes ? offset * (value + slope * offset / 2) : offset * value;
    const double first_part = kSlopes ? cut * (first_value + first_slope * (1 - cut / 2)) : cut * first_value;
    const double level = kSlopes ? value + slope * (offset - own.part / 2) : value;  // of an exposure within one cell
    const double light_of_part = left_over > 0 ? (last_part + first_part) + whole_cells : own.part * level;
    const double mean = (own.whole_light + light_of_part) / own.length;
    out[i] += own.level * (left_over > 0 || own.part < own.length ? mean : level);
  }
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
