#include "columns/light_and_noise.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "ocisac/core/constants.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "ocisac/rows/tone_search.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using std::numbers::pi;

constexpr int kCorners = 10;  // of the light's spectrum, from half a cycle a row down by octaves
constexpr std::size_t kShapes = 1 + 3 * kCorners;
constexpr int kMinRatio = -12, kRatios = 21;  // noise over light: 4^-12 to 4^8
constexpr int kAliases = 4;                   // on either side
constexpr std::size_t kMaxGroups = 512;       // of bins that the fit sees
constexpr double kEvidence = 6;               // log likelihood that light and its shape must gain over noise alone
constexpr int kFitSteps = 20;
constexpr double kSmoothNoise = 1.3;  // power left by smooth light over that of the noise, at most
constexpr std::size_t kMaxTones = 12;
constexpr int kRounds = 5;               // of the search for tones
constexpr double kMinResponse = 0.1;     // of the exposure to a tone: no light is amplified more
constexpr double kMinSeen = 0.08;        // the same for a peak, whose frequency has an error
constexpr double kMinPowerRatio = 0.01;  // power of a tone over that of the strongest found with it

// Power density of light at a frequency (cycles per row): flat, or one of three shapes that fall beyond a corner.
double density(std::size_t shape, double frequency) {
  if (shape == 0) return 1;
  const std::size_t octave = (shape - 1) / 3;
  const double corner = 0.5 * std::exp2(-static_cast<double>(octave));
  const double square = (frequency / corner) * (frequency / corner);
  switch ((shape - 1) % 3) {
    case 0: return 1 / (1 + square);
    case 1: return 1 / ((1 + square) * (1 + square));
    default: return std::exp(-std::min(square, 600.0));
  }
}

}  // namespace

ColumnAnalysis::ColumnAnalysis(std::size_t rows, double exposure_rows, std::size_t length)
    : rows_(rows),
      length_(length),
      bins_(length / 2 + 1),
      grouped_((bins_ + kMaxGroups - 1) / kMaxGroups),
      exposure_rows_(exposure_rows),
      smooth_(rows, exposure_rows) {
  make_shapes(exposure_rows);
}

// Power in the rows of light at f and at the frequencies f + k that alias to it, and its correlation with the wanted
// light: with
// H(f) = sinc(f·L)·e^(−jπfL), P = Σ |H(f + k)|²·S(f + k) and Σ H*(f + k)·S(f + k)·sinc(f + k).
void ColumnAnalysis::make_shapes(double exposure_rows) {
  const auto bins = static_cast<Index>(bins_);
  seen_ = Matrix::Zero(kShapes, bins);
  wanted_.assign(kShapes, std::vector<std::complex<double>>(bins_));
  for (std::size_t k = 0; k < bins_; ++k)
    for (int alias = -kAliases; alias <= kAliases; ++alias) {
      const double f = static_cast<double>(k) / static_cast<double>(length_) + alias;
      const double h = sinc(f * exposure_rows);
      const auto aliased = h * sinc(f) * std::polar(1.0, pi * std::fmod(alias * exposure_rows, 2.0));
      for (std::size_t shape = 0; shape < kShapes; ++shape) {
        const double power = density(shape, f);
        seen_(static_cast<Index>(shape), static_cast<Index>(k)) += h * h * power;
        wanted_[shape][k] += aliased * power;
      }
    }
  const Index groups = bins / static_cast<Index>(grouped_);
  groups_seen_ = Matrix::Zero(kShapes, groups);
  weights_.resize(static_cast<Index>(kShapes) * kRatios, groups);
  log_sums_.resize(weights_.rows());
  for (Index shape = 0; shape < static_cast<Index>(kShapes); ++shape) {
    const double mean = seen_.row(shape).mean();
    seen_.row(shape) /= mean;
    for (auto& value : wanted_[static_cast<std::size_t>(shape)]) value /= mean;
    for (Index g = 0; g < groups; ++g)
      groups_seen_(shape, g) =
          seen_.row(shape).segment(g * static_cast<Index>(grouped_), static_cast<Index>(grouped_)).mean();
    for (int ratio = 0; ratio < kRatios; ++ratio) {
      const auto power = groups_seen_.row(shape).array() + std::exp2(2 * (ratio + kMinRatio));
      weights_.row(shape * kRatios + ratio) = power.inverse();
      log_sums_(shape * kRatios + ratio) = power.log().sum();
    }
  }
}

