// From stored pixel values (DN) to linear light and back; the one place of tone curves and of saturation.
#pragma once

#include <cstdint>
#include <limits>
#include <type_traits>

namespace ocisac {

// light = (white − dark)·curve((v − dark)/(white − dark)): light has the scale of DN and is 0 at the dark level.
// Limited-range luma has dark = 16 and white = 235.
struct ToneCurve {
  enum class Kind { linear, gamma, srgb, hlg, pq };
  Kind kind = Kind::linear;
  double gamma = 2.2;      // exponent of Kind::gamma, > 0
  double dark_level = 0;   // DN of no light
  double white_level = 0;  // DN of full light; 0: the largest value of the sample type (255, 65535; 1 for floats)
  bool operator==(const ToneCurve&) const = default;
};

void check(const ToneCurve& curve);

// White level in DN for samples of the type whose largest value is `type_maximum`.
double white_level(const ToneCurve& curve, double type_maximum);

// Linear light of one pixel value, in DN above dark. The curve has odd symmetry about the dark level.
double linear_light(const ToneCurve& curve, double value, double type_maximum);

// The stored value, not rounded, of linear light in DN above dark: the inverse of linear_light().
double stored_value(const ToneCurve& curve, double light, double type_maximum);

// Change of linear light for a change of the stored value by 1; at least 1/50 of its mean, since the slope of a power
// vanishes at black.
double light_per_step(const ToneCurve& curve, double value, double type_maximum);

// The largest value a sample of type T can hold; 1 for floating point.
template <class T>
constexpr double sample_maximum() {
  if constexpr (std::is_same_v<std::remove_cv_t<T>, std::uint8_t>) return 255;
  if constexpr (std::is_same_v<std::remove_cv_t<T>, std::uint16_t>) return 65535;
  return 1;
}

// A sample at or above dark + 0.98·(white − dark) is saturated, in every room. The margin is that of lossy files and of
// sharpening, which scatter clipped samples below white; a signal that comes so close to white has clipped noise, too.
// `type_maximum`: NaN for floating point, which has no maximum; the level is then NaN, unless white is stated.
double saturation_level(const ToneCurve& curve, double type_maximum);

template <class T>
double saturation_level(const ToneCurve& curve) {
  return saturation_level(curve,
                          std::is_floating_point_v<T> ? std::numeric_limits<double>::quiet_NaN() : sample_maximum<T>());
}

}  // namespace ocisac
