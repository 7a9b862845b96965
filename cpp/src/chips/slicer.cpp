#include "ocisac/chips/slicer.hpp"

#include <algorithm>
#include <cmath>

#include "core/levels.hpp"

namespace ocisac {

namespace {

// Line through the other chips of a kind, weighted by distance, evaluated at chip `at`; its slope is regularised if
// there are few.
double line_through_others(std::span<const double> values, std::span<const std::size_t> chips, std::size_t at,
                           double reach) {
  const bool alone = chips.size() == 1;
  const auto weight = [&](std::size_t chip) {
    const double distance = (static_cast<double>(chip) - static_cast<double>(at)) / reach;
    return chip == at && !alone ? 0.0 : 1 / std::pow(1 + distance * distance, 2);
  };
  double total = 0, mean = 0, middle = 0;
  for (std::size_t chip : chips) {
    const double w = weight(chip);
    total += w;
    mean += w * values[chip];
    middle += w * (static_cast<double>(chip) - static_cast<double>(at));
  }
  mean /= total;
  middle /= total;
  double cross = 0, square = 0.25 * reach * reach;
  for (std::size_t chip : chips) {
    const double w = weight(chip), away = static_cast<double>(chip) - static_cast<double>(at) - middle;
    cross += w * away * (values[chip] - mean);
    square += w * away * away;
  }
  return mean - cross / square * middle;
}

// Level of the chips of one kind (`kind[chip] == bit`) along the frame: at each of them a line through its neighbours
// of that kind, without the chip itself; linear interpolation between them, constant beyond. Needs at least one chip of
// the kind.
std::vector<double> chip_level(std::span<const double> values, std::span<const std::uint8_t> kind, std::uint8_t bit) {
  const double reach = std::clamp(static_cast<double>(values.size()) / 16, 2.0, 6.0);
  std::vector<std::size_t> chips;
  for (std::size_t k = 0; k < kind.size(); ++k)
    if (kind[k] == bit) chips.push_back(k);
  std::vector<double> level(values.size());
  for (std::size_t chip : chips) level[chip] = line_through_others(values, chips, chip, reach);
  std::fill(level.begin(), level.begin() + static_cast<std::ptrdiff_t>(chips.front()), level[chips.front()]);
  std::fill(level.begin() + static_cast<std::ptrdiff_t>(chips.back()), level.end(), level[chips.back()]);
  for (std::size_t i = 1; i < chips.size(); ++i) {
    const std::size_t from = chips[i - 1], to = chips[i];
    const double slope = (level[to] - level[from]) / static_cast<double>(to - from);
    for (std::size_t k = from + 1; k < to; ++k) level[k] = level[from] + slope * static_cast<double>(k - from);
  }
  return level;
}

SlicedChips decide(std::span<const double> values, std::span<const std::uint8_t> bits) {
  SlicedChips result{{}, chip_level(values, bits, 0), chip_level(values, bits, 1), {}};
  double largest = 0;
  for (std::size_t k = 0; k < values.size(); ++k) largest = std::max(largest, result.bright[k] - result.dark[k]);
  for (std::size_t k = 0; k < values.size(); ++k) {
    const double swing = std::max(result.bright[k] - result.dark[k], 1e-3 * std::max(largest, 1e-12));
    result.relative_levels.push_back((values[k] - 0.5 * (result.bright[k] + result.dark[k])) / (0.5 * swing));
    result.bits.push_back(result.relative_levels.back() > 0);
  }
  return result;
}

bool holds_both(std::span<const std::uint8_t> bits) {
  return std::ranges::find(bits, 0) != bits.end() && std::ranges::find(bits, 1) != bits.end();
}

}  // namespace

std::vector<double> chip_values(std::span<const double> signal, const ChipGrid& grid,
                                std::optional<double> exposure_rows) {
  if (signal.size() < 2) return {signal.begin(), signal.begin() + (grid.count > 0 ? 1 : 0)};
  const double period = grid.clock.rows_per_chip;
  const double reach = std::max(exposure_rows ? 0.4 * std::max(period - *exposure_rows, 0.0) : 0.25 * period, 0.5);
  const auto last = static_cast<double>(signal.size() - 1);
  std::vector<double> total(signal.size(), 0.0);  // integral of the linearly interpolated signal from row 0
  for (std::size_t n = 1; n < signal.size(); ++n) total[n] = total[n - 1] + 0.5 * (signal[n] + signal[n - 1]);
  const auto area_to = [&](double place) {
    const auto n = std::min(static_cast<std::size_t>(place), signal.size() - 2);
    const double part = place - static_cast<double>(n);
    return total[n] + part * (signal[n] + 0.5 * part * (signal[n + 1] - signal[n]));
  };
  std::vector<double> values(grid.count);
  for (std::size_t k = 0; k < grid.count; ++k) {
    const double low = std::clamp(grid.centre(k) - reach, 0.0, last),
                 high = std::clamp(grid.centre(k) + reach, 0.0, last);
    values[k] = (area_to(high) - area_to(low)) / (high - low);
  }
  return values;
}

std::optional<SlicedChips> slice(std::span<const double> signal, const ChipGrid& grid,
                                 std::optional<double> exposure_rows, std::span<const std::uint8_t> guess) {
  const auto values = chip_values(signal, grid, exposure_rows);
  std::vector<std::uint8_t> bits(guess.begin(), guess.end());
  SlicedChips decided;
  for (int round = 0; round < kMaxIterations; ++round) {
    if (!holds_both(bits)) return std::nullopt;
    decided = decide(values, bits);
    if (decided.bits == bits) break;
    bits = decided.bits;
  }
  return decided;
}

}  // namespace ocisac
