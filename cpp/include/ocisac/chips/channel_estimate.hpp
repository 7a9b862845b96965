// The channel from light to rows, estimated by least squares from chips that are known: clock, exposure and levels.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/chip_timing.hpp"

namespace ocisac {

// The chips first, first + 1, … of a light: levels between 0 (dark) and 1 (bright).
struct KnownChips {
  std::span<const double> levels;
  std::ptrdiff_t first = 0;
};

// Where the chips lie and what the exposure makes of them. Row n sees the mean over rows n − exposure/2 … n +
// exposure/2 of the chips, chip k lying between phase + k·rows_per_chip and phase + (k + 1)·rows_per_chip:
//
//   s_n = (1/exposure)·∫ chips        0 ≤ s_n ≤ 1
struct ChipClock {
  double rows_per_chip;
  double phase;          // rows, of chip 0, in the middle of the exposure: half an exposure after the light's own edge
  double exposure_rows;  // rows; below kShortestExposure rows taken as that
};

inline constexpr double kShortestExposure = 1e-3;

// s_n of rows 0 … out.size() − 1, to the rounding of a row's place (1e-12 rows) over the exposure; the first and the
// last known chip go on for ever.
void expose_chips(const KnownChips& chips, const ChipClock& clock, std::span<double> out);

// The rows that see known chips only.
struct RowRange {
  std::size_t begin = 0, end = 0;
  [[nodiscard]] std::size_t size() const { return end - begin; }
};
RowRange rows_of(const KnownChips& chips, const ChipClock& clock, std::size_t rows);

// Row n reads dark_n + swing_n·s_n plus noise; dark (steady 0) and swing (from steady 0 to steady 1) are polynomials
// along the frame: gradient, vignetting.
struct ChannelModel {
  std::size_t dark_degree = 1;
  std::size_t swing_degree = 0;
  bool exposure_known = false;  // kept as it is
  double rate_std = 0;          // standard error of the start's rows per chip, taken in as one more reading; 0: none
};

inline constexpr std::size_t kHighestDegree = 6;

// Standard errors of a clock. The phase is that of chip `chip`, the middle of the chips that were used, where phase
// and rows per chip are nearly independent.
struct ClockErrors {
  std::ptrdiff_t chip = 0;
  // Of phase there, rows_per_chip, exposure; rows². Infinite for an exposure that no row tells from the phase, 0 for
  // one that is known.
  std::array<double, 9> covariance{};

  [[nodiscard]] double phase_std(std::ptrdiff_t at) const;  // of the beginning of chip `at`
  [[nodiscard]] double rows_per_chip_std() const;
  [[nodiscard]] double exposure_rows_std() const;
};

struct ChannelEstimate {
  ChipClock clock{};
  ClockErrors errors;               // from the rows' residual
  std::vector<double> dark, swing;  // Legendre coefficients over −1 (first row) … 1 (last row)
  double noise = 0;                 // standard deviation of a row about the model
  RowRange rows;                    // that were used
  bool converged = false;

  [[nodiscard]] double swing_at(double row, std::size_t frame_rows) const;
  [[nodiscard]] double dark_at(double row, std::size_t frame_rows) const;
};

// What the search of a frame may take in all: rows that fits and detections go through, each as often as it is gone
// through; counted down. By counts, not by the clock: the same frames give the same results everywhere.
struct SearchEffort {
  double rows = std::numeric_limits<double>::infinity();

  // False where it is used up.
  bool take(double needed) {
    rows -= needed;
    return rows >= 0;
  }
};

// Least squares of clock and levels (Gauss–Newton on the exact model) on the rows that see known chips only, from a
// clock good to about half a chip anywhere in them. Absent where there are fewer rows than unknowns or the chips (all
// alike, say) do not determine the channel.
std::optional<ChannelEstimate> fit_channel(std::span<const double> signal, const KnownChips& chips,
                                           const ChipClock& start, const ChannelModel& model = {},
                                           SearchEffort* effort = nullptr);

// Squares that the best levels leave at a given clock; the exposure_known of the model does not matter. Absent where
// they are not determined.
struct LevelSquares {
  double squares;
  std::size_t rows;
};
std::optional<LevelSquares> level_squares(std::span<const double> signal, const KnownChips& chips,
                                          const ChipClock& clock, const ChannelModel& model);

// Cramér–Rao bounds of the clock's standard errors for a noise of standard deviation `noise` on each of the frame's
// rows that see known chips only; levels unknown, as in fit_channel. Swing and noise in the same unit. Absent where
// the channel is not determined.
std::optional<ClockErrors> clock_bounds(const KnownChips& chips, const ChipClock& clock, std::span<const double> swing,
                                        double noise, const ChannelModel& model = {});

// One value from many with standard errors: the mean weighted by their inverse squares. Its standard error is never
// below what the values' scatter tells. Values that are not finite, or have no error, do not count.
struct Pooled {
  double value;  // NaN where none counts
  double std;
  std::size_t count;
};
Pooled pool_estimates(std::span<const double> values, std::span<const double> errors);

}  // namespace ocisac
