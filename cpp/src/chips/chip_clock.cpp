#include "ocisac/chips/chip_clock.hpp"

#include <cmath>

namespace ocisac {

std::ptrdiff_t chip_at(double row, const ChipClock& clock) {
  return static_cast<std::ptrdiff_t>(std::floor((row - clock.phase) / clock.rows_per_chip));
}

double ClockErrors::phase_std(std::ptrdiff_t at) const {
  const auto away = static_cast<double>(at - chip);
  return std::sqrt(covariance[0] + 2 * away * covariance[1] + away * away * covariance[4]);
}

double ClockErrors::rows_per_chip_std() const { return std::sqrt(covariance[4]); }

double ClockErrors::exposure_rows_std() const { return std::sqrt(covariance[8]); }

ChipGrid whole_chips(const ChipClock& clock, std::size_t rows) {
  constexpr double kRounding = 1e-9;  // chips
  const double begin = (-0.5 - clock.phase) / clock.rows_per_chip - kRounding;
  const double end = (static_cast<double>(rows) - 0.5 - clock.phase) / clock.rows_per_chip + kRounding;
  const auto first = static_cast<std::ptrdiff_t>(std::ceil(begin)), last = static_cast<std::ptrdiff_t>(std::floor(end));
  return {clock, first, last > first ? static_cast<std::size_t>(last - first) : 0};
}

ChipGrid affecting_chips(const ChipClock& clock, std::size_t rows) {
  const double half = 0.5 * clock.exposure_rows, last_row = static_cast<double>(rows) - 1;
  const std::ptrdiff_t first = chip_at(-half, clock), last = chip_at(last_row + half, clock);
  return {clock, first, static_cast<std::size_t>(last - first + 1)};
}

}  // namespace ocisac
