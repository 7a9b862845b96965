// Exposure integral of chips at each row, and its derivatives by the clock.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/rows/chip_clock.hpp"

namespace ocisac {

// s and its derivatives by phase, rows per chip and exposure.
struct Exposed {
  double value, by_phase, by_period, by_exposure;
};

// Chips with their cumulative sums.
// From level l at the beginning of chip c on, p chips into it, with τ the clock's rise or fall:
//
//   level c + (l − c)·e^(−p/τ), integral c·p + (l − c)·τ·(1 − e^(−p/τ))
class ChipBox {
 public:
  // Only rise and fall of `shape` are used.
  ChipBox(const KnownChips& chips, const ChipClock& shape)
      : targets_(chips.levels), rise_(shape.rise), fall_(shape.fall), first_(static_cast<double>(chips.first)) {
    sums_.reserve(targets_.size() + 1);
    sums_.push_back(0);
    const bool at_once = rise_ == 0 && fall_ == 0;
    if (!at_once) starts_.reserve(targets_.size());
    double level = targets_.empty() ? 0.0 : targets_.front();
    for (double target : targets_) {
      if (!at_once) starts_.push_back(level);
      const Place end = at_once ? Place{0, 1, target, target} : approach(target, level, 1);
      sums_.push_back(sums_.back() + end.integral);
      level = end.level;
    }
  }

  [[nodiscard]] bool has_shape_of(const ChipClock& clock) const { return clock.rise == rise_ && clock.fall == fall_; }
  [[nodiscard]] bool is_at_once() const { return starts_.empty(); }
  [[nodiscard]] std::span<const double> targets() const { return targets_; }
  [[nodiscard]] std::span<const double> sums() const { return sums_; }  // over the chips before each
  [[nodiscard]] double first() const { return first_; }

  // With clock.phase that of chip `origin`.
  [[nodiscard]] Exposed at(double row, const ChipClock& clock, double origin) const {
    const auto n = static_cast<std::ptrdiff_t>(row);
    const double share = clock.share_at(n), exposure = share * clock.exposure_rows, half = 0.5 * exposure;
    const double middle = clock.is_long(n) ? row : row + clock.later, per_row = 1 / exposure;
    const double chips_begin = (middle - half - clock.phase) / clock.rows_per_chip;
    const double chips_end = (middle + half - clock.phase) / clock.rows_per_chip;
    const Place begin = place(chips_begin + origin - first_), end = place(chips_end + origin - first_);
    // ∫ chips, in chips: differences of cumulative sums are exact for whole chips.
    const double area = begin.chip == end.chip && starts_.empty()
                            ? end.level * exposure / clock.rows_per_chip
                            : (sums_[end.chip] - sums_[begin.chip]) + end.integral - begin.integral;
    const double value = clock.rows_per_chip * per_row * area;
    return {value, per_row * (begin.level - end.level),
            per_row * (area - end.level * chips_end + begin.level * chips_begin),
            share * per_row * (0.5 * (begin.level + end.level) - value)};
  }

 private:
  struct Place {
    std::size_t chip;
    double part, level, integral;  // chips past its beginning; the light there, and its integral from there
  };
  [[nodiscard]] Place approach(double target, double start, double part) const {
    const double time = target > start ? rise_ : fall_;
    if (time == 0 || part <= 0) return {0, part, part <= 0 ? start : target, (part <= 0 ? start : target) * part};
    const double left = std::exp(-part / time);
    return {0, part, target + (start - target) * left, target * part + (start - target) * time * (1 - left)};
  }
  [[nodiscard]] Place place(double chips) const {
    const double last = static_cast<double>(targets_.size() - 1);
    const auto chip = static_cast<std::size_t>(static_cast<std::ptrdiff_t>(std::clamp(chips, 0.0, last)));
    const double part = chips - static_cast<double>(static_cast<std::ptrdiff_t>(chip));
    if (starts_.empty()) return {chip, part, targets_[chip], targets_[chip] * part};
    Place there = approach(targets_[chip], starts_[chip], part);
    there.chip = chip;
    return there;
  }

  std::span<const double> targets_;
  double rise_, fall_;
  std::vector<double> starts_;  // light at the chips' beginnings; empty where it is there at once
  std::vector<double> sums_;
  double first_;
};

// Time and memory grow with the rows of a chip and with their inverse.
inline constexpr double kMinRowsPerChip = 0.01;
void check_rows_per_chip(double rows_per_chip);
void check_clock(const ChipClock& clock);
void check_chips(const KnownChips& chips);

// Clock with an exposure of at least kShortestExposure.
ChipClock with_min_exposure(ChipClock clock);

// Clock renumbered so that chip `chips` becomes chip 0.
ChipClock moved_to(ChipClock clock, std::ptrdiff_t chips);

}  // namespace ocisac
