#include "light/waveform_kernels.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/levels.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "light/waveform_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

// Plain loops, which the compiler turns into vectors of each target, but for cells: every value is the same on all of
// them.
HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

template <bool kFractions>
HWY_INLINE void count(DoubleDouble step, double grid, std::span<const double> x, double* HWY_RESTRICT coarse,
                      double* HWY_RESTRICT fine) {
  const double low = step.low, shift = 0x1.8p52 * grid;
  for (std::size_t i = 0; i < x.size(); ++i) {
    DoubleDouble cycles = exact_product(x[i], step.high);
    cycles.low += x[i] * low;
    if constexpr (kFractions) {
      cycles = exact_sum(cycles.high - nearest_whole(cycles.high), cycles.low);
      cycles.high -= nearest_whole(cycles.high);
    }
    coarse[i] = (cycles.high + shift) - shift;
    fine[i] = (cycles.high - coarse[i]) + cycles.low;
  }
}

void CountCycles(DoubleDouble step, double grid, bool fractions, std::span<const double> x, double* coarse,
                 double* fine) {
  fractions ? count<true>(step, grid, x, coarse, fine) : count<false>(step, grid, x, coarse, fine);
}

// Means: constant + varying(i).
template <class Varying>
HWY_INLINE void write(const MeansOutput& to, double constant, const Varying& varying) {
  double* HWY_RESTRICT out = to.means.data();
  const std::size_t count = to.means.size();
  const double steady = to.steady + constant;
  if (to.adds)
    for (std::size_t i = 0; i < count; ++i) out[i] += constant + varying(i);
  else
    for (std::size_t i = 0; i < count; ++i) out[i] = steady + varying(i);
}

// Within ±1/2; nothing is rounded but the last place of `fine`.
HWY_INLINE DoubleDouble fraction_at(const Cycles& fractions, std::size_t i) {
  const double sum = fractions.coarse[i] + fractions.origin.high;
  return {sum - nearest_whole(sum), fractions.fine[i] + fractions.origin.low};
}