Eigen::VectorXd ColumnAnalysis::power_of(const Vector& column) const {
  const auto power = periodogram({column.data(), rows_}, rows_, length_);
  return Eigen::Map<const Vector>(power.data(), static_cast<Index>(bins_));
}

// The largest likelihood of a periodogram whose values are exponentially distributed about light·seen + noise
// (Whittle).
LightAndNoise ColumnAnalysis::fit(const Vector& periodogram, std::optional<double> noise) const {
  const Index groups = groups_seen_.cols(), grouped = static_cast<Index>(grouped_);
  const auto count = static_cast<double>(groups);
  const Vector values =
      Vector::NullaryExpr(groups, [&](Index g) { return periodogram.segment(g * grouped, grouped).mean(); });
  const double mean = values.mean();
  if (mean == 0) return {0, noise.value_or(mean), 0};
  const double alone = noise ? count * (std::log(*noise) + mean / *noise) : count * (std::log(mean) + 1);
  const Vector sums = weights_ * values;
  double least = kInfinity;
  LightAndNoise best;
  for (Index model = 0; model < sums.size(); ++model) {
    const double ratio = std::exp2(2 * (static_cast<int>(model % kRatios) + kMinRatio));
    const double light = noise ? *noise / ratio : sums(model) / count;
    const double misfit = log_sums_(model) + count * std::log(light) + sums(model) / light;
    if (misfit < least) {
      least = misfit;
      best = {light, ratio * light, static_cast<std::size_t>(model / kRatios)};
    }
  }
  if (!((alone - least) * static_cast<double>(grouped_) > kEvidence)) return {0, noise.value_or(mean), 0};
  const auto seen = groups_seen_.row(static_cast<Index>(best.shape)).transpose().array();
  for (int step = 0; step < kFitSteps; ++step) {
    const Eigen::ArrayXd power = best.light * seen + best.noise;
    best.light *= std::sqrt((values.array() * seen / power.square()).sum() / (seen / power).sum());
    if (noise) continue;
    const Eigen::ArrayXd after = best.light * seen + best.noise;
    best.noise *= std::sqrt((values.array() / after.square()).sum() / after.inverse().sum());
  }
  return best;
}

// Smooth light, and whether no more light than noise is left beside it; else it is not evident.
ColumnAnalysis::Smooth ColumnAnalysis::smooth_light(const Vector& column, std::optional<double> noise) const {
  Smooth found{smooth_.estimate(column, noise), false};
  const bool evident = found.light.evident;
  const double allowed = kSmoothNoise * noise.value_or(noise_of_differences({column.data(), rows_}));
  const LightAndNoise left = fit(power_of(evident ? Vector(column - found.light.seen) : column), noise);
  found.is_all = (!evident || found.light.noise <= allowed) && left.light <= left.noise;
  found.light.evident = evident && found.is_all;
  return found;
}

// Frequencies (cycles per row) of peaks that exceed light and noise significantly, without the known ones.
std::vector<double> ColumnAnalysis::new_tones(const Vector& spectrum, const LightAndNoise& rest,
                                              std::span<const double> known) const {
  const double threshold = std::log(static_cast<double>(bins_)) + 4, apart = 2 / static_cast<double>(rows_);
  const auto seen = seen_.row(static_cast<Index>(rest.shape));
  std::vector<Index> peaks;
  for (Index k = 1; k + 1 < spectrum.size(); ++k) {
    const double f = static_cast<double>(k) / static_cast<double>(length_);
    if (spectrum(k) > threshold * (rest.light * seen(k) + rest.noise) && spectrum(k) >= spectrum(k - 1) &&
        spectrum(k) > spectrum(k + 1) && f > apart && f < 0.5 - apart && std::abs(sinc(f * exposure_rows_)) > kMinSeen)
      peaks.push_back(k);
  }
  std::ranges::stable_sort(peaks, [&](Index a, Index b) { return spectrum(a) > spectrum(b); });
  std::vector<double> found;
  for (const Index k : peaks) {
    if (spectrum(k) < kMinPowerRatio * spectrum(peaks.front()) || known.size() + found.size() >= kMaxTones) break;
    const double f = static_cast<double>(k) / static_cast<double>(length_);
    const auto is_near = [&](double other) { return std::abs(other - f) <= apart; };
    if (std::ranges::none_of(known, is_near) && std::ranges::none_of(found, is_near)) found.push_back(f);
  }
  return found;
}

