#include "ocisac/tones/tone_design.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ocisac {

Phasor phasor(double cycles_per_row, double u) {
  const double product = cycles_per_row * u;
  const double rest = std::fma(cycles_per_row, u, -product);
  const double cycles = (product - std::nearbyint(product)) + rest;
  return {std::cos(2 * std::numbers::pi * cycles), std::sin(2 * std::numbers::pi * cycles)};
}

// d·L_d = (2d − 1)·x·L_{d−1} − (d − 1)·L_{d−2}
void legendre(double x, std::span<double> values) {
  for (std::size_t d = 0; d < values.size(); ++d) {
    const auto degree = static_cast<double>(d);
    values[d] = d == 0   ? 1
                : d == 1 ? x
                         : ((2 * degree - 1) * x * values[d - 1] - (degree - 1) * values[d - 2]) / degree;
  }
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
