#include "chips/chip_period.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace ocisac {

namespace {

constexpr double kSurelyPeriodic = 6;  // bits of evidence

// Rises of chips that repeat.
std::size_t rises_in(std::span<const std::uint8_t> period) {
  std::size_t rises = 0;
  for (std::size_t k = 0; k < period.size(); ++k) rises += period[k] < period[(k + 1) % period.size()];
  return rises;
}

// Chips that the first run has more than the next one of its kind, if there is one.
template <class Iterator>
std::size_t excess(Iterator first, Iterator last) {
  if (first == last) return 0;
  const auto fall = std::find(first, last, !*first), next = std::find(fall, last, *first);
  const auto next_fall = std::find(next, last, !*first);
  return next == last ? 0 : static_cast<std::size_t>(std::max(fall - first - (next_fall - next), std::ptrdiff_t{0}));
}

}  // namespace

std::optional<std::span<const std::uint8_t>> chip_period(std::span<const std::uint8_t> bits) {
  bits = bits.subspan(excess(bits.begin(), bits.end()));
  bits = bits.first(bits.size() - excess(bits.rbegin(), bits.rend()));
  const auto evidence = [&](std::size_t period) {
    const auto length = static_cast<double>(period);
    return static_cast<double>(bits.size()) - length - std::log2(length);
  };
  for (std::size_t period = 1; 2 * period <= bits.size() && evidence(period) >= kSurelyPeriodic; ++period)
    if (rises_in(bits.first(period)) < 2 && std::ranges::equal(bits.subspan(period), bits.first(bits.size() - period)))
      return bits.first(period);
  return std::nullopt;
}

bool are_periodic(std::span<const std::uint8_t> bits) {
  if (chip_period(bits)) return true;
  double places = 0, changes = 0, run = 0, longest = 0;
  const auto first = static_cast<std::size_t>(std::ranges::find(bits, 1) - bits.begin());
  for (std::size_t k = 0; k < bits.size(); ++k) {
    if (k % 2 != first % 2) {
      if (bits[k]) return false;
      continue;
    }
    places += 1;
    changes += k >= 2 && bits[k] != bits[k - 2];
    run = bits[k] ? run + 1 : 0;
    longest = std::max(longest, run);
  }
  const auto log_factorial = [](double n) { return std::lgamma(n + 1) / std::numbers::ln2; };
  const double ways = log_factorial(places - 1) - log_factorial(changes) - log_factorial(places - 1 - changes);
  return longest >= kSurelyPeriodic && places - ways - std::log2(places) >= kSurelyPeriodic;
}

std::optional<ChannelEstimate> with_shortest_exposure(ChannelEstimate channel, std::span<const std::uint8_t> bits) {
  const auto found = chip_period(bits);
  if (!found) return std::nullopt;
  ChipClock& clock = channel.clock;
  const auto period = static_cast<double>(found->size());
  const double mean = std::accumulate(found->begin(), found->end(), 0.0) / period;
  const double exposure = clock.exposure_rows / clock.rows_per_chip;
  double shortest = std::fmod(exposure, period);
  const double whole_periods = exposure - shortest;  // chips
  double constant = whole_periods * mean;
  if (found->size() == 2 && shortest > 1) {
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
