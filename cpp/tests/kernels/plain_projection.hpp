// project() as a plain loop; bytes are multiplied with byte_weights().
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <variant>
#include <vector>

#include "ocisac/tones/projection.hpp"

inline ocisac::Projection project_plainly(const ocisac::AnyFramesView& frames, std::size_t frame, std::size_t first,
                                          std::size_t count, const ocisac::RowWeights& weights,
                                          std::span<const float> light = {}) {
  const auto group = static_cast<std::size_t>(weights.row_group());
  return std::visit(
      [&]<class T>(const ocisac::FramesView<const T>& view) {
        const bool as_integers = std::is_same_v<T, std::uint8_t> && light.empty();
        const auto used = as_integers ? weights.byte_weights()
                                      : std::vector<double>(weights.weights().begin(), weights.weights().end());
        const auto value = [&](T sample) -> double {
          if constexpr (std::is_integral_v<T>)
            if (!light.empty()) return light[sample];
          return static_cast<double>(sample);
        };
        ocisac::Projection result{std::vector<double>(weights.outputs() * count), std::vector<double>(count),
                                  std::vector<double>(count),
                                  std::vector<double>(count, -std::numeric_limits<double>::infinity())};
        for (std::size_t c = 0; c < count; ++c)
          for (std::size_t g = 0; g < weights.groups(); ++g) {
            double sum = 0;
            for (std::size_t r = g * group; r < (g + 1) * group; ++r) {
              const double v = value(view(frame, r, first + c));
              result.maximum[c] = std::max(result.maximum[c], v);
              sum += v;
            }
            result.totals[c] += sum;
            result.squares[c] += sum * sum;
            for (std::size_t o = 0; o < weights.outputs(); ++o)
              result.sums[o * count + c] += used[o * weights.groups() + g] * sum;
          }
        return result;
      },
      frames);
}
