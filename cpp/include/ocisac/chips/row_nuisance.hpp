// Variation along the rows other than a light's chips: slow light such as mains hum, and tones of other lamps.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/rows/tone_search.hpp"

namespace ocisac {

// Model of row n, without noise:
//
//   y_n = constant + Σ_k a_k·cos(πk(n + ½)/rows) + Σ_tone Σ_h (b·cos 2πhfn + c·sin 2πhfn) + (u + v·x + w·x²)·s_n +
//   a·before_n
//
// k up to 2·rows·slow, at most 160: light that varies more slowly than `slow`; h = 1 … tone_harmonics below half a
// cycle per row; s_n: the exposed chips, where known, with a swing that varies along the frame, x = −1 … 1.
struct RowNuisance {
  double slow = 0;              // cycles per row; 0: none
  std::vector<double> tones{};  // cycles per row
  // (rows) q_n, by which slow light and tones are multiplied; empty: 1. Rows of a lamp are divided by its profile, the
  // light of other lamps beside it has none.
  std::vector<double> scale{};
  std::size_t harmonics = 1;     // h of each tone that are fitted while the chips are unknown
  std::vector<double> before{};  // (rows) of the frame before, a share of which is seen, of mean 0; empty: none

  [[nodiscard]] bool empty() const { return slow == 0 && tones.empty() && before.empty(); }
};

// Beside known chips. 3 of 44 random lamps' PWM leave more than noise in 74 % of the frames, 7 in 28 %; rectified
// mains, of which more than one is fitted before, needs 12.
inline std::size_t tone_harmonics(const RowNuisance& nuisance) { return nuisance.harmonics > 1 ? 12 : 7; }

struct NuisanceFit {
  std::vector<double> rest;    // (rows) the signal minus slow light and tones
  double residual_energy = 0;  // sum of squares of what the whole model leaves
  std::size_t unknowns = 0;    // coefficients of slow light, tones and the frame before
  // (tones) cycles per row, for known chips: the step of a Gauss–Newton iteration of each frequency.
  std::vector<double> tone_steps{};
  double moved_by_steps = 0;  // root mean square of the change of the rows by these steps
};

// Least squares; `exposed`: s_n, empty for unknown chips. Then only the first harmonics are fitted, since each term
// also removes a part of the chips. Absent where the rows do not determine it.
std::optional<NuisanceFit> remove_nuisance(std::span<const double> signal, const RowNuisance& nuisance,
                                           std::span<const double> exposed = {});

// The signal minus a square wave of duty ½, exposed for `exposure_rows`, near this frequency (cycles per row, accurate
// to half a spectral line of the frame), with the frequency and phase of the smallest residual.
std::vector<double> without_square_wave(std::span<const double> signal, double frequency, double exposure_rows = 0);

}  // namespace ocisac
