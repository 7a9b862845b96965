// First pass of source detection, at about the speed of memory: places where neighbouring columns swing together at one
// frequency. Light modulates all columns alike, each with its own brightness; texture does not.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

struct Suspect {
  std::size_t column, row, width, height;  // pixels
  double frequency;                        // cycles per row, to within half a cycle in the window that showed it
  double share;                            // of the variation in its best tile that is the common tone
  double evidence;                         // Σ −log(1 − share) over its tiles
};

// Tiles of 32 rows × 3 groups of columns of log(light + floor), at several scales: rows added by 1, 2, 4, …, columns
// likewise. In a tile, less each group's mean and slope, `share` is the energy of the best tone common to the groups
// over all energy. Under white noise P(share > s) = (1 − s)^((90 − 2)/2) for a given frequency, so the threshold
// follows from `false_alarms`, the expected number in a picture; it is never below 0.4, for the sake of texture.
// Integer samples whose light swings by less than half a step are passed over.
// Tiles that touch and agree in frequency are one suspect. The strongest come first.
std::vector<Suspect> screen_sources(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                                    double false_alarms);

// What is added to the light before the logarithm, DN: 1/64 of full light, so that darkness does not count.
double logarithm_floor(const AnyFramesView& frames, const ToneCurve& curve);

}  // namespace ocisac
