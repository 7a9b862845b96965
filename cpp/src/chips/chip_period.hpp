// Periodic chips: they carry no data, and do not determine their exposure.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

// Smallest period in chips, up to 4, with which all bits repeat. Absent without one, and for fewer bits than
// `min_bits`: 24 random bits have a period by chance once in half a million.
std::optional<std::size_t> chip_period(std::span<const std::uint8_t> bits, std::size_t min_bits = 24);

// Channel of the shortest exposure that shows chips of the given bits in the same rows. With s_E the mean of chips of
// period P (chips) and mean m over an exposure of E chips, and k whole periods in it:
//
//   E·s_E = (E − kP)·s_(E−kP) + kP·m          and for alternating chips (P = 2) of E from 1 to 2:
//   E·s_E = (2 − E)·s_(2−E) + E − 1
//
// so that a longer exposure differs in dark and swing, and by kP/2 chips in the middle of its exposure. Absent if the
// exposure is the shortest already.
std::optional<ChannelEstimate> with_shortest_exposure(ChannelEstimate channel, std::span<const std::uint8_t> bits);

}  // namespace ocisac
