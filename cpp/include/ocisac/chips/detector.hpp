// Interface of the blind detectors: from a combined column and its chip grid to decisions and levels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/chip_timing.hpp"

namespace ocisac {

// The chips of a lattice that lie whole in a frame: first, first + 1, … first + count − 1.
struct ChipGrid {
  ChipLattice lattice;
  std::ptrdiff_t first = 0;
  std::size_t count = 0;

  [[nodiscard]] double start(std::size_t chip) const {
    return lattice.phase + static_cast<double>(first + static_cast<std::ptrdiff_t>(chip)) * lattice.rows_per_chip;
  }
  [[nodiscard]] double centre(std::size_t chip) const { return start(chip) + 0.5 * lattice.rows_per_chip; }
};

ChipGrid whole_chips(const ChipLattice& lattice, std::size_t rows);

struct Detection {
  std::vector<std::uint8_t> bits;  // (chips) 1 = bright
  std::vector<double> dark;        // (chips) local level of dark chips
  std::vector<double> bright;      // (chips) local level of bright chips
  std::vector<double> soft;        // (chips) −1 at the dark level, 1 at the bright level
};

class Detector {
 public:
  virtual ~Detector() = default;

  // `exposure_rows`: rows, absent if unknown. `guess`: initial bits, one per chip of the grid. Absent if the signal
  // does not contain both kinds of chips.
  [[nodiscard]] virtual std::optional<Detection> detect(std::span<const double> signal, const ChipGrid& grid,
                                                        std::optional<double> exposure_rows,
                                                        std::span<const std::uint8_t> guess) const = 0;
};

}  // namespace ocisac
