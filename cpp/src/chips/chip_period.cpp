#include "chips/chip_period.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace ocisac {

namespace {

constexpr std::size_t kMaxPeriod = 4, kMinBitsForExposure = 12;

}

std::optional<std::size_t> chip_period(std::span<const std::uint8_t> bits, std::size_t min_bits) {
  if (bits.size() < min_bits) return std::nullopt;
  for (std::size_t period = 1; period <= kMaxPeriod; ++period)
    if (std::equal(bits.begin() + static_cast<std::ptrdiff_t>(period), bits.end(), bits.begin())) return period;
  return std::nullopt;
}

std::optional<ChannelEstimate> with_shortest_exposure(ChannelEstimate channel, std::span<const std::uint8_t> bits) {
  const auto found = chip_period(bits, kMinBitsForExposure);
  if (!found) return std::nullopt;
  ChipClock& clock = channel.clock;
  const auto period = static_cast<double>(*found);
  const double mean = std::accumulate(bits.begin(), bits.begin() + static_cast<std::ptrdiff_t>(*found), 0.0) / period;
  const double exposure = clock.exposure_rows / clock.rows_per_chip;
  double shortest = std::fmod(exposure, period);
  const double whole_periods = exposure - shortest;  // chips
  double constant = whole_periods * mean;
  if (*found == 2 && shortest > 1) {
    constant += shortest - 1;
    shortest = 2 - shortest;
  }
  if (!(shortest > 0 && shortest < exposure)) return std::nullopt;
  clock.exposure_rows = shortest * clock.rows_per_chip;
  clock.phase += std::remainder(0.5 * whole_periods, period) * clock.rows_per_chip;
  channel.dark.resize(std::max(channel.dark.size(), channel.swing.size()));
  for (std::size_t k = 0; k < channel.swing.size(); ++k) {
    channel.dark[k] += channel.swing[k] * constant / exposure;
    channel.swing[k] *= shortest / exposure;
  }
  return channel;
}

}  // namespace ocisac
