// Detection of all modulated lights in a picture.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

struct DetectOptions {
  double false_alarms = 0.01;    // max expected number of false detections in a picture without a light; (0, 1]
  double min_cycles = 2.5;       // in a light's box; at least 2
  std::size_t max_sources = 64;  // number of lights returned per picture, the strongest
  std::optional<std::size_t> frame = {};  // the frame searched, the others are only compared; absent: all are searched
};

struct LightSource {
  std::size_t frame = 0;
  Region box;
  double probability = 0;                    // that it is a light
  double frequency = 0;                      // Hz, below half the row rate
  double frequency_std = 0;                  // Hz, standard error
  double gain = 0, gain_std = 0;             // as of tone_gain, with all light in the box attributed to the source
  double phase = 0;                          // rad, at the end of row 0's exposure, as of tone_gain
  double mean = 0;                           // light in the box, DN above dark
  double snr = 0;                            // power of the light's swing over that of the residual
  double amplitude = 0;                      // of the fundamental at its maximum, DN
  double share = 0;                          // periodic fraction of the swing common to the columns
  bool carries_data = false;                 // the swing is common to the columns but not periodic
  std::optional<std::size_t> reflection_of;  // index in the same list of a stronger light of equal frequency
  bool reflection_by_phase = false;          // phases were compared and agree; else frequency alone
  std::size_t merged = 0;                    // detections merged into this one
  bool joined = false;                       // some of them beside or above it: the box contains all
  Flags flags = 0;
};

// The lights of each frame, the most probable first. Of several frames, neighbours decide on a tone's probability as
// well: the phase of a light moves with the clock, that of a texture stays. Throws for options out of range and empty
// frames. A frame of fewer than 32 rows has none.
std::vector<LightSource> detect_sources(const AnyFramesView& frames, const Camera& camera,
                                        const DetectOptions& options = {});

// A tone or waveform that may be a light, with the terms of the model of its probability.
struct LightCandidate {
  Region box;
  double frequency;  // Hz
  double probability;
  double odds;  // by which those of the model are multiplied
  std::vector<double> terms;
};

// All tones of one frame that may be lights, or waveforms that may be data, of any probability: what the models of the
// probability are fitted to.
std::vector<LightCandidate> light_candidates(const AnyFramesView& frame, const Camera& camera, bool data);

// A light of an earlier frame.
struct ExpectedLight {
  Region box;        // expected position if it was detected in the last frame
  double frequency;  // Hz, below half the row rate
  Region region;     // search region
  bool seen;         // detected in the last frame, so that its box is known to a cycle or two
  bool data;         // contains other frequencies too
};

// Detects expected lights in one frame at about their frequencies: tones of the last frame in their boxes, all others
// in their regions. The result is as of detect_sources, but a light found in
// its box is never classified as a reflection. Throws as detect_sources, and for more than one frame, boxes and regions
// that are empty or not within the frame, and frequencies not between 0 and half the row rate.
std::vector<LightSource> follow_sources(const AnyFramesView& frame, const Camera& camera,
                                        std::span<const ExpectedLight> expected, const DetectOptions& options = {});

}  // namespace ocisac
