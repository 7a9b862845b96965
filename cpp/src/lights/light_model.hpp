// Logistic models of lights, as written by bench/light_probability.py --write.
#pragma once

#include <array>

namespace ocisac {

inline constexpr double kToneIntercept = -10.87;
inline constexpr std::array<double, 12> kToneWeights{4.242,  -0.646, -2.338, -3.461,  -0.4586, 0.2181,
                                                     0.8221, 0.803,  1.13,   -0.2051, 0.1836,  -34.39};
inline constexpr double kDataIntercept = -6.552;
inline constexpr std::array<double, 6> kDataWeights{-0.3194, 0.6361, 0.5942, 1.374, -0.9865, -0.9057};
inline constexpr double kRequiredOdds = 0.075;  // at one false light in a photograph

}  // namespace ocisac
