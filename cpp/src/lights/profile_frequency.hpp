// Frequency of a light's profile along the rows.
#pragma once

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/tones/periodic_fit.hpp"

namespace ocisac {

// Newton's step to the maximum of an energy of the frequency, by differences: at most a quarter of a cycle over the
// rows, uphill where the curvature has the wrong sign.
struct Peak {
  double step;
  double curvature;  // −d²/df²
};

inline double longest_step(double rows) { return 0.25 / rows; }

template <class Energy>
Peak peak_near(double frequency, double rows, const Energy& energy) {
  const double apart = 0.02 / rows, longest = longest_step(rows);
  const double below = energy(frequency - apart, kComparedHarmonics),
               above = energy(frequency + apart, kComparedHarmonics);
  const double bend = 2 * energy(frequency, kComparedHarmonics) - below - above, slope = 0.5 * apart * (above - below);
  return {bend > 0 ? std::clamp(slope / bend, -longest, longest) : std::copysign(longest, slope),
          bend / (apart * apart)};
}

// Frequency in [lower, upper] that maximises energy(frequency, harmonics) of kComparedHarmonics harmonics: ascends from
// the peak of the fundamental on a grid of 1/8 cycle over the rows.
template <class Energy>
double strongest_frequency(double lower, double upper, double rows, const Energy& energy) {
  const double step = 0.125 / rows;
  const auto count = static_cast<std::size_t>((upper - lower) / step) + 1;
  double best = lower, most = -1;
  for (std::size_t i = 0; i <= count; ++i) {
    const double frequency = std::min(lower + static_cast<double>(i) * step, upper);
    const double own = energy(frequency, 1);
    if (own > most) most = own, best = frequency;
  }
  for (int k = 0; lower < best && best < upper && k < kMaxIterations; ++k) {
    const double last = best;
    best = std::clamp(best + peak_near(best, rows, energy).step, lower, upper);
    if (std::abs(best - last) < 1e-6 / rows) break;
  }
  return best;
}

// Standard error of the frequency by a delete-a-group jackknife (Efron and Stein 1981): without(begin, end) is the
// energy without these of `rows` rows. At most 16 groups, each of whole ones of `cycles`; `steps`: to a peak without
// one, which no step reaches that is as long as allowed: the frequency is then known to that length at best.
template <class Without>
double jackknife_std(double frequency, std::size_t rows, double cycles, int steps, const Without& without) {
  const auto groups = std::clamp<std::size_t>(static_cast<std::size_t>(cycles), 2, 16);
  std::vector<double> found(groups, frequency);
  double least = 0;
  for (std::size_t k = 0; k < groups; ++k) {
    const auto left = without(k * rows / groups, (k + 1) * rows / groups);
    double last = 0;
    for (int step = 0; step < steps; ++step)
      found[k] += last = peak_near(found[k], static_cast<double>(rows), left).step;
    if (std::abs(last) >= longest_step(static_cast<double>(rows))) least = std::abs(last);
  }
  const auto count = static_cast<double>(groups);
  return std::max(least, std::sqrt(squares_about_mean(found) * (count - 1) / count));
}

// The same by the energy of the harmonics below half a cycle per row in `profile`.
double strongest_frequency(std::span<const double> profile, double lower, double upper);
double jackknife_std(std::span<const double> profile, double frequency, double cycles);

// Error of the frequency of a profile by its phase, which bends where rows are moved (bend_of_phase), and by
// harmonics that fold beside own ones (fold_error). `margin`: cycles at either end that bends are looked for without.
struct SystematicError {
  double std = 0;        // cycles per row
  bool doubted = false;  // a frequency more than a cycle apart explains more of the profile
};
SystematicError systematic_error(std::span<const double> profile, double frequency, double margin = 0);

// Σ_n x(n)·e^(−j2πf(first + n)).
std::complex<double> component_at(std::span<const double> profile, double frequency, std::size_t first_row = 0);

// Phase at row 0 of the picture, rad, of the tone in `profile`, whose first row is the picture's `first_row`.
double phase_at_start(std::span<const double> profile, double frequency, std::size_t first_row);

}  // namespace ocisac
