// Blind slicer: bits and levels of chips with a known clock and unknown levels. detect_chips() slices rows of known
// levels instead, with weights for which the error rate can be predicted.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/rows/chip_clock.hpp"

namespace ocisac {

// Means over the chips' middles, without the ramps at their ends. For an unknown exposure: the middle half.
std::vector<double> chip_values(std::span<const double> signal, const ChipGrid& grid,
                                std::optional<double> exposure_rows);

inline constexpr double kLongestSliced = 1.05;  // chips; in a longer exposure no chip shows its own level

struct SlicedChips {
  std::vector<std::uint8_t> bits;       // (chips) 1 = bright
  std::vector<double> dark;             // (chips) local level of dark chips
  std::vector<double> bright;           // (chips) local level of bright chips
  std::vector<double> relative_levels;  // (chips) −1 at the dark level, 1 at the bright level
};

// Threshold at the mean of the dark and bright levels, which adapt to gradient and amplitude along the frame; decisions
// and levels alternate until convergence. `guess`: initial bits, one per chip of the grid. Absent if the signal does
// not contain both kinds of chips.
std::optional<SlicedChips> slice(std::span<const double> signal, const ChipGrid& grid,
                                 std::optional<double> exposure_rows, std::span<const std::uint8_t> guess);

}  // namespace ocisac
