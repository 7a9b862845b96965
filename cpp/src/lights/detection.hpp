// Detections of one frame: whether each is a light, and how they belong together: doubles, parts of one light,
// reflections.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "lights/light_patch.hpp"
#include "lights/refinement.hpp"
#include "lights/screening.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/lights/detect_sources.hpp"

namespace ocisac {

// A tone or a waveform that may be a light.
struct Detection {
  RefinedLight light;      // the strongest part
  Region box;              // of all parts
  std::size_t merged = 0;  // detections in it beside the first
  bool joined = false;     // of parts beside or above each other
  bool data = false;       // frequencies differ, or no tone spans the parts
  bool expected = false;   // from the last frame
  std::optional<std::size_t> reflection_of = {};
  bool reflection_by_phase = false;
  double odds = 1;         // of a light, by which those of its looks are multiplied
  double noise = 0;        // expected number of its kind in a picture whose rows are white noise
  double appearance = 0;   // probability by the looks of this tone
  double probability = 0;  // with its odds, and with regard to other lights
};

// Detections of a frame so far. Chances of a texture are the suspects that no light explains, and the tones beside it.
struct Detections {
  std::size_t suspects = 1;               // that no light explains, in the last search
  std::vector<Detection> lights;          // convincing ones
  std::vector<Detection> doubtful;        // tones of the last search that are not
  std::vector<LightCandidate> waveforms;  // that may be data
};

// True if parts beside each other belong to one light: log light, minus its mean over two cycles of the slower one,
// correlates in the rows of both and in the columns between. False for parts farther apart than their width.
bool one_light_across(const LitFrame& frame, const Region& a, const Region& b, double frequency);

// Correlation of the swing of a light's rows in two frames: 1 for a texture, or light in step with the frames.
double likeness_of_frames(LitFrame frame, std::size_t other, const RefinedLight& light);

// Min share of the swing common to the columns that a tone or a square wave explains; data has less.
constexpr double kPeriodic = 0.7;

// True for a tone, or a square wave, by the periodic share of its swing.
bool is_tone(const Detection& one);

// True if the detection is certain to be no part of a light that sends data, whose chips alternate for fewer cycles.
bool is_settled(const Detection& one);

// Compares frequencies with a tolerance: texture under a faint reflection biases its frequency by more than the
// standard error.
bool same_frequency(const RefinedLight& weak, const RefinedLight& strong);

// Compares frequencies; that of a suspect is accurate to half a cycle of at least 2.5.
bool near_frequency(double suspected, double frequency);

bool covers(const Region& box, const Region& part);

// True if a suspect lies in a light's box, or at most a cycle away from it: it needs no refinement.
bool is_explained(const Suspect& suspect, const RefinedLight& light);

// True if a coarse suspect contains a light of its frequency.
bool contains(const Suspect& suspect, const RefinedLight& light);

// True if boxes share half of the smaller one at any frequency; lights known to be separate may cross.
bool are_doubles(const Detection& a, const Detection& b);
bool is_double_of_any(const Detection& one, const std::vector<Detection>& others);

// Merges double detections of a light into the stronger one. The strongest come first.
std::vector<Detection> without_doubles(std::vector<Detection> found);

// Joins the parts of a light that sends data, which is periodic in places; repeats with the joined parts.
std::vector<Detection> with_joined_parts(const LitFrame& frame, std::vector<Detection> found);

// Marks reflections among detections, the strongest first. A reflection has the light's phase at row 0; if the distance
// in rows is too large to extrapolate the phase, only frequencies are compared.
std::vector<Detection> with_reflections(std::vector<Detection> found);

// A frame in which lights are searched, among others that are compared with it, and what is required of its lights.
struct SearchedFrame {
  LitFrame frame;
  Camera camera;
  DetectOptions options;
};

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

// The most probable first, then the strongest.
std::vector<Detection> by_probability(const std::vector<Detection>& found);

}  // namespace ocisac
