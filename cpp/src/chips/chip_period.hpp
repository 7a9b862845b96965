// Periodic chips: they carry no data.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace ocisac {

// Smallest period in chips, up to 4, with which all bits repeat. Absent without one, and for fewer bits than
// `min_bits`: 24 random bits have a period by chance once in half a million.
std::optional<std::size_t> chip_period(std::span<const std::uint8_t> bits, std::size_t min_bits = 24);

}  // namespace ocisac
