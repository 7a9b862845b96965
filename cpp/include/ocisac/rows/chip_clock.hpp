// Positions of a light's chips in the rows of a frame, and the exposure integral of known ones.
#pragma once

#include <cstddef>
#include <span>

#include "ocisac/core/region.hpp"

namespace ocisac {

// Chip clock and exposure. Row n is the mean of the chips over rows n − exposure/2 … n + exposure/2; chip k lies
// between phase + k·rows_per_chip and phase + (k + 1)·rows_per_chip:
//
//   s_n = (1/exposure)·∫ chips        0 ≤ s_n ≤ 1
struct ChipClock {
  double rows_per_chip = 0;
  double phase = 0;          // rows, of chip 0, in the middle of the exposure: half an exposure after the light's edge
  double exposure_rows = 0;  // rows; at least kShortestExposure is used
  // Time constants with which the light approaches a chip that is brighter or darker than it, chips; 0: at once. The
  // level at the beginning of the first known chip is its own.
  double rise = 0, fall = 0;
  double edge_std = 0;  // chips, by which edges of the light lie off the clock; 0: not at all. For detection alone
  // Two exposures in turns, as of HDR in pairs of rows: from `long_row` on, two rows of the whole one, then two of the
  // share `shorter` of it, whose middle is `later` rows later; stored as bright, they have 1/shorter times the noise.
  double shorter = 1, later = 0;
  std::ptrdiff_t long_row = 0;

  [[nodiscard]] bool is_long(std::ptrdiff_t row) const { return shorter == 1 || ((row - long_row) & 2) == 0; }
  [[nodiscard]] double share_at(std::ptrdiff_t row) const { return is_long(row) ? 1.0 : shorter; }
  // The end of a row's exposure.
  [[nodiscard]] double end_at(std::ptrdiff_t row) const {
    return static_cast<double>(row) + (is_long(row) ? 0.5 * exposure_rows : later + 0.5 * shorter * exposure_rows);
  }
  [[nodiscard]] ChipClock from_row(std::ptrdiff_t row) const {  // of the rows from there on
    ChipClock clock = *this;
    clock.phase -= static_cast<double>(row);
    clock.long_row -= row;
    return clock;
  }
};

inline constexpr double kUnsettled = 0.05;  // fraction of a step at which the light of earlier chips is neglected
inline constexpr double kShortestExposure = 1e-3;  // rows

// Index of the chip at a row.
std::ptrdiff_t chip_at(double row, const ChipClock& clock);

// Consecutive chips of a clock: first, first + 1, … first + count − 1.
struct ChipGrid {
  ChipClock clock;
  std::ptrdiff_t first = 0;
  std::size_t count = 0;

  [[nodiscard]] double start(std::size_t chip) const {
    return clock.phase + static_cast<double>(first + static_cast<std::ptrdiff_t>(chip)) * clock.rows_per_chip;
  }
  [[nodiscard]] double centre(std::size_t chip) const { return start(chip) + 0.5 * clock.rows_per_chip; }
};

// Chips that lie whole in a frame, and chips that affect any of its rows.
ChipGrid whole_chips(const ChipClock& clock, std::size_t rows);
ChipGrid affecting_chips(const ChipClock& clock, std::size_t rows);

// The chips first, first + 1, … of a light: levels between 0 (dark) and 1 (bright).
struct KnownChips {
  std::span<const double> levels;
  std::ptrdiff_t first = 0;
};

// s_n of rows 0 … out.size() − 1, with error (1e-12 rows)/exposure; the first and the last known chip extend without
// end.
void expose_chips(const KnownChips& chips, const ChipClock& clock, std::span<double> out);

// Range of the rows that depend on known chips only, after the light settled from its unknown first level.
using RowRange = IndexRange;
RowRange rows_of(const KnownChips& chips, const ChipClock& clock, std::size_t rows);

}  // namespace ocisac
