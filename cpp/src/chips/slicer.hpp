// The detector for exposures shorter than a chip: each chip's middle against a threshold.
#pragma once

#include "ocisac/chips/detector.hpp"

namespace ocisac {

// Means of the chips' middles, away from the ramps at their ends. Without a known exposure: the middle half.
std::vector<double> chip_values(std::span<const double> signal, const ChipGrid& grid,
                                std::optional<double> exposure_rows);

// Level of the chips of one kind (`kind[chip] == bit`) along the frame: a line through the neighbours of that kind,
// without the chip itself, read at each of them; straight between them, steady beyond. At least one chip is of the
// kind.
std::vector<double> chip_level(std::span<const double> values, std::span<const std::uint8_t> kind, std::uint8_t bit);

// Threshold half way between the levels of the dark and the bright chips, which follow gradient and amplitude along
// the frame; decisions and levels in turn until they agree.
class Slicer final : public Detector {
 public:
  [[nodiscard]] std::optional<Detection> detect(std::span<const double> signal, const ChipGrid& grid,
                                                std::optional<double> exposure_rows,
                                                std::span<const std::uint8_t> guess) const override;
};

}  // namespace ocisac
