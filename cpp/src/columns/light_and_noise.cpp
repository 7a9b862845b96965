#include "columns/light_and_noise.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/linear_algebra.hpp"
#include "core/spectrum.hpp"
#include "ocisac/light/exposure_response.hpp"

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
constexpr int kRefinements = 2;

// Power density of light at a frequency (cycles per row): flat, or one of three shapes that fall beyond a corner.
double density(std::size_t shape, double frequency) {
  if (shape == 0) return 1;
  const double corner = 0.5 * std::exp2(-static_cast<double>((shape - 1) / 3));
  const double square = (frequency / corner) * (frequency / corner);
  switch ((shape - 1) % 3) {
    case 0: return 1 / (1 + square);
    case 1: return 1 / ((1 + square) * (1 + square));
    default: return std::exp(-std::min(square, 600.0));
  }
}

// The power gain of y[n−1] − 2·y[n] + y[n+1] is 6 for white noise and small for light that changes slowly.
double noise_of_second_differences(const Eigen::VectorXd& column) {
  const Index inner = column.size() - 2;
  return (column.head(inner) - 2 * column.segment(1, inner) + column.tail(inner)).squaredNorm() /
         (6 * static_cast<double>(inner));
}

}  // namespace

ColumnAnalysis::ColumnAnalysis(std::size_t rows, double exposure_rows, std::size_t length)
    : rows_(rows),
      length_(length),
      bins_(length / 2 + 1),
      grouped_((bins_ + kMaxGroups - 1) / kMaxGroups),
      exposure_rows_(exposure_rows),
      smooth_(rows, exposure_rows),
      window_(Vector::NullaryExpr(static_cast<Index>(rows), [&](Index n) {
        return 0.5 - 0.5 * std::cos(2 * pi * static_cast<double>(n + 1) / static_cast<double>(rows + 1));
      })) {
  window_ /= window_.norm();
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

// |DFT|² of the column under a Hann window: the power density.
Eigen::VectorXd ColumnAnalysis::periodogram(const Vector& column) const {
  std::vector<double> padded(length_, 0.0);
  for (std::size_t n = 0; n < rows_; ++n) padded[n] = column(static_cast<Index>(n)) * window_(static_cast<Index>(n));
  const auto spectrum = half_spectra(padded, length_);
  return Vector::NullaryExpr(static_cast<Index>(bins_),
                             [&](Index k) { return std::norm(spectrum[static_cast<std::size_t>(k)]); });
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
  double least = std::numeric_limits<double>::infinity();
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
  const double allowed = kSmoothNoise * noise.value_or(noise_of_second_differences(column));
  const LightAndNoise left = fit(periodogram(evident ? Vector(column - found.light.seen) : column), noise);
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
    const double before = std::log(spectrum(k - 1)), at = std::log(spectrum(k)), after = std::log(spectrum(k + 1));
    const double off = std::clamp(0.5 * (before - after) / (before - 2 * at + after), -0.5, 0.5);
    const double f = (static_cast<double>(k) + (std::isfinite(off) ? off : 0)) / static_cast<double>(length_);
    const auto is_near = [&](double other) { return std::abs(other - f) <= apart; };
    if (std::ranges::none_of(known, is_near) && std::ranges::none_of(found, is_near)) found.push_back(f);
  }
  return found;
}

// (rows × (2·tones + 2)) cosines, sines, ones and a slope, `later` rows after those of the column: the column's line
// and its tones are estimated together.
ColumnAnalysis::Matrix ColumnAnalysis::waves(std::span<const double> frequencies, double later) const {
  const auto count = static_cast<Index>(frequencies.size());
  Matrix result(static_cast<Index>(rows_), 2 * count + 2);
  for (Index n = 0; n < result.rows(); ++n) {
    const double row = static_cast<double>(n) + later - 0.5 * static_cast<double>(rows_ - 1);
    for (Index tone = 0; tone < count; ++tone) {
      const double angle = 2 * pi * frequencies[static_cast<std::size_t>(tone)] * row;
      result(n, tone) = std::cos(angle);
      result(n, tone + count) = std::sin(angle);
    }
    result(n, 2 * count) = 1;
    result(n, 2 * count + 1) = row;
  }
  return result;
}

