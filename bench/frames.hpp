// Input of the benchmarks, equal in every run.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <vector>

#include "ocisac/core/views.hpp"
#include "ocisac/tones/projection.hpp"

namespace bench {

inline constexpr std::size_t kRows = 1080;
inline constexpr std::size_t kColumns = 1920;
inline constexpr std::size_t kFrames = 48;  // 100 MB of bytes: more than the caches

template <class T>
std::vector<T> noise(std::size_t size, unsigned seed = 1) {
  std::vector<T> values(size);
  std::uint32_t state = seed;  // linear congruential generator: cheap relative to the measured work
  for (T& value : values) value = static_cast<T>((state = 1664525U * state + 1013904223U) >> 24);
  return values;
}

// (outputs × groups): mean, then cosine and sine of tones.
inline std::vector<double> tone_weights(std::size_t outputs, std::size_t groups) {
  std::vector<double> weights(outputs * groups);
  for (std::size_t o = 0; o < outputs; ++o)
    for (std::size_t g = 0; g < groups; ++g) {
      const double cycles = 12.0 * static_cast<double>((o + 1) / 2 * g) / static_cast<double>(groups);
      const double quarter = o % 2 == 0 && o > 0 ? 0.25 : 0;
      weights[o * groups + g] = std::cos(2 * std::numbers::pi * (cycles - quarter)) / static_cast<double>(groups);
    }
  return weights;
}

inline ocisac::RowWeights row_weights(std::size_t outputs, int row_group, int limbs) {
  const std::size_t groups = kRows / static_cast<std::size_t>(row_group);
  return {tone_weights(outputs, groups), outputs, kRows, row_group, limbs};
}

}  // namespace bench
