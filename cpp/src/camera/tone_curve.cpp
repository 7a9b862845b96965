#include "ocisac/camera/tone_curve.hpp"

#include <algorithm>
#include <cmath>

#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

// IEC 61966-2-1.
double srgb_to_linear(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }
double linear_to_srgb(double v) { return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055; }
double srgb_slope(double v) { return v <= 0.04045 ? 1 / 12.92 : 2.4 / 1.055 * std::pow((v + 0.055) / 1.055, 1.4); }

double curve_of_magnitude(const ToneCurve& curve, double v) {
  switch (curve.kind) {
    case ToneCurve::Kind::gamma: return std::pow(v, curve.gamma);
    case ToneCurve::Kind::srgb: return srgb_to_linear(v);
    case ToneCurve::Kind::linear: break;
  }
  return v;
}

}  // namespace

void check(const ToneCurve& curve) {
  require_positive("gamma", curve.gamma);
  require_finite("dark_level", curve.dark_level);
  require_finite("white_level", curve.white_level);
  require(curve.white_level == 0 || curve.white_level > curve.dark_level, "white_level", curve.white_level,
          "a finite number above dark_level");
}

double white_level(const ToneCurve& curve, double type_maximum) {
  return curve.white_level == 0 ? type_maximum : curve.white_level;
}

double linear_light(const ToneCurve& curve, double value, double type_maximum) {
  const double above_dark = value - curve.dark_level;
  if (curve.kind == ToneCurve::Kind::linear) return above_dark;
  const double span = white_level(curve, type_maximum) - curve.dark_level;
  return std::copysign(span * curve_of_magnitude(curve, std::abs(above_dark) / span), above_dark);
}

double stored_value(const ToneCurve& curve, double light, double type_maximum) {
  if (curve.kind == ToneCurve::Kind::linear) return light + curve.dark_level;
  const double span = white_level(curve, type_maximum) - curve.dark_level, v = std::abs(light) / span;
  const double stored = curve.kind == ToneCurve::Kind::srgb ? linear_to_srgb(v) : std::pow(v, 1 / curve.gamma);
  return std::copysign(span * stored, light) + curve.dark_level;
}

double light_per_step(const ToneCurve& curve, double value, double type_maximum) {
  if (curve.kind == ToneCurve::Kind::linear) return 1;
  constexpr double min_slope = 0.02, min_value = 1e-6;
  const double v = std::abs(value - curve.dark_level) / (white_level(curve, type_maximum) - curve.dark_level);
  const double slope = curve.kind == ToneCurve::Kind::srgb
                           ? srgb_slope(v)
                           : curve.gamma * std::pow(std::max(v, min_value), curve.gamma - 1);
  return std::max(slope, min_slope);
}

double saturation_level(const ToneCurve& curve, double type_maximum) {
  constexpr double share_of_white = 0.98;
  return curve.dark_level + share_of_white * (white_level(curve, type_maximum) - curve.dark_level);
}

}  // namespace ocisac
