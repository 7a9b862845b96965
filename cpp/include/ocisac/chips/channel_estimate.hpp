// Least-squares estimate of the channel from light to rows, given known chips: clock, exposure and levels.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/rows/chip_clock.hpp"

namespace ocisac {

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

// Row n = dark_n + swing_n·s_n + noise. Dark (steady 0) and swing (from steady 0 to steady 1) are polynomials along the
// frame, for gradients and vignetting.
struct ChannelModel {
  std::size_t dark_degree = 1;
  std::size_t swing_degree = 0;
  bool exposure_known = false;  // keep the start's exposure
  double rate_std = 0;   // standard error of the start's rows per chip, used as an additional measurement; 0: none
  double vain_step = 0;  // standard errors; a smaller step that does not lower the squares, at a kink, is the last
};

inline constexpr std::size_t kHighestDegree = 6;

struct ChannelEstimate {
  ChipClock clock{};
  ClockErrors errors;               // from the rows' residual
  std::vector<double> dark, swing;  // Legendre coefficients over −1 (first row) … 1 (last row)
  double noise = 0;                 // standard deviation of a row about the model
  RowRange rows;                    // used in the fit
  bool converged = false;

  [[nodiscard]] double swing_at(double row, std::size_t frame_rows) const;
  [[nodiscard]] double dark_at(double row, std::size_t frame_rows) const;
  // True if the rate deviates beyond the relative tolerance by more than its error: chips of a frame of a few rows may
  // be explained by another rate.
  [[nodiscard]] bool has_other_rate(double rows_per_chip, double tolerance) const;
};

// Residual of each row: the signal less the channel's response to the chips, as noisy as that of a whole exposure.
std::vector<double> channel_residual(std::span<const double> signal, const KnownChips& chips,
                                     const ChannelEstimate& channel);
// The same from the chips' response in each row (expose_chips).
std::vector<double> residual_beside(std::span<const double> signal, std::span<const double> exposed,
                                    const ChannelEstimate& channel);

// Bound on the work for a frame: rows processed by fits and detections, counted down with every pass. It counts work
// instead of time, so results are reproducible.
struct SearchEffort {
  double rows = std::numeric_limits<double>::infinity();

  // Returns false after the budget is used up.
  bool take(double needed) {
    rows -= needed;
    return rows >= 0;
  }
};

// Least squares of clock and levels (Gauss–Newton on the exact model), on the rows that depend on known chips only. The
// start must be accurate to about half a chip throughout. Absent if there are fewer rows than unknowns, or if the chips
// (all equal, for example) do not determine the channel.
std::optional<ChannelEstimate> fit_channel(std::span<const double> signal, const KnownChips& chips,
                                           const ChipClock& start, const ChannelModel& model = {},
                                           SearchEffort* effort = nullptr);

// Cramér–Rao bounds on the clock's standard errors for noise of standard deviation `noise` on each row that depends on
// known chips only, with unknown levels as in fit_channel. Swing and noise in the same unit. Absent if the channel is
// not determined.
std::optional<ClockErrors> clock_bounds(const KnownChips& chips, const ChipClock& clock, std::span<const double> swing,
                                        double noise, const ChannelModel& model = {});

// Mean of values weighted by the inverse squares of their standard errors. Its standard error is at least that from the
// values' scatter. Values that are not finite, or without an error, are ignored.
struct Pooled {
  double value;  // NaN without a valid value
  double std;
  std::size_t count;
};
Pooled pool_estimates(std::span<const double> values, std::span<const double> errors);

}  // namespace ocisac
