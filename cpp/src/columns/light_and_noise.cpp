#include "columns/light_and_noise.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/levels.hpp"
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
constexpr int kMinRatio = -8, kRatios = 23;  // light over noise: 4^-8 to 4^14
constexpr int kAliases = 4;                  // on either side
constexpr std::size_t kMaxGroups = 512;      // of bins that the fit sees
constexpr double kEvidence = 6;              // log likelihood that light must gain over noise alone
constexpr double kSmoothNoise = 1.3;         // power left by smooth light over that of the noise, at most
constexpr std::size_t kMaxTones = 12;
constexpr double kMaxCycles = 36, kMinRowsPerCycle = 8;  // of smooth light in the column
constexpr double kWidest = 3.5;                          // the highest frequency over the corner of the widest spectrum
constexpr int kWidths = 12;                              // corners, by half octaves

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

// Light with a Gaussian spectrum: independent waves of a period of two columns. Straight lines have no say in the
// evidence: its contrasts are orthogonal to them.
SmoothLight::SmoothLight(std::size_t row_count, double exposure_rows) {
  const auto rows = static_cast<Index>(row_count);
  const auto length = static_cast<double>(rows);
  const double cycles = std::min(kMaxCycles, length / kMinRowsPerCycle), corner = cycles / (kWidest * length);
  const Index count = static_cast<Index>(2 * cycles) + 1;
  const Vector frequencies = Vector::LinSpaced(count, 0, static_cast<double>(count - 1) / (2 * length));
  const auto density = [&](double at) {
    return Vector(
        Vector::NullaryExpr(2 * count, [&](Index k) { return std::exp(-std::pow(frequencies(k / 2) / at, 2)); }));
  };
  RowSampling sampling = centred_rows(row_count);
  const Eigen::Map<const Vector> centred(sampling.times.data(), rows);
  line_.resize(rows, 2);
  line_.col(0).setConstant(1 / std::sqrt(length));
  line_.col(1) = centred / centred.norm();
  line_light_ = line_;
  line_light_.col(1).array() += 0.5 * exposure_rows / centred.norm();

  std::vector<double> light, seen_basis;
  append_tones(light, sampling, {frequencies.data(), static_cast<std::size_t>(count)});
  for (double& time : sampling.times) time -= 0.5 * exposure_rows;
  sampling.exposures.assign(row_count, exposure_rows);
  append_tones(seen_basis, sampling, {frequencies.data(), static_cast<std::size_t>(count)});
  const Matrix seen = matrix_of(seen_basis, sampling);
  const Matrix in_lines = transposed_product(line_, seen);
  light_ = matrix_of(light, sampling) - product(line_light_, in_lines);
  const Matrix weighted = (seen - product(line_, in_lines)) * density(corner).cwiseSqrt().asDiagonal();
  const OrthogonalFactors factors = pivoted_orthogonal_factors(weighted);
  Index terms = 0;
  while (terms < factors.rank() && std::abs(factors.triangle(terms, terms)) > kEqual * std::abs(factors.triangle(0, 0)))
    ++terms;
  basis_ = factors.basis.leftCols(terms);
  projected_ = transposed_product(basis_, seen);
  for (int width = 0; width < kWidths; ++width) {
    Vector power = density(corner * std::exp2(-0.5 * width));
    Matrix covariance = gram(projected_ * power.cwiseSqrt().asDiagonal());
    const double scale = length / covariance.trace();
    EigenFactors of = symmetric_factors(covariance * scale);
    widths_.push_back({power * scale, of.values.cwiseMax(0), std::move(of.vectors)});
  }
}

SmoothLight::Estimate SmoothLight::estimate(const Vector& column, std::optional<double> noise) const {
  const auto count = static_cast<double>(column.size() - 2);
  const double whole = column.squaredNorm();
  const Vector parts = basis_.transpose() * column;
  const double outside = std::max(whole - parts.squaredNorm(), 1e-28 * whole);
  const auto misfit = [&](double left) {
    return noise ? left / *noise + count * std::log(*noise) : count * (std::log(left / count) + 1);
  };
  Estimate best{
      .score = misfit(whole), .evident = false, .noise = noise.value_or(whole / count), .seen = {}, .light = {}};
  if (whole == 0) return best;
  const Width* width = nullptr;
  double score = kInfinity, ratio = 0;
  for (const Width& tried : widths_) {
    const Eigen::ArrayXd squares = (tried.vectors.transpose() * parts).array().square();
    for (int k = 0; k < kRatios; ++k) {
      const double over_noise = std::exp2(2 * (k + kMinRatio));
      const Eigen::ArrayXd variances = 1 + over_noise * tried.values.array();
      const double own = misfit((squares / variances).sum() + outside) + variances.log().sum();
      if (own < score) score = own, ratio = over_noise, width = &tried;
    }
  }
  if (best.score - score < 2 * kEvidence) return best;
  const Vector turned = width->vectors.transpose() * parts;
  const Eigen::ArrayXd weights = ratio / (1 + ratio * width->values.array());
  const Eigen::ArrayXd kept = weights * width->values.array();
  best.score = score;
  best.evident = true;
  best.seen = basis_ * (width->vectors * Vector(kept * turned.array()));
  best.noise = (column - best.seen).squaredNorm() / (count - kept.sum());
  const Vector amplitudes =
      width->power.cwiseProduct(projected_.transpose() * (width->vectors * Vector(weights * turned.array())));
  best.light = light_ * amplitudes;
  return best;
}

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
      const auto power = groups_seen_.row(shape).array() + std::exp2(-2 * (ratio + kMinRatio));
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
    const double ratio = std::exp2(-2 * (static_cast<int>(model % kRatios) + kMinRatio));
    const double light = noise ? *noise / ratio : sums(model) / count;
    const double misfit = log_sums_(model) + count * std::log(light) + sums(model) / light;
    if (misfit < least) {
      least = misfit;
      best = {light, ratio * light, static_cast<std::size_t>(model / kRatios)};
    }
  }
  if (!((alone - least) * static_cast<double>(grouped_) > kEvidence)) return {0, noise.value_or(mean), 0};
  return best;
}

