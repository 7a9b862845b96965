#include "tones/rounding.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <vector>

#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

// Rows that see levels of one code.
struct Code {
  std::complex<double> weights;
  double square = 0;  // of its step, in light
  double noise = 0;   // variance
};

// Mean square of rounding errors of a step that noise leaves. Rounding itself is in the noise's variance, of few levels
// with two standard deviations above 1/12. `square`: of the step; `size`: of the sum of the levels' weights.
double mean_square(double noise_variance, double square, double size) {
  const double noise = std::max(noise_variance / square - (1 + 1.8 * size) / 12, 0.0);
  return square * std::exp(-2 * kTwoPi * std::numbers::pi * noise) / (std::numbers::pi * std::numbers::pi);
}

// Mean of the lower half of squared normal variates, over that of all.
constexpr double kLowerSquares = 0.1428;

}  // namespace

StoredSteps::StoredSteps(const ToneCurve& tone_curve, double maximum, double between)
    : curve(&tone_curve),
      type_maximum(maximum),
      step(between),
      largest(step * std::max(light_per_step(*curve, curve->dark_level, maximum),
                              light_per_step(*curve, white_level(*curve, maximum), maximum))) {}

double StoredSteps::at(double light) const {
  return step * light_per_step(*curve, stored_value(*curve, light, type_maximum), type_maximum);
}

NoiseOfLight noise_of_samples(const Eigen::MatrixXd& samples, double variance, double share) {
  const auto columns = static_cast<double>(samples.rows()), rows = static_cast<double>(samples.cols());
  const Eigen::VectorXd light = samples.transpose() * Eigen::VectorXd::Constant(samples.rows(), 1 / columns),
                        about = light.array() - light.mean(),
                        means = samples * Eigen::VectorXd::Constant(samples.cols(), 1 / rows),
                        shares = samples * about / std::max(about.squaredNorm(), std::numeric_limits<double>::min());
  Eigen::VectorXd squares(samples.cols());
  for (Eigen::Index n = 0; n < samples.cols(); ++n)
    squares(n) = (samples.col(n) - means - shares * about(n)).squaredNorm();
  squares *= rows / ((columns - 1) * (rows - 2));
  // Mean light and noise of the darker and the lighter pairs.
  std::array<double, 2> at{}, noise{};
  for (const std::size_t side : {0U, 1U}) {
    std::vector<double> changes;
    double own_noise = 0;
    for (Eigen::Index n = 0; n + 1 < samples.cols(); n += 2) {
      if ((about(n) + about(n + 1) > 0) != (side == 1)) continue;
      changes.push_back(std::pow(about(n + 1) - about(n), 2) / 2);
      own_noise += (squares(n) + squares(n + 1)) / 2;
      at[side] += (light(n) + light(n + 1)) / 2;
    }
    if (changes.empty()) return {variance / share};
    const auto count = static_cast<double>(changes.size());
    std::ranges::sort(changes);
    changes.resize((changes.size() + 1) / 2);
    const double own = own_noise / count, common = mean_of(changes) / kLowerSquares - own / columns;
    noise[side] = own + std::clamp(common, 0.0, std::max(variance - share * squares.mean(), 0.0));
    at[side] /= count;
  }
  const double per_light = std::max((noise[1] - noise[0]) / (at[1] - at[0]), 0.0),
               at_black = noise[0] - per_light * at[0];
  if (at_black > 0) return {kInfinity, at_black, per_light, light.minCoeff()};
  return {kInfinity, 0, noise[1] / at[1], light.minCoeff()};
}

double most_rounding_error(const StoredSteps& steps, double noise_variance) {
  const double weight = 4 / std::numbers::pi;  // of amplitude and mean in rows of one level
  return weight * std::sqrt(mean_square(noise_variance, steps.largest * steps.largest, weight));
}

// Rounding errs by −1/π·exp(−2π²σ²)·sin(2πx) for light of x steps, alike in rows that see one level, and amplitude and
// mean by Σ w·error with their weights w, summed by codes: the place of each between two codes is not known, but for
// rows that see no lamp. Nor is the swing to half a step.
double rounding_error(const StoredSteps& steps, const RoundedTone& tone, std::span<const RoundedColumn> columns,
                      const NoiseOfLight& noise) {
  constexpr std::size_t kCodes = 1024;  // of which rows of more come again
  const bool is_square = tone.duty > 0;
  const double known = tone.exposure_cycles.value_or(0.0),
               exposure = tone.exposure_cycles ? known : exposure_cycles_of_gain(tone.gain),
               box = std::max(exposure, kNextToNone), response = sinc(exposure), duty = is_square ? tone.duty : 0.5,
               least = std::max(std::abs(response), kNearNull), unlit = 1 - tone.gain / least;  // of the mean
  const auto light_until = [duty](double cycles) {
    return std::floor(cycles) * duty + std::min(cycles - std::floor(cycles), duty);
  };
  std::vector<Code> codes(kCodes);
  for (std::size_t n = 0; n < tone.rows; ++n) {
    const double cycles = tone.cycles_per_row * static_cast<double>(n) + tone.phase / kTwoPi - known / 2,
                 wave = std::cos(kTwoPi * cycles), begin = cycles + (duty - box) / 2,
                 weight = (wave - tone.gain * tone.ratio / 2) / static_cast<double>(tone.rows),
                 lit = is_square ? (light_until(begin + box) - light_until(begin)) / box : duty + response * wave / 2;
    for (const auto& [share, mean, background] : columns) {
      const bool sees_no_lamp = is_square && lit < kNextToNone && std::abs(unlit * mean) < steps.at(background);
      const double light = background + (sees_no_lamp ? 0 : mean * (unlit + (1 - unlit) * lit / duty)),
                   stored = stored_value(*steps.curve, light, steps.type_maximum) / steps.step, step = steps.at(light);
      for (const double more : {0.0, 0.5}) {
        const double level = sees_no_lamp ? stored : stored + more * (lit - duty) / least, code = std::nearbyint(level),
                     place = kTwoPi * (level - code);
        Code& own = codes[static_cast<std::size_t>(std::abs(code) + more * kCodes) % kCodes];
        own.weights += share * weight *
                       (sees_no_lamp ? std::complex(std::numbers::sqrt2 * std::sin(place)) : std::polar(1.0, place));
        own.square = step * step;
        own.noise = noise.at(light);
      }
    }
  }
  double size = 0, error = 0;
  for (const Code& code : codes) size += std::norm(code.weights);
  for (const Code& code : codes)
    if (code.square > 0) error += std::norm(code.weights) * mean_square(code.noise, code.square, std::sqrt(size));
  return std::sqrt(error);
}

}  // namespace ocisac
