// Detection of edges between dark and bright, independent of level and gradient.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace ocisac {

// Rows of alternating minima and maxima; neighbours differ by more than `hysteresis`.
std::vector<std::size_t> turning_points(std::span<const double> signal, double hysteresis);

// Removes swings that are small relative to those around them: noise and texture on a steady level.
std::vector<std::size_t> prune_turning_points(std::span<const double> signal, std::vector<std::size_t> points);

struct Edges {
  std::vector<double> rows;          // place of each edge, fractional rows, ascending
  std::vector<std::uint8_t> rising;  // 1: from dark to bright; alternates
  double roundings = 0;              // sum over the edges

  // Adds the place where the signal crosses a level between two rows on either side of it: the middle of its first and
  // last passage.
  void add(std::span<const double> signal, std::size_t from, std::size_t to, double level);

  // Mean range, rows, of the error of an edge's place by where between two rows it lies: 1 where the light changes
  // between the exposures of two rows, 0 where it takes two rows or more.
  [[nodiscard]] double rounding() const;
};

// Places where the signal crosses `share` of the height (from dark to bright) between neighbouring turning points, or,
// where that crosses this edge, of the height between the darkest and the brightest of `around` more to either side:
// chips shorter than the exposure do not reach the level of longer runs.
Edges edges_between(std::span<const double> signal, std::span<const std::size_t> points, double share,
                    std::size_t around = 0);

}  // namespace ocisac
