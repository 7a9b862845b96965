// Positions of a light's chips in the rows of a frame: the clock shared by search, fit, tracking and detection.
#pragma once

#include <array>
#include <cstddef>

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
};

inline constexpr double kUnsettled = 0.05;  // fraction of a step at which the light of earlier chips is neglected
inline constexpr double kShortestExposure = 1e-3;  // rows

// Index of the chip at a row.
std::ptrdiff_t chip_at(double row, const ChipClock& clock);

// Standard errors of a clock. The phase is that of chip `chip`, the middle of the chips in use, where phase and rows
// per chip are nearly independent.
struct ClockErrors {
  std::ptrdiff_t chip = 0;
  // Covariance of (phase there, rows_per_chip, exposure), rows². Infinite for an exposure that is not separable from
  // the phase, 0 for a known one.
  std::array<double, 9> covariance{};

  [[nodiscard]] double phase_std(std::ptrdiff_t at) const;  // at the beginning of chip `at`
  [[nodiscard]] double rows_per_chip_std() const;
  [[nodiscard]] double exposure_rows_std() const;
};

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

}  // namespace ocisac
