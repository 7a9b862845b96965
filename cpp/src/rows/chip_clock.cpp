#include "ocisac/rows/chip_clock.hpp"

#include <cmath>

#include "core/levels.hpp"
#include "ocisac/core/require.hpp"
#include "rows/exposed_chips.hpp"

namespace ocisac {

std::ptrdiff_t chip_at(double row, const ChipClock& clock) {
  return static_cast<std::ptrdiff_t>(std::floor((row - clock.phase) / clock.rows_per_chip));
}

ChipGrid whole_chips(const ChipClock& clock, std::size_t rows) {
  const double begin = (-0.5 - clock.phase) / clock.rows_per_chip - kEqual;
  const double end = (static_cast<double>(rows) - 0.5 - clock.phase) / clock.rows_per_chip + kEqual;
  const auto first = static_cast<std::ptrdiff_t>(std::ceil(begin)), last = static_cast<std::ptrdiff_t>(std::floor(end));
  return {clock, first, last > first ? static_cast<std::size_t>(last - first) : 0};
}

ChipGrid affecting_chips(const ChipClock& clock, std::size_t rows) {
  const double half = 0.5 * clock.exposure_rows, last_row = static_cast<double>(rows) - 1;
  const double of_shorter = clock.shorter * half;
  const std::ptrdiff_t first = chip_at(std::min(-half, clock.later - of_shorter), clock);
  const std::ptrdiff_t last = chip_at(last_row + std::max(half, clock.later + of_shorter), clock);
  return {clock, first, static_cast<std::size_t>(last - first + 1)};
}

void check_rows_per_chip(double rows_per_chip) {
  require(rows_per_chip >= kMinRowsPerChip && rows_per_chip <= 1e5, "rows_per_chip", rows_per_chip, "0.01 to 100000");
}

void check_clock(const ChipClock& clock) {
  require_positive("rows_per_chip", clock.rows_per_chip);
  require_finite("phase", clock.phase);
  require_not_negative("exposure_rows", clock.exposure_rows);
}

void check_chips(const KnownChips& chips) {
  require(!chips.levels.empty(), "chips", "none", "at least one chip");
  for (double level : chips.levels) require_finite("chips", level);
}

ChipClock with_min_exposure(ChipClock clock) {
  clock.exposure_rows = std::max(clock.exposure_rows, kShortestExposure);
  return clock;
}

ChipClock moved_to(ChipClock clock, std::ptrdiff_t chips) {
  clock.phase += static_cast<double>(chips) * clock.rows_per_chip;
  return clock;
}

void expose_chips(const KnownChips& chips, const ChipClock& clock, std::span<double> out) {
  check_chips(chips);
  check_clock(clock);
  const ChipBox box(chips, clock);
  const ChipClock used = with_min_exposure(clock);
  for (std::size_t n = 0; n < out.size(); ++n) out[n] = box.at(static_cast<double>(n), used, 0).value;
}

RowRange rows_of(const KnownChips& chips, const ChipClock& clock, std::size_t rows) {
  const auto first = static_cast<double>(chips.first), count = static_cast<double>(chips.levels.size());
  const double settling = std::max(clock.rise, clock.fall) * std::log(1 / kUnsettled);
  const double half = 0.5 * clock.exposure_rows, of_shorter = clock.shorter * half;
  const double begin =
      clock.phase + (first + settling) * clock.rows_per_chip + std::max(half, of_shorter - clock.later);
  const double end = clock.phase + (first + count) * clock.rows_per_chip - std::max(half, of_shorter + clock.later);
  const double limit = static_cast<double>(rows);
  const double low = std::clamp(std::ceil(begin), 0.0, limit), high = std::clamp(std::floor(end) + 1, low, limit);
  return {static_cast<std::size_t>(low), static_cast<std::size_t>(high)};
}

}  // namespace ocisac
