// Periodic chips: they carry no data, and do not determine their exposure.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

// Smallest period of P chips, with one rise and one fall or none, with which all n bits repeat, two periods or more:
// light of a dimmed lamp or of still bars. Data that repeat, such as a line-coded word, rise more than once in a
// period. The first and the last run count as many chips as the next one of their kind at most: a lamp that fades looks
// dark beyond. Absent where chance explains the period as well: n - P random bits equal those before them, with one of
// P periods, with a probability of P/2^(n - P), which may be 1/64 at most.
std::optional<std::span<const std::uint8_t>> chip_period(std::span<const std::uint8_t> bits);

// True for bits with a period, also where a lamp comes and goes along the rows: bright chips are every second one, in
// stretches, of six or more once. Of n such places, c changes from a dark place to a bright one or back have a
// probability of n·C(n − 1, c)/2^n at most in pulses with data, which may be 1/64 at most.
bool are_periodic(std::span<const std::uint8_t> bits);

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
