// Frames that show nothing, or nothing new.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace ocisac {

// White noise, or nothing, about a level that varies slowly along the rows.
bool is_noise(std::span<const double> signal);

// 1 for each frame whose rows show what those of the frame before it showed: they differ by noise, and by much less
// than from those of other frames, which have other chips. Steady light has none.
std::vector<std::uint8_t> repeated_frames(std::span<const std::span<const double>> frames);

// The rows of a frame are the means of those before and after it, which differ.
bool is_mean(std::span<const double> before, std::span<const double> frame, std::span<const double> after);

}  // namespace ocisac
