// Decides whether a tone or a waveform of a frame is a light: what is measurable, its probability, the one required.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "lights/detection.hpp"
#include "lights/light_patch.hpp"
#include "lights/refinement.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/lights/detect_sources.hpp"

namespace ocisac {

// A frame in which lights are searched, among others that are compared with it, and what is required of its lights.
struct SearchedFrame {
  LitFrame frame;
  Camera camera;
  DetectOptions options;
};
SearchedFrame searched_frame(const AnyFramesView& frames, std::size_t index, const Camera& camera,
                             const DetectOptions& options);

// Terms of a logistic model of the probability that a tone or a waveform is a light, from its looks in one picture.
std::vector<double> terms_of(const Detection& one, const Detections& found);

// True for enough rows, cycles or edges, and amplitude, of a tone whose frequency is known, or data beside no texture.
bool is_measurable(const SearchedFrame& in, const Detection& one);

// A measurable tone or waveform with its probability.
std::optional<Detection> judged(const SearchedFrame& in, const RefinedLight& light, const Detections& found);

// The same with its probabilities among other suspects and lights.
Detection judged_again(Detection one, const Detections& found);

// True if photographs without lights have at most `false_alarms` such lights on average.
bool is_convincing(const SearchedFrame& in, const Detection& one);

}  // namespace ocisac