// cos(2π·turns) for turns in [-1/2, 1/2], within 3e-16, as sin(x) = x − x³/3! + … at x = 2π(1/4 − |turns|).
HWY_INLINE double cosine_of(double turns) {
  const double x = kTwoPi * (0.25 - std::abs(turns));
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

void WriteTone(const ToneMeans& light, const Cycles& cycles, const MeansOutput& to) {
  const double amplitude = light.level * light.swing;
  write(to, light.level, [at = cycles, amplitude](std::size_t i) HWY_ATTR {
    const DoubleDouble turns = fraction_at(at, i);
    return amplitude * cosine_of(turns.value());
  });
}

void WriteSquare(const SquareMeans& light, const Cycles& cycles, const MeansOutput& to) {
  const double scale = light.level / light.length;
  write(to, light.whole_light * scale, [own = light, at = cycles, scale](std::size_t i) HWY_ATTR {
    const DoubleDouble middle = fraction_at(at, i);
    const double side = std::copysign(1.0, middle.value());  // of the nearest pulse
    const double overlap = (own.reach.high - side * middle.high) + (own.reach.low - side * middle.low);
    return std::min(std::max(own.least, overlap), own.most) * scale;
  });
}

const hn::CappedTag<double, kMaxReadAhead> d64;
using Exposures = hn::Vec<decltype(d64)>;

// The mean light of exposures that end in one cell, u cells after its beginning; r = part_rest:
//   v = min(u, r), w = u − v:   light + v·(rise + v·rise_slope) + w·(later + w·later_slope)
// Up to u = r they begin in one cell (the first), then in the next one (the second).
template <bool kSlopes>
struct CellWindow {
  double light, rise, later, rise_slope, later_slope;

  HWY_INLINE Exposures mean(Exposures u, Exposures rest) const {
    const Exposures v = hn::Min(u, rest), w = hn::Sub(u, v);
    Exposures of_v = hn::Set(d64, rise), of_w = hn::Set(d64, later);
    if constexpr (kSlopes) {
      of_v = hn::Add(of_v, hn::Mul(v, hn::Set(d64, rise_slope)));
      of_w = hn::Add(of_w, hn::Mul(w, hn::Set(d64, later_slope)));
    }
    return hn::Add(hn::Set(d64, light), hn::Add(hn::Mul(v, of_v), hn::Mul(w, of_w)));
  }
};

// Cells of the tables: in one exposures end, in the other they begin up to its beginning.
struct CellPair {
  std::int64_t end, second;

  // From the first cell of a round on; where cells do not repeat, both are inside.
  static CellPair at(const CellMeans& own, double cell) {
    const std::int64_t count = own.count, end = (own.origin_cell + static_cast<std::int64_t>(cell)) % count;
    const std::int64_t inside = end + (end < 0 ? count : 0), second = inside - own.part_whole;
    return {inside, second + (second < 0 ? count : 0)};
  }

  HWY_INLINE void step(std::int64_t count) {
    end = end + 1 < count ? end + 1 : 0;
    second = second + 1 < count ? second + 1 : 0;
  }
};

template <bool kSlopes, bool kLows>
HWY_INLINE CellWindow<kSlopes> window_of(const CellMeans& own, const CellPair& cells) {
  const double *const end = own.chain + 2 * cells.end, *const second = own.chain + 2 * cells.second;
  const bool wraps = cells.end < cells.second;
  const double rest = own.part_rest, scale = own.scale;
  double light = (end[0] - second[0]) + (wraps ? own.chain[2 * own.count] : 0.0);
  if constexpr (kLows)
    light += (own.before_low[cells.end] - own.before_low[cells.second]) + (wraps ? own.before_low[own.count] : 0.0);
  const double value = end[1], first_value = second[-1], later = value - second[1];
  if constexpr (!kSlopes)
    return {(own.whole_light + (light + rest * first_value)) * scale, (value - first_value) * scale, later * scale, 0,
            0};
  const double slope = own.slopes[cells.end], first_slope = own.slopes[cells.second - 1];
  light += rest * (first_value + first_slope * (1 - rest / 2));
  return {(own.whole_light + light) * scale, (value - (first_value + first_slope * (1 - rest))) * scale,
          (later + slope * rest) * scale, (slope - first_slope) / 2 * scale,
          (slope - own.slopes[cells.second]) / 2 * scale};
}

// Where exposure i ends, in cells from the beginning of `cell`: right to half the last place of a small difference.
HWY_INLINE double since(const Cycles& at, double cell, std::size_t i) {
  return (at.coarse[i] + (at.origin.high - cell)) + (at.fine[i] + at.origin.low);
}

// The cell in which exposure i ends; the second step corrects the rounding of a large difference.
HWY_INLINE double cell_at(const Cycles& at, double cell, std::size_t i) {
  const double near = cell + std::floor(since(at, cell, i));
  return near + std::floor(since(at, near, i));
}

// The first exposure after i that ends in another cell, or `count`, from a guess. Those between i and the guess end in
// the same cell, but for one by rounding.
HWY_INLINE std::size_t first_elsewhere(const Cycles& at, double cell, std::size_t guess, std::size_t i,
                                       std::size_t count) {
  std::size_t next = std::min(guess, count);
  while (next < count && since(at, cell, next) < 1 && since(at, cell, next) >= 0) ++next;
  while (next > i + 1 && since(at, cell, next - 1) >= 1) --next;
  return std::max(next, i + 1);
}

// Exposures that end in the same cell share its window. Vectors reach beyond them; the next ones overwrite that. Where
// a cell's even exposures end is guessed without those before, one cell ahead, so that processors work on both at once.
template <bool kSlopes, bool kLows>
HWY_INLINE void means_of_cells(const CellMeans& own, const Cycles& at, std::size_t count, double* HWY_RESTRICT to) {
  const Exposures fine_origin = hn::Set(d64, at.origin.low), rest = hn::Set(d64, own.part_rest);
  double cell = cell_at(at, 0, 0);  // from the origin's
  CellPair cells = CellPair::at(own, cell);
  const double per_cell = 1 / own.cells_per_exposure, before_first = cell + since(at, cell, 0) - 1;
  const auto guess_of = [=](double of) HWY_ATTR {
    const double exposures = (of - before_first) * per_cell;
    return exposures < static_cast<double>(count) ? static_cast<std::size_t>(std::max(exposures, 0.0)) + 1 : count;
  };
  std::size_t guess = guess_of(cell);
  for (std::size_t i = 0; i < count;) {
    const auto window = window_of<kSlopes, kLows>(own, cells);
    const Exposures origin = hn::Set(d64, at.origin.high - cell);
    const std::size_t next = first_elsewhere(at, cell, own.even ? guess : i + 1, i, count);
    guess = guess_of(cell + 1);
    for (; i < next; i += hn::Lanes(d64)) {
      const Exposures u =
          hn::Add(hn::Add(hn::LoadU(d64, at.coarse + i), origin), hn::Add(hn::LoadU(d64, at.fine + i), fine_origin));
      hn::StoreU(window.mean(u, rest), d64, to + i);
    }
    i = next;
    if (i == count) return;
    if (since(at, cell, i) >= 1 && since(at, cell, i) < 2) {
      cell += 1;
      cells.step(own.count);
    } else {
      cell = cell_at(at, cell, i);
      cells = CellPair::at(own, cell);
      guess = guess_of(cell);
    }
  }
}

template <bool kSlopes, bool kLows>
HWY_INLINE void write_cells(const CellMeans& own, const Cycles& at, const MeansOutput& to) {
  constexpr std::size_t kMost = 512;
  alignas(64) double means[kMost + kMaxReadAhead];
  for (std::size_t first = 0; first < to.means.size(); first += kMost) {
    const std::size_t size = std::min(kMost, to.means.size() - first);
    means_of_cells<kSlopes, kLows>(own, {at.coarse + first, at.fine + first, at.origin, at.grid}, size, means);
    write({to.means.subspan(first, size), to.adds, to.steady}, 0,
          [&means](std::size_t i) HWY_ATTR { return means[i]; });
  }
}

void WriteCells(const CellMeans& light, const Cycles& at, const MeansOutput& to) {
  const bool lows = light.before_low != nullptr;
  if (light.slopes)
    lows ? write_cells<true, true>(light, at, to) : write_cells<true, false>(light, at, to);
  else
    lows ? write_cells<false, true>(light, at, to) : write_cells<false, false>(light, at, to);
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(CountCycles);
HWY_EXPORT(WriteTone);
HWY_EXPORT(WriteSquare);
HWY_EXPORT(WriteCells);

void count_cycles(DoubleDouble step, double grid, bool fractions, std::span<const double> x, double* coarse,
                  double* fine) {
  HWY_DYNAMIC_DISPATCH(CountCycles)(step, grid, fractions, x, coarse, fine);
}

void write_means(const ToneMeans& light, const Cycles& cycles, const MeansOutput& to) {
  HWY_DYNAMIC_DISPATCH(WriteTone)(light, cycles, to);
}

void write_means(const SquareMeans& light, const Cycles& cycles, const MeansOutput& to) {
  HWY_DYNAMIC_DISPATCH(WriteSquare)(light, cycles, to);
}

void write_means(const CellMeans& light, const Cycles& cycles, const MeansOutput& to) {
  HWY_DYNAMIC_DISPATCH(WriteCells)(light, cycles, to);
}

}  // namespace ocisac::kernels
#endif
