// Exposure integral of chips at each row, and its derivatives by the clock.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

// s and its derivatives by phase, rows per chip and exposure.
struct Exposed {
  double value, by_phase, by_period, by_exposure;
};

// Chips with their cumulative sums.
class ChipBox {
 public:
  explicit ChipBox(const KnownChips& chips) : levels_(chips.levels), first_(static_cast<double>(chips.first)) {
    sums_.reserve(levels_.size() + 1);
    sums_.push_back(0);
    for (double level : levels_) sums_.push_back(sums_.back() + level);
  }

  // s at a row; clock.phase is that of chip `origin`.
  [[nodiscard]] Exposed at(double row, const ChipClock& clock, double origin) const {
    const double half = 0.5 * clock.exposure_rows, per_row = 1 / clock.exposure_rows;
    const double chips_begin = (row - half - clock.phase) / clock.rows_per_chip;
    const double chips_end = (row + half - clock.phase) / clock.rows_per_chip;
    const Place begin = place(chips_begin + origin - first_), end = place(chips_end + origin - first_);
    // ∫ chips, in chips: differences of cumulative sums are exact for whole chips.
    const double area = begin.chip == end.chip
                            ? end.level * clock.exposure_rows / clock.rows_per_chip
                            : (sums_[end.chip] - sums_[begin.chip]) + end.level * end.part - begin.level * begin.part;
    const double value = clock.rows_per_chip * per_row * area;
    return {value, per_row * (begin.level - end.level),
            per_row * (area - end.level * chips_end + begin.level * chips_begin),
            per_row * (0.5 * (begin.level + end.level) - value)};
  }

 private:
  struct Place {
    std::size_t chip;
    double part, level;  // chips past its beginning; its level
  };
  [[nodiscard]] Place place(double chips) const {
    const double last = static_cast<double>(levels_.size() - 1);
    const double whole = std::clamp(std::floor(chips), 0.0, last);
    const auto chip = static_cast<std::size_t>(whole);
    return {chip, chips - whole, levels_[chip]};
  }

  std::span<const double> levels_;
  std::vector<double> sums_;
  double first_;
};

void check_clock(const ChipClock& clock);
void check_chips(const KnownChips& chips);

// Clock with an exposure of at least kShortestExposure.
ChipClock with_least_exposure(ChipClock clock);

// Clock renumbered so that chip `chips` becomes chip 0.
ChipClock moved_to(ChipClock clock, std::ptrdiff_t chips);

}  // namespace ocisac
