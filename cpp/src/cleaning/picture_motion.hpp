// Displacement of a picture between two frames, below a pixel, and pictures moved with it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "ocisac/cleaning/light_share.hpp"

namespace ocisac {

// Values where each was before the picture moved by `down` and `right` pixels, interpolated; those of the border beyond
// it. values: (rows × columns).
std::vector<double> moved_picture(std::span<const double> values, std::size_t columns, double down, double right);

struct PictureChange {
  double down = 0, right = 0;  // displacement since the frame before, pixels
  // (rows × columns), 1 where windows of the moved picture differ by more than 10 %, or come from outside.
  std::vector<std::uint8_t> is_new;
};

// Compares two pictures of logarithms of light, whose variances do not matter. The displacement is the peak of the
// phase correlation, refined by least squares (Lucas and Kanade 1981). Pictures of fewer than 4 rows or columns are
// taken to stand still.
PictureChange picture_change(const Blocks& before, const Blocks& after);

}  // namespace ocisac
