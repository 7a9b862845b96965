#include "ocisac/tones/tone_design.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

#include "core/legendre.hpp"

namespace ocisac {

Phasor phasor(double cycles_per_row, double u) {
  const double product = cycles_per_row * u;
  const double rest = std::fma(cycles_per_row, u, -product);
  const double cycles = (product - std::nearbyint(product)) + rest;
  return {std::cos(2 * std::numbers::pi * cycles), std::sin(2 * std::numbers::pi * cycles)};
}

std::vector<double> ToneDesign::matrix(std::size_t first_row) const {
  const std::size_t height = rows - first_row;
  const auto u = [&](std::size_t i) {
    return static_cast<double>(first_row + i) - (static_cast<double>(rows) - 1) / 2;
  };
  std::vector<double> matrix(columns() * height);
  const auto column = [&](std::size_t index) { return std::span(matrix).subspan(index * height, height); };

  std::vector<double> polynomials(std::max(trend_degree, tone_degree) + 1);
  for (std::size_t i = 0; i < height; ++i) {
    legendre(2 * u(i) / static_cast<double>(rows), polynomials);
    for (std::size_t d = 0; d < trend_columns(); ++d) column(d)[i] = polynomials[d];
    std::size_t next = trend_columns();
    for (const double cycles : cycles_per_row) {
      const Phasor at = phasor(cycles, u(i));
      for (std::size_t d = 0; d <= tone_degree; ++d) column(next++)[i] = at.cosine * polynomials[d];
      for (std::size_t d = 0; d <= tone_degree; ++d) column(next++)[i] = at.sine * polynomials[d];
    }
  }
  return matrix;
}

}  // namespace ocisac
