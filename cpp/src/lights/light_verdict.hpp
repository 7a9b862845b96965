// Decides whether a tone or a waveform of a frame is a light: what is measurable, its probability, the one required.
#pragma once

#include <cstddef>
#include <optional>

#include "lights/data_light.hpp"
#include "lights/detection.hpp"
#include "lights/light_patch.hpp"
#include "lights/light_probability.hpp"
#include "lights/refinement.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/lights/detect_sources.hpp"

namespace ocisac {

// A frame in which lights are searched, among others that are compared with it, and what is required of its lights.
struct SearchedFrame {
  LitFrame frame;
  Camera camera;
  DetectOptions options;
  LightLimits limits;
};
SearchedFrame searched_frame(const AnyFramesView& frames, std::size_t index, const Camera& camera,
                             const DetectOptions& options);

ToneTerms terms_of(const Detection& one, const Detections& found);

// True for a tone of enough rows, cycles and amplitude whose frequency is known.
bool is_measurable(const RefinedLight& light, const LightLimits& limits);

// A measurable tone with its probability.
std::optional<Detection> judged(const SearchedFrame& in, const RefinedLight& light, const Detections& found);

// The tone with its probabilities among other suspects and lights.
Detection judged_again(Detection one, const Detections& found);

// True for a tone that looks like a light but behaves as a texture.
bool is_texture(const Detection& one);

// A waveform with its probability. `suspects`: those of the picture.
std::optional<Detection> judged(const SearchedFrame& in, const DataLight& data, std::size_t suspects,
                                const Detections& found);

bool is_convincing(const SearchedFrame& in, const Detection& one);

}  // namespace ocisac
