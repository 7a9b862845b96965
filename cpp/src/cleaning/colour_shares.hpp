// Share of the light in every pixel of every colour: one for each pixel, or one for the whole picture.
#pragma once

#include <span>
#include <vector>

#include "ocisac/cleaning/light_share.hpp"

namespace ocisac {

// One colour of the frames of a scene, and its row light (frames × rows), mean 1.
struct BandedColour {
  BandedPicture picture;
  std::span<const double> row_light;
};

// Shares (rows × columns) of each colour; all are of one shape.
//
// A light that is the only one, or that lights all alike, has one share; shares by pixel then follow texture. They
// replace one share for each colour only where they increase the likelihood by more than they do under an even light.
std::vector<std::vector<double>> colour_shares(std::span<const BandedColour> colours);

}  // namespace ocisac
