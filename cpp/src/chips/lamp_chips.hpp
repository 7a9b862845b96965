// The chips of a frame in which the lamp stands, where other chips show only other light.
#pragma once

#include <cstddef>
#include <span>

#include "ocisac/chips/slicer.hpp"

namespace ocisac {

struct ChipRange {
  std::size_t begin = 0, end = 0;  // the first chip, and the one after the last

  [[nodiscard]] std::size_t size() const { return end - begin; }
};

// The chips [a, b) with the shortest description of all `values` (chip_values): within, the dark bits, given the
// lengths of runs, and the distances from their local levels; beyond, the distances from the prediction by the chips
// between it and the frame's end, of light on a straight line, or of light that varies like a tone of `slow` cycles per
// chip and the lamp's swing. A single distance costs at most as much as a chip of another light. Chips that are the
// lamp's with a probability below 0.95 are not counted. All chips where there are fewer than 24.
ChipRange lamp_chips(std::span<const double> values, const SlicedChips& seen, double slow);

}  // namespace ocisac
