// The linear model that all fits of tones share: a slow trend and oscillations of known frequencies.
#pragma once

#include <cstddef>
#include <vector>

namespace ocisac {

// With u = n − (rows − 1)/2 and x = 2u/rows a column is modelled as
//   y(n) = s(x) + Σ_k [a_k(x)·cos(2π ν_k u) + b_k(x)·sin(2π ν_k u)],
// where s is a polynomial of `trend_degree`, a_k and b_k are polynomials of `tone_degree`, all in Legendre's basis.
// Counting u from the middle makes sines and cosines orthogonal.
struct ToneDesign {
  std::size_t rows = 0;
  std::vector<double> cycles_per_row;  // ν_k
  std::size_t trend_degree = 0, tone_degree = 0;

  [[nodiscard]] std::size_t trend_columns() const { return trend_degree + 1; }
  [[nodiscard]] std::size_t columns() const { return trend_columns() + 2 * (tone_degree + 1) * cycles_per_row.size(); }

  // (columns × rows from `first_row` on), dense: the trend's polynomials, then for each oscillation the polynomials
  // times its cosine and times its sine.
  [[nodiscard]] std::vector<double> matrix(std::size_t first_row = 0) const;
};

// cos and sin of 2π·ν·u with the whole cycles taken off exactly before rounding.
struct Phasor {
  double cosine, sine;
};
Phasor phasor(double cycles_per_row, double u);

}  // namespace ocisac
