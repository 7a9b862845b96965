// Displacement of a picture between two frames, dense and below a pixel, and pictures moved with it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace ocisac {

// Logarithm of light, dense (rows × columns).
struct LogPicture {
  std::span<const double> values;
  std::size_t rows = 0, columns = 0;
};

// Way of each pixel since the frame before, pixels (rows × columns).
struct PictureMotion {
  std::vector<double> down, right;
};

// The mean displacement is the peak of the phase correlation; what remains is the least-squares solution of the
// gradients' equation in a window of 9 × 9 pixels about each (Lucas and Kanade 1981), held to 0 where there is no
// texture. Pictures of fewer than 4 rows or columns are taken to stand still.
PictureMotion picture_motion(const LogPicture& before, const LogPicture& after);

// Values at the place where each pixel was, interpolated; those of the border beyond it. values: (rows × columns).
std::vector<double> moved_picture(std::span<const double> values, std::size_t columns, const PictureMotion& motion);

struct PictureChange {
  PictureMotion motion;
  // (rows × columns), 1 where the moved picture differs by more than 10 % in a window, or comes from outside.
  std::vector<std::uint8_t> is_new;
};
PictureChange picture_change(const LogPicture& before, const LogPicture& after);

}  // namespace ocisac
