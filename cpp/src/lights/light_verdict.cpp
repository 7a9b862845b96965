#include "lights/light_verdict.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "lights/phase_odds.hpp"
#include "lights/screening.hpp"
#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

namespace {

constexpr double kMinRows = 24;                           // of a box
constexpr double kMinPeriodic = 0.4;                      // fraction of the swing common to the columns
constexpr double kClear = 0.83, kClearPeriodic = 0.9;     // of a lamp: a few cycles suffice
constexpr double kFalseAlarms = 0.02;                     // at which the odds required are given
constexpr double kToneOdds = 3, kDataOdds = 9;            // required at that rate; few photographs resemble data
constexpr double kEdgeEvidence = 0.5;                     // nats
constexpr double kDataTexture = 0.3;                      // relative to the bound for a tone
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

double with_odds(double probability, double factor) {
  return probability * factor / (probability * factor + 1 - probability);
}

// Probability of a light with `factor` times the odds. Some textures resemble a light as none did to which the
// probability of its looks was fitted: what speaks against a light speaks for them.
double with_odds_against(double probability, double factor) {
  const double texture = 1 / factor;
  return 1 / (1 + (1 - probability) / probability * texture + kUnseenTexture * std::max(texture - 1, 0.0));
}

// Probability required of a light, so that pictures without lights have `false_alarms` on average.
double probability_for(double odds, double false_alarms) { return with_odds(0.5, odds * kFalseAlarms / false_alarms); }

double log_of(std::size_t suspects) { return std::log(static_cast<double>(std::max<std::size_t>(suspects, 1))); }

// Max texture relative to the periodic swing; lines of text have more. The bound decreases for few columns, which may
// be similar by chance.
double max_texture(const RefinedLight& light) { return 0.8 * std::min(1.0, static_cast<double>(light.box.width) / 24); }

// Evidence required of data: on 400 pictures of overlapping boxes false detections fall as e^(−evidence/1.2), and the
// rate is a quarter of the requested one.
double data_evidence_for(std::size_t suspects, double false_alarms) {
  return log_of(suspects) - 1.2 * std::log(false_alarms) + 3;
}

bool is_measurable(const DataLight& data, const LightLimits& limits, double min_evidence) {
  const RefinedLight& light = data.light;
  return static_cast<double>(light.box.height) >= limits.rows &&
         0.5 * static_cast<double>(data.edges) >= limits.cycles && light.amplitude >= limits.amplitude &&
         kEdgeEvidence * static_cast<double>(data.edges) + data.clock >= min_evidence && light.snr >= 1 &&
         light.texture <= kDataTexture * max_texture(light);
}

// True for texture that varies periodically with the rows, unlike a picture under a light.
bool resembles_text(const RefinedLight& light) { return light.texture > 0.25 && light.uneven > 0.25; }

// −ln of the probability that texture looks as periodic; its variation in a box counts as one independent cell per
// cycle.
double evidence(const RefinedLight& light) {
  return std::log1p(light.snr) * static_cast<double>(light.box.height) * light.frequency;
}

// Evidence required of a suspect that is not clearly a lamp. On 600 pictures of overlapping boxes, the background with
// most chance alignments of edges, false detections fall as e^(−evidence/1.6). Below one in 50 pictures, where three
// bars can be even without noise, they fall as e^(−evidence/2.6).
double evidence_for(std::size_t suspects, double false_alarms) {
  return log_of(suspects) - 1.6 * std::log(false_alarms) - std::min(std::log(false_alarms / kFalseAlarms), 0.0) - 0.3;
}

// Expected number of other lights among those found: pictures that show some show more.
double expected_others(const Detection& one, std::span<const Detection> lights) {
  double sum = 0;
  for (const Detection& other : lights)
    if (!other.data && !are_doubles(one, other)) sum += other.alone;
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
double clock_odds(const Detection& one, const OtherLights& around) {
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
  for (const Detection& other : around.lights) add(other);
  for (const Detection& other : around.doubtful) add(other);
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

ToneFeatures features_of(const Detection& one, const OtherLights& around) {
  return features_of(one.light, around.suspects, expected_others(one, around.lights));
}

bool is_measurable(const RefinedLight& light, const LightLimits& limits) {
  const auto height = static_cast<double>(light.box.height);
  const double spread = (light.inside ? kLargestOwnSpread : kLargestSpread) * light.frequency;
  if (height < limits.rows || height * light.frequency < limits.cycles || light.amplitude < limits.amplitude ||
      !(light.frequency_std <= spread))
    return false;
  return light.inside ||
         (light.texture <= max_texture(light) && !resembles_text(light) && light.periodic >= kMinPeriodic);
}

std::optional<Detection> judged(const SearchedFrame& in, const RefinedLight& light, const OtherLights& around) {
  if (!is_measurable(light, in.limits)) return {};
  Detection one{.light = light, .box = light.box};
  const double row_time = in.camera.row_time;
  one.odds = tilt_odds(light) * pattern_odds(light) *
             phase_odds(in.frame, in.camera, light.box, light.frequency / row_time, light.frequency_std / row_time);
  return judged_again(one, around);
}

Detection judged_again(Detection one, const OtherLights& around) {
  const bool inside = one.light.inside;
  const ToneFeatures features = features_of(one, around);
  one.appearance = probability_of(features_of(one.light, around.suspects, 0), inside);
  const double odds = one.odds * clock_odds(one, around);
  one.alone = with_odds_against(one.appearance, odds);
  one.probability = with_odds_against(probability_of(features, inside), odds);
  one.reported = with_odds_against(corrected_probability_of(features, inside), odds);
  return one;
}

bool is_texture(const Detection& one) { return one.appearance >= kLooksLikeLight && one.odds < kTexture; }

bool is_convincing(const SearchedFrame& in, const Detection& one, std::size_t suspects) {
  const double least = probability_for(kToneOdds, in.options.false_alarms);
  const bool clear = one.probability >= std::max(kClear, least) && one.light.periodic >= kClearPeriodic;
  return clear || (one.probability >= least &&
                   evidence(one.light) + std::log(one.odds) >= evidence_for(suspects, in.options.false_alarms));
}

std::optional<Detection> judged(const SearchedFrame& in, const DataLight& data, std::size_t suspects,
                                const OtherLights& around) {
  if (!is_measurable(data, in.limits, data_evidence_for(suspects, in.options.false_alarms))) return {};
  Detection one{.light = data.light, .box = data.light.box, .data = true};
  one.odds = tilt_odds(data.light) * waveform_odds(in.frame, part_of(data.light)) * clock_odds(one, around);
  one.probability = one.reported = with_odds_against(probability_of(features_of(data, suspects)), one.odds);
  return one;
}

bool is_convincing(const SearchedFrame& in, const Detection& data) {
  return data.probability >= probability_for(kDataOdds, in.options.false_alarms);
}

LightCandidate candidate_of(const SearchedFrame& in, const Detection& one, std::span<const double> features,
                            bool inside) {
  return {.box = one.light.box,
          .frequency = one.light.frequency / in.camera.row_time,
          .probability = one.reported,
          .fitted = one.probability,
          .features = {features.begin(), features.end()},
          .inside = inside};
}

}  // namespace ocisac
