// Sums over the rows of powers times harmonics, in closed form.
#pragma once

#include <cstddef>
#include <vector>

namespace ocisac {

// M(p, k) = Σ_u v^p·cos(2πkfu) for even p, Σ_u v^p·sin(2πkfu) for odd p, over the rows' distances u from the middle of
// the column, v = 2u/rows. They are derivatives of sin(rows·x/2)/sin(x/2) = Σ_u cos(xu) at x = 2πkf; near whole kf,
// where these lose digits, plain sums.
class RowMoments {
 public:
  // frequency: f in cycles per row; k up to `highest`, p up to `power`, at most 4.
  RowMoments(std::size_t rows, double frequency, std::size_t highest, std::size_t power);

  // |k| ≤ highest; odd in k for odd p.
  [[nodiscard]] double at(std::size_t power, int harmonic) const {
    const double value = values_[static_cast<std::size_t>(harmonic < 0 ? -harmonic : harmonic) * powers_ + power];
    return harmonic < 0 && power % 2 == 1 ? -value : value;
  }

 private:
  std::size_t powers_;
  std::vector<double> values_;  // (highest + 1 × powers)
};

}  // namespace ocisac
