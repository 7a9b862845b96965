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

// Hybrid log-gamma of a camera: ARIB STD-B67, ITU-R BT.2100.
namespace hlg {
constexpr double kA = 0.17883277, kB = 1 - 4 * kA;
const double c = 0.5 - kA * std::log(4 * kA);
double to_linear(double v) { return v <= 0.5 ? v * v / 3 : (std::exp((v - c) / kA) + kB) / 12; }
double from_linear(double light) {
  return light <= 1.0 / 12 ? std::sqrt(3 * light) : kA * std::log(12 * light - kB) + c;
}
double slope(double v) { return v <= 0.5 ? 2 * v / 3 : std::exp((v - c) / kA) / (12 * kA); }
}  // namespace hlg

// Perceptual quantizer: SMPTE ST 2084. Light 1 is 10,000 cd/m².
namespace pq {
constexpr double kM1 = 2610.0 / 16384, kM2 = 2523.0 / 32, kC1 = 3424.0 / 4096, kC2 = 2413.0 / 128, kC3 = 2392.0 / 128;
double to_linear(double v) {
  const double p = std::pow(v, 1 / kM2);
  return std::pow(std::max(p - kC1, 0.0) / (kC2 - kC3 * p), 1 / kM1);
}
double from_linear(double light) {
  if (light == 0) return 0;  // of all values below c1^m2 = 7e-7
  const double y = std::pow(light, kM1);
  return std::pow((kC1 + kC2 * y) / (1 + kC3 * y), kM2);
}
double slope(double v) {
  const double p = std::pow(v, 1 / kM2);
  return p <= kC1 ? 0 : to_linear(v) / kM1 * (1 / (p - kC1) + kC3 / (kC2 - kC3 * p)) * p / (kM2 * v);
}
}  // namespace pq

double curve_at(const ToneCurve& curve, double v) {
  switch (curve.kind) {
    case ToneCurve::Kind::gamma: return std::pow(v, curve.gamma);
    case ToneCurve::Kind::srgb: return srgb_to_linear(v);
    case ToneCurve::Kind::hlg: return hlg::to_linear(v);
    case ToneCurve::Kind::pq: return pq::to_linear(v);
    case ToneCurve::Kind::linear: break;
  }
  return v;
}

double inverse_at(const ToneCurve& curve, double light) {
  switch (curve.kind) {
    case ToneCurve::Kind::gamma: return std::pow(light, 1 / curve.gamma);
    case ToneCurve::Kind::srgb: return linear_to_srgb(light);
    case ToneCurve::Kind::hlg: return hlg::from_linear(light);
    case ToneCurve::Kind::pq: return pq::from_linear(light);
    case ToneCurve::Kind::linear: break;
  }
  return light;
}

double slope_at(const ToneCurve& curve, double v) {
  switch (curve.kind) {
    case ToneCurve::Kind::gamma: return curve.gamma * std::pow(std::max(v, 1e-6), curve.gamma - 1);
    case ToneCurve::Kind::srgb: return srgb_slope(v);
    case ToneCurve::Kind::hlg: return hlg::slope(v);
    case ToneCurve::Kind::pq: return pq::slope(v);
    case ToneCurve::Kind::linear: break;
  }
  return 1;
}

// HLG and PQ go straight on above this value, which no file holds: limited range ends at 1.09.
constexpr double kEnd = 1.25;
bool ends(const ToneCurve& curve) { return curve.kind == ToneCurve::Kind::hlg || curve.kind == ToneCurve::Kind::pq; }

double to_linear(const ToneCurve& curve, double v) {
  if (v <= kEnd || !ends(curve)) return curve_at(curve, v);
  return curve_at(curve, kEnd) + slope_at(curve, kEnd) * (v - kEnd);
}

double from_linear(const ToneCurve& curve, double light) {
  const double above = ends(curve) ? light - curve_at(curve, kEnd) : 0;
  return above <= 0 ? inverse_at(curve, light) : kEnd + above / slope_at(curve, kEnd);
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
  return std::copysign(span * to_linear(curve, std::abs(above_dark) / span), above_dark);
}

double stored_value(const ToneCurve& curve, double light, double type_maximum) {
  if (curve.kind == ToneCurve::Kind::linear) return light + curve.dark_level;
  const double span = white_level(curve, type_maximum) - curve.dark_level;
  return std::copysign(span * from_linear(curve, std::abs(light) / span), light) + curve.dark_level;
}

double light_per_step(const ToneCurve& curve, double value, double type_maximum) {
  constexpr double kMinSlope = 0.02;
  const double v = std::abs(value - curve.dark_level) / (white_level(curve, type_maximum) - curve.dark_level);
  return std::max(slope_at(curve, ends(curve) ? std::min(v, kEnd) : v), kMinSlope);
}

double saturation_level(const ToneCurve& curve, double type_maximum) {
  constexpr double kShareOfWhite = 0.98;
  return curve.dark_level + kShareOfWhite * (white_level(curve, type_maximum) - curve.dark_level);
}

}  // namespace ocisac