// Smooth light; it is not evident, with the worst score, where it leaves more than noise.
SmoothLight::Estimate ColumnAnalysis::smooth_light(const Vector& column, std::optional<double> noise) const {
  SmoothLight::Estimate found = smooth_.estimate(column, noise);
  const double allowed = kSmoothNoise * noise.value_or(noise_of_differences({column.data(), rows_}));
  if (!found.evident || found.noise <= allowed) return found;
  found.evident = false;
  found.score = kInfinity;
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
        spectrum(k) > spectrum(k + 1) && f > apart && f < 0.5 - apart &&
        std::abs(sinc(f * exposure_rows_)) > kSmallShare)
      peaks.push_back(k);
  }
  std::ranges::stable_sort(peaks, [&](Index a, Index b) { return spectrum(a) > spectrum(b); });
  std::vector<double> found;
  for (const Index k : peaks) {
    if (known.size() + found.size() >= kMaxTones) break;
    const double f = static_cast<double>(k) / static_cast<double>(length_);
    const auto is_near = [&](double other) { return std::abs(other - f) <= apart; };
    if (std::ranges::none_of(known, is_near) && std::ranges::none_of(found, is_near)) found.push_back(f);
  }
  return found;
}

// Tones in the column as the rows see them beside its line, and what is `left`. Where smooth light explains it, the
// alternative is the strongest tone.
FrequencyFit ColumnAnalysis::find_tones(const Vector& column, std::optional<double> noise,
                                        const SmoothLight::Estimate& smooth, LightAndNoise& left) const {
  FrequencyFit tones{{}, {}, column};
  for (int round = 0;; ++round) {
    const Vector spectrum = power_of(tones.rest);
    left = fit(spectrum, noise);
    if (round == (smooth.evident ? 1 : kMaxIterations)) return tones;
    auto found = new_tones(spectrum, smooth.evident ? LightAndNoise{0, smooth.noise, 0} : left, tones.frequencies);
    if (found.empty()) return tones;
    if (smooth.evident) found.erase(found.begin() + 1, found.end());
    found.insert(found.begin(), tones.frequencies.begin(), tones.frequencies.end());
    tones = refine_frequencies(centred_rows(rows_), std::move(found), smooth_.line(), column);
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
    amplitudes(k) /= std::copysign(std::max(std::abs(response), kSmallShare), response);
  }
  return matrix_of(light, rows) * amplitudes -
         smooth_.line_light() * Vector(smooth_.line().transpose() * (matrix_of(seen, rows) * tones.amplitudes));
}

ColumnAnalysis::Result ColumnAnalysis::take_off_course(std::span<double> column, std::optional<double> noise) const {
  Eigen::Map<Vector> stored(column.data(), static_cast<Index>(rows_));
  const Vector values = stored;
  SmoothLight::Estimate smooth = smooth_light(values, noise);
  LightAndNoise left;
  const FrequencyFit tones = find_tones(values, noise, smooth, left);
  Vector course = Vector::Zero(values.size());
  bool with_tones = !tones.frequencies.empty();
  if (with_tones) {  // Schwarz's criterion: three parameters a tone
    SmoothLight::Estimate beside = smooth_light(tones.rest, noise);
    const double score =
        beside.score + 3 * static_cast<double>(tones.frequencies.size()) * std::log(static_cast<double>(rows_ - 2));
    with_tones = !smooth.evident || score < smooth.score;
    if (with_tones) {
      course += light_of(tones);
      smooth = std::move(beside);
    }
  }
  Vector rest = with_tones ? tones.rest : values;
  if (smooth.evident) {
    course += smooth.light;
    rest -= smooth.seen;
    left = fit(power_of(rest), noise);
  }
  stored = rest;
  return {{course.begin(), course.end()}, left};
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
