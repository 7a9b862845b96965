#include "ocisac/camera/tone_curve.hpp"

#include <cmath>

#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

// IEC 61966-2-1.
double srgb_to_linear(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }

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

}  // namespace ocisac
