// What cleaning achieved, measured on the result, and whether the picture is better left alone.
#pragma once

#include <span>
#include <string>

#include "ocisac/cleaning/light_share.hpp"
#include "ocisac/cleaning/restore_picture.hpp"

namespace ocisac {

constexpr double kMinGain = 0.03;   // decrease of the misfit of rows; texture without a light gives less
constexpr double kMinLevel = 0.25;  // coherence of level bands; of a light on part of the picture 0.4 and more

// Measured on one colour of a frame, or the mean of its colours.
struct CleaningVerdict {
  double light_left = 0;      // swing of the row light in the columns after cleaning, over that before
  double texture_change = 0;  // energy of texture after cleaning over that before, dB
  double gain = 0;            // decrease of the misfit of rows a few apart (row_misfit)
  double level = 1;           // coherence of the bands over the columns, 1 for level bands, 0 for tilted ones
  double slow_bands =
      0;              // amplitude, relative to the light, of bands above 128 rows that are left; 0 if none are likely
  double energy = 0;  // of the row light's swing in the columns before cleaning
};

// Compares one colour of a frame (picture.frames is 1) before and after division by its row light, mean 1, with its
// shares; blocks are in columns of the picture. Some 64 evenly spaced columns count; slow_bands is not measured here.
CleaningVerdict judge_cleaning(const BandedPicture& picture, std::span<const double> row_light,
                               const BlockShares& shares);

// The mean of each number, weighted by the energy of the row light's swing: dark colours show noise. At least one.
CleaningVerdict mean_verdict(std::span<const CleaningVerdict> verdicts);

// Why the picture is better left alone; empty where it is not.
std::string objection_to(const CleaningVerdict& verdict);

}  // namespace ocisac
