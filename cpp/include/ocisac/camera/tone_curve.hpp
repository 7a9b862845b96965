// From stored pixel values (DN) to linear light.
#pragma once

#include <cstdint>
#include <type_traits>

namespace ocisac {

// light = (white − dark)·curve((v − dark)/(white − dark)): light has the scale of DN and is 0 at the dark level.
// Limited-range luma has dark = 16 and white = 235.
struct ToneCurve {
  enum class Kind { linear, gamma, srgb };
  Kind kind = Kind::linear;
  double gamma = 2.2;      // exponent of Kind::gamma, > 0
  double dark_level = 0;   // DN of no light
  double white_level = 0;  // DN of full light; 0: the largest value of the sample type (255, 65535; 1 for floats)
};

void check(const ToneCurve& curve);

// White level in DN for samples of the type whose largest value is `type_maximum`.
double white_level(const ToneCurve& curve, double type_maximum);

// Linear light of one pixel value, in DN above dark. The curve has odd symmetry about the dark level.
double linear_light(const ToneCurve& curve, double value, double type_maximum);

// The largest value a sample of type T can hold; pixels there are saturated. 1 for floating point.
template <class T>
constexpr double sample_maximum() {
  if constexpr (std::is_same_v<std::remove_cv_t<T>, std::uint8_t>) return 255;
  if constexpr (std::is_same_v<std::remove_cv_t<T>, std::uint16_t>) return 65535;
  return 1;
}

}  // namespace ocisac
