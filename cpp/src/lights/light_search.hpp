// Search for the lights of one frame.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "lights/detection.hpp"
#include "lights/light_verdict.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/lights/detect_sources.hpp"

namespace ocisac {

// Adds the light if it is confirmed in the box and no other detection is there; returns false if not.
bool add_expected(const SearchedFrame& in, const Region& box, double cycles_per_row, Detections& found);

// Adds the lights of a region: tones of `frequencies` in cycles per row. Without frequencies: any tone, and data where
// no tone explains a suspect.
Detections searched(const SearchedFrame& in, Detections found, const Region& region,
                    std::span<const double> frequencies = {});

// The lights as listed: sharpened, without doubles, with joined parts and reflections, the most probable first.
std::vector<Detection> listed_lights(const SearchedFrame& in, const Detections& found);

// All measurable tones of a frame, of any probability, with box and frequency of listed_lights().
std::vector<LightCandidate> tone_candidates(const SearchedFrame& in, const Detections& found);

}  // namespace ocisac
