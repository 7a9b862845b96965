#include "light/time_line.hpp"

#include "ocisac/core/require.hpp"

namespace ocisac {

CycleCounter::CycleCounter(DoubleDouble rate, const TimeLine& line, DoubleDouble offset)
    : step_(rate * DoubleDouble{line.step, 0}) {
  const DoubleDouble base = rate * line.origin + offset;
  base_whole_ = std::abs(base.high) < kMaxCycles ? nearest_whole(base.high) : base.high;
  base_ = base + DoubleDouble{-base_whole_, 0};
}

DoubleDouble CycleCounter::origin_rest(double grid) const {
  const double coarse = std::round(base_.high / grid) * grid;
  return {coarse, (base_.high - coarse) + base_.low};
}

void CycleCounter::require_countable(double x_first, double x_last, const char* argument) const {
  for (double x : {x_first, x_last}) {
    const double cycles = x * step_.high;
    const bool countable = std::abs(cycles) < kMaxCycles && std::abs(base_whole_) < kMaxCycles;
    require(countable, argument, std::abs(cycles + base_whole_), "at most 2^50 cycles or chips at the requested times");
  }
}

DoubleDouble turns(double angle) {
  constexpr DoubleDouble kTurnsPerRadian{0x1.45f306dc9c883p-3, -0x1.6b01ec5417056p-57};  // 1/(2π)
  return DoubleDouble{angle, 0} * kTurnsPerRadian;
}

}  // namespace ocisac
