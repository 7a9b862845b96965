// Every modulated light in a picture.
#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

struct DetectOptions {
  double false_alarms = 0.02;    // expected number in a picture without a light, at most; (0, 1]
  double min_cycles = 3;         // in a light's box; at least 2
  std::size_t max_sources = 64;  // lights in a picture, the strongest
};

struct LightSource {
  std::size_t frame = 0;
  std::size_t x = 0, y = 0, width = 0, height = 0;  // pixels; x: columns, y: rows in time order
  double frequency = 0;                             // Hz, below half the row rate
  double frequency_std = 0;                         // Hz, standard error
  double gain = 0, gain_std = 0;                    // as of tone_gain, all light in the box taken as the source's
  double phase = 0;                                 // rad, at the end of row 0's exposure, as of tone_gain
  double mean = 0;                                  // light in the box, DN above dark
  double snr = 0;                                   // power of the light's swing over that of what it does not explain
  double amplitude = 0;                             // of the fundamental where it is brightest, DN
  double share = 0;                                 // of the swing common to the columns that is periodic
  bool carries_data = false;                        // the swing is common to the columns but not periodic
  std::optional<std::size_t> reflection_of;         // index, in the same frame's list, of a stronger light like it
  bool reflection_by_phase = false;                 // its phase was told and agrees; else frequency alone
  std::size_t merged = 0;                           // findings of the same light that became one with it
  bool joined = false;                              // some of them beside or above it: the box holds all
  Flags flags = 0;
};

// The lights of each frame, the strongest first. Refused: options out of range, empty frames. A frame of fewer than 32
// rows has none.
std::vector<LightSource> detect_sources(const AnyFramesView& frames, const Camera& camera,
                                        const DetectOptions& options = {});

// A light of a frame before.
struct ExpectedLight {
  Region box;        // where it should be, if it was seen in the last frame
  double frequency;  // Hz, below half the row rate
  Region region;     // where it may be
  bool seen;         // in the last frame, so that its box is known to a cycle or two
  bool data;         // shows other frequencies too
};

// The lights that are expected in one frame: a tone that was just seen in its box, others, and those that are not in
// their boxes, in their regions, at about their frequencies. Regions that overlap are searched as one. As of
// detect_sources, but no light found in its box is taken for a reflection. Refused as there, and: more than one frame,
// boxes and regions that are empty or not within the frame, frequencies not between 0 and half the row rate.
std::vector<LightSource> follow_sources(const AnyFramesView& frame, const Camera& camera,
                                        std::span<const ExpectedLight> expected, const DetectOptions& options = {});

}  // namespace ocisac
