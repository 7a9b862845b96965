// A lamp's profile along the rows, learned from several frames.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

// Row n of frame f, without noise: y_f(n) = dark(n) + swing(n)·s_f(n), s the exposed chips.
struct RowProfile {
  std::vector<double> dark, swing;  // (rows)
};

// One frame of those that a profile is fitted to.
struct ProfileFrame {
  std::span<const double> signal;   // (rows)
  std::span<const double> exposed;  // s of each row; empty: unknown, the frame is not used
};

// Before chips are known: the frames' mean as dark; as swing the mean times the relative standard deviation over
// frames, smoothed over `smooth` rows either side, since reflectance scales both. Absent with fewer than two frames,
// where rows do not vary, and where a mean is not above 0.
std::optional<RowProfile> first_profile(std::span<const ProfileFrame> frames, std::size_t smooth);

// Least squares of each row over the frames. The swing is drawn to `shape` times its mean ratio to it over `smooth`
// rows either side, with a prior of `weight` times the mean information of a row. Rows where `shape` is 0 stay 0.
// Absent with fewer than three known frames, or where no chips vary.
std::optional<RowProfile> fit_profile(std::span<const ProfileFrame> frames, std::span<const double> shape,
                                      std::size_t smooth, double weight);

// The longest run of rows whose swing is above `share` of the largest.
RowRange profile_rows(const RowProfile& profile, double share);

// (y − dark) / swing of those rows.
std::vector<double> without_profile(std::span<const double> signal, const RowProfile& profile, RowRange rows);

}  // namespace ocisac
