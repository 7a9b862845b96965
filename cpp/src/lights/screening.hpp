// First pass of source detection, near memory bandwidth: places where neighbouring columns have a common tone. Light
// modulates all columns alike, each in proportion to its brightness; texture does not.
#pragma once

#include <vector>

#include "lights/light_patch.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Part of a picture whose tiles have a common tone.
struct Suspect {
  Region box;
  double frequency;  // cycles per row of its best tile, accurate to half a cycle in that
  double share;      // of that tile: fraction of the variation explained by the common tone
  double evidence;   // Σ −log(1 − share) over its tiles
  Region best;       // box of that tile
};

// Tiles of 32 rows × 3 groups of columns of log(light + floor), at several scales: sums of 1, 2, 4, … rows and columns.
// In a tile, with each group's mean and slope removed, `share` is the energy of the best tone common to the groups over
// the total energy. For white noise P(share > s) = (1 − s)^((90 − 2)/2) at a given frequency. The threshold follows
// from `false_alarms`, the expected number per picture; it is at least 0.4, because of texture. Integer samples whose
// light swings by less than half a step are ignored. Tiles that touch and agree in frequency form one suspect. The
// strongest come first. `by_rows`: coarser scales are sums of rows alone, which resolve lamps narrower than a cycle.
std::vector<Suspect> screen_sources(const LitFrame& frame, const Region& region, double false_alarms,
                                    bool by_rows = false);

}  // namespace ocisac
