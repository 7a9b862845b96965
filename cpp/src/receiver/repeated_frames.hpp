// Frames that were given twice.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace ocisac {

// 1 for each frame whose rows show what those of the frame before it showed: they differ by noise, and by much less
// than from those of other frames, which have other chips. Steady light has none.
std::vector<std::uint8_t> repeated_frames(std::span<const std::span<const double>> frames);

}  // namespace ocisac
