// Error of gains by rounding to stored values, which beside little noise is no noise but a function of the light.
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "ocisac/camera/tone_curve.hpp"

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

// RMS error by rounding of (gain · mean · ratio) beside noise of a variance, over the place of the levels between two
// codes.
double rounding_error(const StoredSteps& steps, const RoundedTone& tone, std::span<const RoundedColumn> columns,
                      double noise_variance);

// The most of it that any tone has.
double most_rounding_error(const StoredSteps& steps, double noise_variance);

}  // namespace ocisac
