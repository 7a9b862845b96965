// Rows displaced along the frame by a smooth warp, as of an electronic image stabiliser.
#pragma once

#include <span>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

// W(m) rows at the even row m: row m − W(m) of the picture shows the light of row m of an even clock. Empty: no warp.
using RowWarp = std::vector<double>;

// The rows as of an even clock: cubic interpolation at m − W(m), held at the frame's ends.
std::vector<double> unwarped(std::span<const double> signal, const RowWarp& warp);
// The picture's rows of even ones.
std::vector<double> warped(std::span<const double> even_rows, const RowWarp& warp);

// The row of the picture at an even row.
double picture_row(double even_row, const RowWarp& warp);

// The same warp of even rows that are as far apart as the clock with that rate says: warp and clock both explain a
// rate, and the exposure is known in even rows of the camera.
void set_rate(double rows_per_chip, RowWarp& warp, ChipClock& clock);

// Displacement x from observations y = slope·x + noise, one a row: its mean given all of them, for a random walk of its
// rate of change (Kalman filter and Rauch–Tung–Striebel smoother). Mean 0 and kWarpStd, kWarpRateStd before; kWarpStep:
// standard deviation of the change of the rate from row to row.
RowWarp smooth_displacement(std::span<const double> observed, std::span<const double> slopes,
                            std::span<const double> noise);

inline constexpr double kWarpStd = 30, kWarpRateStd = 0.3, kWarpStep = 2.5e-3;  // rows, rows per row, the same

// The warp that explains what a channel leaves of even rows, which were read with `warp`; the noise of a row is that of
// the residual nearby. `doubtful`: rows with a correlated residual count as fewer, since their chips may be wrong.
RowWarp fit_warp(std::span<const double> even_rows, const RowWarp& warp, const KnownChips& chips,
                 const ChannelEstimate& channel, bool doubtful = false);

}  // namespace ocisac
