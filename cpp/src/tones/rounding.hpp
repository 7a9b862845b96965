// Error of gains by rounding to stored values, which beside little noise is no noise but a function of the light.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <optional>
#include <span>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/constants.hpp"

namespace ocisac {

struct StoredSteps {
  const ToneCurve* curve;
  double type_maximum;
  double step;     // between stored values; 0: they have fractions
  double largest;  // in light: that at black or at white

  StoredSteps(const ToneCurve& curve, double type_maximum, double step);
  // In light, at some light above dark.
  [[nodiscard]] double at(double light) const;
  [[nodiscard]] bool are_integers_of_light() const { return curve->kind == ToneCurve::Kind::linear && step <= 1; }
};

struct RoundedTone {
  double cycles_per_row, phase, gain;
  std::optional<double> exposure_cycles;  // none: those of the gain
  double duty;                            // of a square wave; 0: a sine
  double ratio;                           // full_depth_ratio
  std::size_t rows;
};

// Share of the weight, mean of the lamp and other light of a column, above dark.
struct RoundedColumn {
  double share, mean, background;
};

// Variance of noise that grows with the light, above dark, as photons' does: rows that see no lamp may have none.
struct NoiseOfLight {
  double most = kInfinity, at_black = kInfinity, per_light = 0, darkest = 0;

  [[nodiscard]] double at(double light) const { return std::min(at_black + per_light * light, most); }
  [[nodiscard]] double least() const { return at(darkest); }
  [[nodiscard]] NoiseOfLight up_to(double variance) const { return {variance, at_black, per_light, darkest}; }
};

// That of light (columns × pairs of neighbouring rows): what the columns do not share, and what their mean changes by
// in most pairs, which no edge parts: at most `variance` less that share of the noise of a column.
NoiseOfLight noise_of_samples(const Eigen::MatrixXd& samples, double variance, double share);

// RMS error by rounding of (gain · mean · ratio) beside noise, over the place of the levels between two codes.
double rounding_error(const StoredSteps& steps, const RoundedTone& tone, std::span<const RoundedColumn> columns,
                      const NoiseOfLight& noise);

// The most of it that any tone has.
double most_rounding_error(const StoredSteps& steps, double noise_variance);

}  // namespace ocisac
