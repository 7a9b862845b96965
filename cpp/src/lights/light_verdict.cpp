#include "lights/light_verdict.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "lights/light_model.hpp"
#include "lights/phase_odds.hpp"
#include "lights/screening.hpp"
#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

namespace {

constexpr double kMinRows = 24;                           // of a box
constexpr double kMostTexture = 0.24;                     // of data, relative to the common swing: text has more
constexpr double kUnseenTexture = 0.03;                   // probability of a texture that resembles a light
constexpr double kLevel = 0.003, kTilted = 0.02;          // rows per column: of a light's bars, of a texture's
constexpr double kTurnedRows = 0.1;                       // rad: tilt of few cycles
constexpr double kTurnedPictures = 0.001;                 // share of pictures whose rows are no rows
constexpr double kCloth = 1e-3, kKnownCloth = 0.1;        // prior times probability of a number of its clocks
constexpr double kBand = 0.2, kFrequencies = 4.5;         // of ln f: around a clock; of all lamps
constexpr double kTexture = 0.1;                          // odds
constexpr double kWholeRows = 3.0, kFaintPattern = 0.02;  // prior times density of depths, mean depth
constexpr double kUnevenPattern = 0.05;                   // cycles along the box
constexpr double kLargestSpread = 0.03, kLargestOwnSpread = 0.015;  // max relative standard error of a frequency

// Probability of a light with `factor` times the odds. Some textures resemble a light as none did to which the
// probability of its looks was fitted: what speaks against a light speaks for them.
double with_odds_against(double probability, double factor) {
  const double texture = 1 / factor;
  return 1 / (1 + (1 - probability) / probability * texture + kUnseenTexture * std::max(texture - 1, 0.0));
}

// Expected number of such tones in a picture whose rows are noise: boxes begin in any row and end in any of as many as
// it has, with half as many frequencies.
double expected_noise(const RefinedLight& light, std::size_t picture_rows) {
  const auto height = static_cast<double>(light.box.height);
  return 0.5 * height * height * static_cast<double>(picture_rows) * light.chance;
}

// Expected number of such waveforms, whose edges have a clock as well. As wide as the picture, they may be noise of
// whole rows of any spectrum: its depth and the clock speak against it.
double expected_noise(const DataLight& data, const Shape& picture) {
  const Region& box = data.light.box;
  const auto rows = static_cast<double>(picture.rows);
  const double coloured = 10 * box.width > 9 * picture.columns
                              ? rows / static_cast<double>(box.height) * std::exp(-data.light.depth / kFaintPattern)
                              : 0;
  return std::max(rows * data.light.chance, coloured) * std::exp(-data.clock);
}

// Probability of a light, required of which is probability_for(noise) if pictures of noise have so many of its kind.
double beside_noise(double probability, double noise) { return 1 / (1 / probability + noise / kRequiredOdds); }

// Expected number of other lights among those found: pictures that show some show more.
double expected_others(const Detection& one, std::span<const Detection> lights) {
  double sum = 0;
  for (const Detection& other : lights)
    if (!other.data && !are_doubles(one, other)) sum += with_odds_against(other.appearance, other.odds);
  return sum;
}

double normal(double x, double std) {
  return std::exp(-0.5 * x * x / (std * std)) / (std * std::sqrt(2 * std::numbers::pi));
}

// A light's bars run along the rows, over its whole width; those of a texture have a Cauchy distribution of tilts, and
// may run along the rows as well.
double tilt_odds(const RefinedLight& light) {
  if (!(light.tilt_std > 0)) return 1;
  const double turned = kTurnedRows / (2 * std::numbers::pi * light.frequency * static_cast<double>(light.box.width));
  const double level = normal(light.tilt, std::hypot(light.tilt_std, kLevel, turned));
  const double tilted = kTilted / (std::numbers::pi * (light.tilt * light.tilt + kTilted * kTilted));
  return std::min(((1 - kTurnedPictures) * level + kTurnedPictures * tilted) / (0.5 * level + 0.5 * tilted), 1.0);
}

// A faint pattern of whole rows is the camera's, that of its colour filter, of a picture at another size, or of the
// blocks of its compression, whose errors differ from place to place.
double pattern_odds(const RefinedLight& light) {
  const double spread =
      std::hypot(light.frequency_std, kUnevenPattern / static_cast<double>(light.box.height)) / light.frequency;
  double pattern = 0;
  for (const int rows : {2, 3, 4, 8, 16}) pattern += normal(std::log(light.frequency * rows), spread);
  return 1 / (1 + kWholeRows * std::exp(-light.depth / kFaintPattern) * pattern);
}

// Cloth and moiré have many tones in a narrow band, each a little different; the lamps of a scene send on few clocks,
// anywhere. Odds from the number of other clocks that are near, which is Poisson's for lamps.
double clock_odds(const Detection& one, const Detections& found) {
  std::vector<const RefinedLight*> clocks{&one.light};
  std::size_t near = 0;
  double cloth = kCloth;
  const auto add = [&](const Detection& other) {
    // A light that sends data shows tones of its own.
    if (other.data || other.appearance < kLooksLikeLight || (one.data && !is_texture(other))) return;
    const bool beside = std::abs(std::log(other.light.frequency / one.light.frequency)) < kBand;
    if (beside && is_texture(other)) cloth = kKnownCloth;
    if (std::ranges::any_of(clocks, [&](const auto* clock) { return same_frequency(other.light, *clock); })) return;
    clocks.push_back(&other.light);
    near += beside ? 1 : 0;
  };
  for (const Detection& other : found.lights) add(other);
  for (const Detection& other : found.doubtful) add(other);
  const double expected = 2 * kBand / kFrequencies * static_cast<double>(clocks.size() - 1);
  double lamps = std::exp(-expected);
  for (std::size_t k = 1; k <= near; ++k) lamps *= expected / static_cast<double>(k);
  return std::min(lamps / cloth, 1.0);
}

}  // namespace

