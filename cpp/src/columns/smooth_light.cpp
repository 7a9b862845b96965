#include "columns/smooth_light.hpp"

#include <algorithm>
#include <cmath>

#include "ocisac/core/constants.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

using Eigen::Index;

constexpr double kMaxCycles = 36, kMinRowsPerCycle = 8;  // in the column
constexpr double kWidest = 3.5;                          // the highest frequency over the corner of the widest spectrum
constexpr int kWidths = 12;                              // corners, by half octaves
constexpr double kMinPivot = 1e-8;
constexpr int kMinRatio = -6, kRatios = 21;  // light over noise: 4^-6 to 4^14
constexpr double kEvidence = 12;             // gain in score over noise alone

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
  while (terms < factors.rank() &&
         std::abs(factors.triangle(terms, terms)) > kMinPivot * std::abs(factors.triangle(0, 0)))
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
  if (best.score - score < kEvidence) return best;
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

}  // namespace ocisac
