// Numbers that all rooms name alike.
#pragma once

#include <limits>

namespace ocisac {

inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();  // unknown
inline constexpr double kInfinity = std::numeric_limits<double>::infinity();
inline constexpr double kMostCounted = 1e15;        // of rows, cycles, steps: beyond it doubles have hardly a fraction
inline constexpr double kMaxLevel = 1e100;          // of light, whose squares are numbers
inline constexpr double kMedianMagnitude = 0.6745;  // of a normal variable, in standard deviations

}  // namespace ocisac