// Gauss-Newton steps of all frequencies together.
void ColumnAnalysis::refine(const Vector& column, std::vector<double>& frequencies) const {
  const auto count = static_cast<Index>(frequencies.size());
  const double reach = 0.5 / static_cast<double>(rows_);
  for (int step = 0; step < kRefinements; ++step) {
    const Matrix basis = waves(frequencies, 0);
    const Vector amplitudes = least_squares(basis, column);
    Eigen::MatrixXd extended(basis.rows(), 3 * count + 2);
    extended.leftCols(2 * count + 2) = basis;
    for (Index n = 0; n < basis.rows(); ++n) {
      const double turn = 2 * pi * (static_cast<double>(n) - 0.5 * static_cast<double>(rows_ - 1));
      for (Index tone = 0; tone < count; ++tone)
        extended(n, 2 * count + 2 + tone) =
            turn * (amplitudes(tone + count) * basis(n, tone) - amplitudes(tone) * basis(n, tone + count));
    }
    const Vector moves = least_squares(extended, column - basis * amplitudes).bottomRows(count);
    for (Index tone = 0; tone < count; ++tone) {
      double& f = frequencies[static_cast<std::size_t>(tone)];
      f = std::clamp(f + std::clamp(moves(tone), -reach, reach), 2 * reach, 0.5 - 2 * reach);
    }
  }
}

// Tones in the column, and what is left of it. Where smooth light explains it, the alternative is the strongest tone.
ColumnAnalysis::Tones ColumnAnalysis::find_tones(const Vector& column, std::optional<double> noise,
                                                 const SmoothLight::Estimate& smooth) const {
  Tones tones{.frequencies = {}, .amplitudes = {}, .rest = column, .left = {}};
  for (int round = 0;; ++round) {
    const Vector spectrum = periodogram(tones.rest);
    tones.left = fit(spectrum, noise);
    if (round == (smooth.evident ? 1 : kRounds)) return tones;
    auto found =
        new_tones(spectrum, smooth.evident ? LightAndNoise{0, smooth.noise, 0} : tones.left, tones.frequencies);
    if (found.empty()) return tones;
    if (smooth.evident) found.erase(found.begin() + 1, found.end());
    tones.frequencies.insert(tones.frequencies.end(), found.begin(), found.end());
    refine(column, tones.frequencies);
    const Matrix basis = waves(tones.frequencies, 0);
    tones.amplitudes = Vector(least_squares(basis, column));  // moved: Eigen's resize frees twice where memory ends
    tones.rest = Vector(column - basis * tones.amplitudes);
  }
}

// Light of the tones and their line at the ends of the exposures.
ColumnAnalysis::Vector ColumnAnalysis::light_of(const Tones& tones) const {
  const auto count = tones.frequencies.size();
  Vector amplitudes = tones.amplitudes;
  for (std::size_t tone = 0; tone < 2 * count; ++tone) {
    const double response = sinc(tones.frequencies[tone % count] * exposure_rows_);
    amplitudes(static_cast<Index>(tone)) /= std::copysign(std::max(std::abs(response), kMinResponse), response);
  }
  return waves(tones.frequencies, 0.5 * exposure_rows_) * amplitudes;
}

ColumnAnalysis::Result ColumnAnalysis::take_off_course(std::span<double> column, std::optional<double> noise) const {
  Eigen::Map<Vector> stored(column.data(), static_cast<Index>(rows_));
  const Vector values = stored;
  Smooth smooth = smooth_light(values, noise);
  Tones tones = find_tones(values, noise, smooth.light);
  Vector course = Vector::Zero(values.size());
  bool with_tones = !tones.frequencies.empty();
  if (with_tones) {  // Schwarz's criterion: three parameters a tone
    Smooth beside = smooth_light(tones.rest, noise);
    const double score = beside.light.score +
                         3 * static_cast<double>(tones.frequencies.size()) * std::log(static_cast<double>(rows_ - 2));
    with_tones = !smooth.light.evident || (beside.is_all && score < smooth.light.score);
    if (with_tones) {
      course += light_of(tones);
      smooth = std::move(beside);
    }
  }
  Vector rest = with_tones ? std::move(tones.rest) : values;
  if (smooth.light.evident) {
    course += smooth.light.light;
    rest -= smooth.light.seen;
    tones.left = fit(periodogram(rest), noise);
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