SearchedFrame searched_frame(const AnyFramesView& frames, std::size_t index, const Camera& camera,
                             const DetectOptions& options) {
  // One stored step: smaller swings are often compression artefacts.
  const double min_amplitude = holds_integers(frames) ? 1 : 0;
  return {lit_frame(frames, index, camera.tone_curve), camera, options, {kMinRows, options.min_cycles, min_amplitude}};
}

ToneTerms terms_of(const Detection& one, const Detections& found) {
  return terms_of(one.light, found.suspects, expected_others(one, found.lights));
}

bool is_measurable(const RefinedLight& light, const LightLimits& limits) {
  const auto height = static_cast<double>(light.box.height);
  const double spread = (light.inside ? kLargestOwnSpread : kLargestSpread) * light.frequency;
  return height >= limits.rows && height * light.frequency >= limits.cycles && light.amplitude >= limits.amplitude &&
         light.frequency_std <= spread;
}

std::optional<Detection> judged(const SearchedFrame& in, const RefinedLight& light, const Detections& found) {
  if (!is_measurable(light, in.limits)) return {};
  Detection one{.light = light, .box = light.box};
  const double row_time = in.camera.row_time;
  one.noise = expected_noise(light, shape_of(in.frame.frames).rows);
  one.odds = tilt_odds(light) * pattern_odds(light) *
             phase_odds(in.frame, in.camera, light.box, light.frequency / row_time, light.frequency_std / row_time);
  return judged_again(one, found);
}

Detection judged_again(Detection one, const Detections& found) {
  one.appearance = probability_of(terms_of(one.light, found.suspects, 0));
  const double looks = with_odds_against(probability_of(terms_of(one, found)), one.odds * clock_odds(one, found));
  one.probability = beside_noise(looks, one.noise);
  return one;
}

bool is_texture(const Detection& one) { return one.appearance >= kLooksLikeLight && one.odds < kTexture; }

std::optional<Detection> judged(const SearchedFrame& in, const DataLight& data, std::size_t suspects,
                                const Detections& found) {
  const RefinedLight& light = data.light;
  if (static_cast<double>(light.box.height) < in.limits.rows ||
      0.5 * static_cast<double>(data.edges) < in.limits.cycles || light.amplitude < in.limits.amplitude ||
      light.texture > kMostTexture)
    return {};
  Detection one{.light = light, .box = light.box, .data = true};
  one.odds = tilt_odds(light) * waveform_odds(in.frame, part_of(light)) * clock_odds(one, found);
  one.noise = expected_noise(data, shape_of(in.frame.frames));
  one.probability = beside_noise(with_odds_against(probability_of(terms_of(data, suspects)), one.odds), one.noise);
  return one;
}

bool is_convincing(const SearchedFrame& in, const Detection& one) {
  return one.probability >= probability_for(in.options.false_alarms);
}

}  // namespace ocisac
