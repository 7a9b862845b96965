// Detector for exposures shorter than a chip: the middle of each chip against a threshold.
#pragma once

#include "ocisac/chips/detector.hpp"

namespace ocisac {

// Means over the chips' middles, without the ramps at their ends. For an unknown exposure: the middle half.
std::vector<double> chip_values(std::span<const double> signal, const ChipGrid& grid,
                                std::optional<double> exposure_rows);

// Level of the chips of one kind (`kind[chip] == bit`) along the frame: at each of them a line through its neighbours
// of that kind, without the chip itself; linear interpolation between them, constant beyond. Needs at least one chip of
// the kind.
std::vector<double> chip_level(std::span<const double> values, std::span<const std::uint8_t> kind, std::uint8_t bit);

// Threshold at the mean of the dark and bright levels, which adapt to gradient and amplitude along the frame; decisions
// and levels alternate until convergence.
class Slicer final : public Detector {
 public:
  [[nodiscard]] std::optional<Detection> detect(std::span<const double> signal, const ChipGrid& grid,
                                                std::optional<double> exposure_rows,
                                                std::span<const std::uint8_t> guess) const override;
};

}  // namespace ocisac
