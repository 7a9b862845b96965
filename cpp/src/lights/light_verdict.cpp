#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <span>

#include "columns/contrast_slope.hpp"
#include "core/levels.hpp"
#include "lights/detection.hpp"
#include "lights/light_model.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/lights/known_light.hpp"

namespace ocisac {

namespace {

constexpr double kMostTexture = 0.24;             // of data, relative to the common swing: text has more
constexpr double kUnseenTexture = 0.03;           // probability of a texture that resembles a light
constexpr double kLevel = 0.003, kTilted = 0.02;  // rows per column: of a light's bars, of a texture's
// Odds of a light that has the contrast of a texture; prior times probability of the clocks of a cloth.
constexpr double kUnlikely = 1e-3;
constexpr double kBand = 0.2, kFrequencies = 4.5;                   // of ln f: around a clock; of all lamps
constexpr double kWholeRows = 3.0, kFaintPattern = 0.02;            // prior times density of depths, mean depth
constexpr double kLargestSpread = 0.03, kLargestOwnSpread = 0.015;  // max relative standard error of a frequency

constexpr double kWide = 3;  // ln of cycles: few of the fitted lights are wider

double log_share(double share) { return std::log(std::max(share, 0.0) + kNextToNone); }

double log_of(std::size_t count) { return std::log(static_cast<double>(std::max<std::size_t>(count, 1))); }

double squared(double x) { return x * x; }

template <std::size_t Count>
double logistic(double intercept, const std::array<double, Count>& weights, std::span<const double> terms) {
  return 1 / (1 + std::exp(-std::inner_product(weights.begin(), weights.end(), terms.begin(), intercept)));
}

// Terms of the models; `suspects`: number of suspects in the picture that no light explains; `others`: expected number
// of other lights among those found.
std::vector<double> terms_of_tone(const RefinedLight& light, std::size_t suspects, double others) {
  const double height = std::log(light.frequency * static_cast<double>(light.box.height));  // in cycles
  const double width = std::log(light.frequency * static_cast<double>(light.box.width));
  const double aperiodic = log_share(1 - light.periodic);
  return {height,
          squared(std::min(width, kWide)),
          std::abs(height - width),
          aperiodic,
          squared(aperiodic),
          squared(log_share(1 - light.common)),
          log_share(std::min(light.depth, 1.0)),
          light.contour,
          std::log1p(others),
          squared(log_of(suspects)),
          squared(log_share(light.across)),
          squared(light.uneven * std::min(light.texture, 1.0))};
}

std::vector<double> terms_of_data(const RefinedLight& light, std::size_t suspects) {
  return {log_of(suspects),
          std::log(static_cast<double>(light.edges)),
          squared(std::log1p(light.clock)),
          std::log(light.frequency * static_cast<double>(light.box.width)),
          squared(log_share(1 - light.periodic)),
          log_share(light.texture)};
}

constexpr double kInStep = 0.003, kTextureMoves = 0.2;  // probabilities
constexpr double kClockError = 1e-3;                    // of a frame time as stated, relative
constexpr double kLeastStd = 0.1;                       // rad: noise that texture hides, a pixel of movement
constexpr double kLargestStd = 1;                       // rad, of a usable phase
constexpr std::size_t kCompared = 3;                    // frames

// Up to kCompared other frames, the nearest.
std::vector<std::size_t> other_frames(std::size_t frame, std::size_t count) {
  const std::size_t first = std::min(frame - std::min<std::size_t>(frame, 1), count - std::min(count, kCompared + 1));
  std::vector<std::size_t> others;
  for (std::size_t other = first; other < std::min(first + kCompared + 1, count); ++other)
    if (other != frame) others.push_back(other);
  return others;
}

// Normal density of an angle relative to 1/2π.
double over_uniform(double angle, double std) {
  const double away = std::remainder(angle, kTwoPi) / std;
  return std::max(std::sqrt(kTwoPi) / std * std::exp(-0.5 * away * away), 1e-30);
}

// Odds of a light over a texture, by which prior odds are multiplied, for the tone of a box (Hz and its standard
// error), from its changes of phase d to up to three other frames, the nearest:
//   light:   p·A + (1 − p)·U,   A = Π normal(d; advance, std)   p: that light and frames keep the clocks stated
//   texture: 0.8·S + 0.2·U,     S = Π normal(d; 0, std),  U = (1/2π)^K   one texture in five moves with the camera
// The advance is frequency × frame time. Where that is whole within its error, half of the lights are in step: (A +
// S)/2. Where it is unknown a light has any phase; one in 300 is in step. 1 without other frames, or if the tone is
// gone from one.
double phase_odds(const SearchedFrame& in, const RefinedLight& light) {
  const LitFrame& frame = in.frame;
  const Camera& camera = in.camera;
  const double frequency = light.frequency / camera.row_time;
  const double frequency_std = light.frequency_std / camera.row_time;
  const auto others = other_frames(frame.index, shape_of(frame.frames).frames);
  if (others.empty()) return 1;
  const auto gain_in = [&](std::size_t index) {
    return box_gain(frame_of(frame.frames, index), camera, light.box, frequency);
  };
  const MeasuredLight own = gain_in(frame.index);
  double still = 1, advanced = 1;
  bool stated = false, whole = true;  // frequency × frame time: known to a sixth of a cycle; whole within its error
  for (const std::size_t other : others) {
    const MeasuredLight there = gain_in(other);
    const double std = std::hypot(own.gain_std / own.gain, there.gain_std / there.gain);
    if ((there.gain + 2 * there.gain_std) * there.mean < 0.5 * own.gain * own.mean) return 1;
    if (!(std < kLargestStd)) continue;
    const double change = there.phase - own.phase, noise = std::max(std, kLeastStd);
    still *= over_uniform(change, noise);
    if (!camera.frame_time) continue;
    const double time = *camera.frame_time * (static_cast<double>(other) - static_cast<double>(frame.index));
    const double unknown = kTwoPi * std::abs(time) * std::hypot(frequency_std, kClockError * frequency);
    const double error = std::hypot(noise, unknown);
    if (!(error < kLargestStd)) continue;
    const double advance = kTwoPi * std::remainder(frequency * time, 1.0);
    advanced *= over_uniform(change - advance, error);
    stated = true, whole = whole && std::abs(advance) < 2 * error;
  }
  const double of_light = !stated
                              ? kInStep * still + 1 - kInStep
                              : (1 - kSmallShare) * (whole ? std::midpoint(advanced, still) : advanced) + kSmallShare;
  return of_light / ((1 - kTextureMoves) * still + kTextureMoves);
}

// The same for a waveform, by its least correlation with those of the other frames.
double waveform_odds(const LitFrame& frame, const RefinedLight& light) {
  double least = 1;
  const auto others = other_frames(frame.index, shape_of(frame.frames).frames);
  for (const std::size_t other : others) least = std::min(least, likeness_of_frames(frame, other, light));
  if (others.empty() || (least >= kTogether && least <= 1 - kSmallShare)) return 1;
  return least > 1 - kSmallShare ? kInStep / (1 - kTextureMoves) : (1 - kInStep) / kTextureMoves;
}

// Probability of a light with `factor` times the odds. Some textures resemble a light as none did to which the
// probability of its looks was fitted: what speaks against a light speaks for them.
double with_odds_against(double probability, double factor) {
  const double texture = 1 / factor;
  return 1 / (1 + (1 - probability) / probability * texture + kUnseenTexture * std::max(texture - 1, 0.0));
}

// Expected number of its kind in a picture whose rows are noise. Boxes of tones begin in any row and end in any of as
// many as they have, with half as many frequencies; edges of a waveform have a clock as well. As wide as the picture,
// it may be noise of whole rows of any spectrum: its depth and the clock speak against it.
double expected_noise(const Detection& one, const Shape& picture) {
  const RefinedLight& light = one.light;
  const auto rows = static_cast<double>(picture.rows), height = static_cast<double>(light.box.height);
  if (!one.data) return 0.5 * height * height * rows * light.chance;
  const bool wide = 10 * light.box.width > 9 * picture.columns;
  const double coloured = wide ? rows / height * std::exp(-light.depth / kFaintPattern) : 0;
  return std::max(rows * light.chance, coloured) * std::exp(-light.clock);
}

// Probability of a light that is at most the required one where `noise`, the number of its kind in a picture of noise,
// reaches the false alarms allowed.
double beside_noise(double probability, double noise) { return 1 / (1 / probability + noise / kRequiredOdds); }

// Expected number of other lights among those found: pictures that show some show more.
double expected_others(const Detection& one, std::span<const Detection> lights) {
  double sum = 0;
  for (const Detection& other : lights)
    if (!other.data && !are_doubles(one, other)) sum += with_odds_against(other.appearance, other.odds);
  return sum;
}

double normal(double x, double std) { return std::exp(-0.5 * x * x / (std * std)) / (std * std::sqrt(kTwoPi)); }

// A light's bars run along the rows, over its whole width; those of a texture have a Cauchy distribution of tilts, and
// may run along the rows as well.
double tilt_odds(const RefinedLight& light) {
  if (!(light.tilt_std > 0)) return 1;
  const double level = normal(light.tilt, std::hypot(light.tilt_std, kLevel));
  const double tilted = kTilted / (std::numbers::pi * (light.tilt * light.tilt + kTilted * kTilted));
  return std::min(level / (0.5 * level + 0.5 * tilted), 1.0);
}

// Lines of text or bricks differ from light by where they have contrast.
double contrast_odds(const SearchedFrame& in, const RefinedLight& light) {
  return contrast_slope(in.frame.frames, in.frame.index, light.box, in.camera.tone_curve).is_of_texture() ? kUnlikely
                                                                                                          : 1;
}

// A faint pattern of whole rows is the camera's, that of its colour filter, of a picture at another size, or of the
// blocks of its compression, whose errors differ from place to place. Rows of two exposures, by pairs, are bright and
// dark.
double pattern_odds(const RefinedLight& light) {
  const double spread =
      std::hypot(light.frequency_std, kNextToNone / static_cast<double>(light.box.height)) / light.frequency;
  const double faint = std::exp(-light.depth / kFaintPattern);
  double pattern = 0;
  for (const int rows : {2, 3, 4, 8, 16})
    pattern += (rows == 4 ? 1 : faint) * normal(std::log(light.frequency * rows), spread);
  return 1 / (1 + kWholeRows * pattern);
}

// Cloth and moiré have many tones in a narrow band, each a little different; the lamps of a scene send on few clocks,
// anywhere. Odds from the number of other clocks that are near, which is Poisson's for lamps.
double clock_odds(const Detection& one, const Detections& found) {
  std::vector<const RefinedLight*> clocks{&one.light};
  std::size_t near = 0;
  double cloth = kUnlikely;
  const auto add = [&](const Detection& other) {
    // A light that sends data shows tones of its own.
    if (other.data || other.appearance < kMostly || (one.data && other.odds >= kSmallShare)) return;
    const bool beside = std::abs(std::log(other.light.frequency / one.light.frequency)) < kBand;
    if (beside && other.odds < kSmallShare) cloth = kSmallShare;
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

std::vector<double> terms_of(const Detection& one, const Detections& found) {
  return one.data ? terms_of_data(one.light, found.suspects)
                  : terms_of_tone(one.light, found.suspects, expected_others(one, found.lights));
}

bool is_measurable(const SearchedFrame& in, const Detection& one) {
  const RefinedLight& light = one.light;
  const auto height = static_cast<double>(light.box.height);
  const double cycles = one.data ? 0.5 * static_cast<double>(light.edges) : height * light.frequency;
  const double spread = light.inside ? kLargestOwnSpread : kLargestSpread;
  const bool is_clear = one.data ? light.texture <= kMostTexture : light.frequency_std <= spread * light.frequency;
  return is_clear && height >= kMinRows && cycles >= in.options.min_cycles && light.amplitude >= in.frame.min_amplitude;
}

std::optional<Detection> judged(const SearchedFrame& in, const RefinedLight& light, const Detections& found) {
  Detection one{.light = light, .box = light.box, .data = light.edges > 0};
  if (!is_measurable(in, one)) return {};
  one.noise = expected_noise(one, shape_of(in.frame.frames));
  one.odds = tilt_odds(light) * contrast_odds(in, light) *
             (one.data ? waveform_odds(in.frame, light) : pattern_odds(light) * phase_odds(in, light));
  return judged_again(one, found);
}

Detection judged_again(Detection one, const Detections& found) {
  const auto terms = terms_of(one, found);
  if (!one.data) one.appearance = logistic(kToneIntercept, kToneWeights, terms_of_tone(one.light, found.suspects, 0));
  const double looks =
      one.data ? logistic(kDataIntercept, kDataWeights, terms) : logistic(kToneIntercept, kToneWeights, terms);
  one.probability = beside_noise(with_odds_against(looks, one.odds * clock_odds(one, found)), one.noise);
  return one;
}

bool is_convincing(const SearchedFrame& in, const Detection& one) {
  return one.probability >= kRequiredOdds / (kRequiredOdds + in.options.false_alarms);
}

}  // namespace ocisac