// Tones in the column beside its line. Where smooth light explains it, the alternative is the strongest tone.
ColumnAnalysis::Tones ColumnAnalysis::find_tones(const Vector& column, std::optional<double> noise,
                                                 const SmoothLight::Estimate& smooth) const {
  Tones tones{{{}, {}, column}, {}};
  for (int round = 0;; ++round) {
    const Vector spectrum = power_of(tones.fit.rest);
    tones.left = fit(spectrum, noise);
    if (round == (smooth.evident ? 1 : kRounds)) return tones;
    auto found =
        new_tones(spectrum, smooth.evident ? LightAndNoise{0, smooth.noise, 0} : tones.left, tones.fit.frequencies);
    if (found.empty()) return tones;
    if (smooth.evident) found.erase(found.begin() + 1, found.end());
    found.insert(found.begin(), tones.fit.frequencies.begin(), tones.fit.frequencies.end());
    tones.fit = refine_frequencies(centred_rows(rows_), std::move(found), smooth_.line(), column);
  }
}

// Light of the tones and their line at the ends of the exposures.
ColumnAnalysis::Vector ColumnAnalysis::light_of(const FrequencyFit& tones) const {
  RowSampling rows = centred_rows(rows_);
  std::vector<double> seen, light;
  append_tones(seen, rows, tones.frequencies);
  for (double& time : rows.times) time += 0.5 * exposure_rows_;
  append_tones(light, rows, tones.frequencies);
  Vector amplitudes = tones.amplitudes;
  for (Index k = 0; k < amplitudes.size(); ++k) {
    const double response = sinc(tones.frequencies[static_cast<std::size_t>(k / 2)] * exposure_rows_);
    amplitudes(k) /= std::copysign(std::max(std::abs(response), kMinResponse), response);
  }
  return matrix_of(light, rows) * amplitudes -
         smooth_.line_light() * Vector(smooth_.line().transpose() * (matrix_of(seen, rows) * tones.amplitudes));
}

ColumnAnalysis::Result ColumnAnalysis::take_off_course(std::span<double> column, std::optional<double> noise) const {
  Eigen::Map<Vector> stored(column.data(), static_cast<Index>(rows_));
  const Vector values = stored;
  Smooth smooth = smooth_light(values, noise);
  Tones tones = find_tones(values, noise, smooth.light);
  Vector course = Vector::Zero(values.size());
  bool with_tones = !tones.fit.frequencies.empty();
  if (with_tones) {  // Schwarz's criterion: three parameters a tone
    Smooth beside = smooth_light(tones.fit.rest, noise);
    const double score = beside.light.score + 3 * static_cast<double>(tones.fit.frequencies.size()) *
                                                  std::log(static_cast<double>(rows_ - 2));
    with_tones = !smooth.light.evident || (beside.is_all && score < smooth.light.score);
    if (with_tones) {
      course += light_of(tones.fit);
      smooth = std::move(beside);
    }
  }
  Vector rest = with_tones ? tones.fit.rest : values;
  if (smooth.light.evident) {
    course += smooth.light.light;
    rest -= smooth.light.seen;
    tones.left = fit(power_of(rest), noise);
  }
  stored = rest;
  return {{course.begin(), course.end()}, tones.left};
}

std::vector<std::complex<double>> ColumnAnalysis::gain(const LightAndNoise& rest) const {
  std::vector<std::complex<double>> result(bins_);
  if (rest.light == 0) return result;
  for (std::size_t k = 0; k < bins_; ++k)
    result[k] = rest.light * wanted_[rest.shape][k] /
                (rest.light * seen_(static_cast<Index>(rest.shape), static_cast<Index>(k)) + rest.noise);
  return result;
}

}  // namespace ocisac
