// First pass of source detection, near memory bandwidth: places where neighbouring columns have a common tone. Light
// modulates all columns alike, each in proportion to its brightness; texture does not.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

struct Suspect {
  Region box;
  double frequency;  // cycles per row, accurate to half a cycle in the window of detection
  double share;      // fraction of the variation in its best tile explained by the common tone
  double evidence;   // Σ −log(1 − share) over its tiles
};

// Tiles of 32 rows × 3 groups of columns of log(light + floor), at several scales: sums of 1, 2, 4, … rows and columns.
// In a tile, with each group's mean and slope removed, `share` is the energy of the best tone common to the groups over
// the total energy. For white noise P(share > s) = (1 − s)^((90 − 2)/2) at a given frequency. The threshold follows
// from `false_alarms`, the expected number per picture; it is at least 0.4, because of texture. Integer samples whose
// light swings by less than half a step are ignored. Tiles that touch and agree in frequency form one suspect. The
// strongest come first.
std::vector<Suspect> screen_sources(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                                    double false_alarms);

// Offset added to the light before the logarithm, DN: 1/64 of full light, which suppresses dark areas.
double logarithm_floor(const AnyFramesView& frames, const ToneCurve& curve);

}  // namespace ocisac
