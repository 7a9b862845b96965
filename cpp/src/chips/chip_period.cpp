#include "chips/chip_period.hpp"

#include <algorithm>

namespace ocisac {

namespace {

constexpr std::size_t kMaxPeriod = 4;

}

std::optional<std::size_t> chip_period(std::span<const std::uint8_t> bits, std::size_t min_bits) {
  if (bits.size() < min_bits) return std::nullopt;
  for (std::size_t period = 1; period <= kMaxPeriod; ++period)
    if (std::equal(bits.begin() + static_cast<std::ptrdiff_t>(period), bits.end(), bits.begin())) return period;
  return std::nullopt;
}

}  // namespace ocisac
