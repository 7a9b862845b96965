// Light of a row under gains, compiled once for each SIMD target.
#pragma once

#include <cstddef>
#include <cstdint>

namespace ocisac::kernels {

inline constexpr double kLeastLeft = 1e-9;  // of the light of a row, as a divisor

// Light of a row and steady light, both from 1; largest gain.
struct RowGain {
  double swing, rise, most;
};

// Cells of equal width along the light, `per_light` in each unit, numbered from 0; those above have number `last`.
struct LightCells {
  double first, per_light, last;
};

// Columns under their gains.
struct Lit {
  double* light;  // before: without the gain
  std::int32_t* cell;
  std::uint8_t* is_bounded;  // 1 where the gain would be above the largest
};

// Gain (1 + q·rise)/(1 + q·swing) of each column's share q, at most `most`, times its light.
void apply_gains(const RowGain& row, const LightCells& cells, std::size_t columns, const double* share, const Lit& lit);

}  // namespace ocisac::kernels
