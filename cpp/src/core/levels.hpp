// Levels that rooms share where answers do not depend on their exact value.
#pragma once

#include <numbers>

namespace ocisac {

inline constexpr double kTwoPi = 2 * std::numbers::pi;
inline constexpr double kEqual = 1e-9;                     // relative difference that is rounding
inline constexpr int kMaxIterations = 8;                   // of a loop that convergence ends before
inline constexpr int kManyIterations = 40;                 // of small steps
inline constexpr double kWeak = 3, kSure = 4;              // standard errors: chance below 1 %; noise does not reach
inline constexpr double kSmallShare = 0.1, kMostly = 0.5;  // of a light, of a correlation
inline constexpr double kNextToNone = 0.01;                // of rows, of a frame
inline constexpr double kNearlyAll = 0.9;                  // the same; of a correlation

}  // namespace ocisac
