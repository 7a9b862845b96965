// Exposure time that maximises the sum of several tones (section 4 of the paper).
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "ocisac/light/exposure_modulation.hpp"

namespace ocisac {

struct BestExposure {
  double exposure;   // s
  double objective;  // Y(exposure), s
};

inline constexpr double kMostCandidates = 1e7;  // lobes, multiples of a step or points of a search

// Search domain. Without bounds: (0, 1/f] with f the smallest of the frequencies.
struct ExposureDomain {
  std::optional<Interval> bounds;  // s; 0 <= low <= high, high > 0; an exposure of 0 itself is never chosen
  std::optional<double> step;      // s, > 0: only whole multiples of it
};

// Y(T) = Σ w_i·|sin(π f_i T)|/(π f_i), eq. 18 with magnitudes; full precision also near the zeros of the sines. The
// functions below require frequencies (Hz, finite, > 0) and as many weights (finite, >= 0, not all 0), and throw
// std::invalid_argument otherwise. Among equal maxima they return the shortest exposure.
double exposure_objective(std::span<const double> frequencies, std::span<const double> weights, double exposure);

// Maximum for two tones over (0, 1/min(f_1, f_2)], in constant time.
BestExposure best_exposure_exact(double f_1, double f_2, double w_1 = 1, double w_2 = 1);

// Maximum for any number of tones and any domain, lobe by lobe between zeros (docs/explanation/exposure.md).
// Throws for more than 10 million lobes; with a step, for more than 10 million lobes or multiples, whichever are fewer.
BestExposure best_exposure_exact(std::span<const double> frequencies, std::span<const double> weights,
                                 const ExposureDomain& domain);

// Many problems at once. `frequencies`: (problems × tones), `weights`: (tones). `exposures` and `objectives`:
// (problems).
//   exact        as above; two tones without bounds or step in constant time
//   closed_form  the paper's algorithm (eqs. 19–23) for two tones without bounds or step: T = (γ + 1/2)/f_max with
//                γ = max(⌊ε/2 − 1/2⌋, 0), ε = f_max/f_min; the weights affect the objective only
//   rounded      the same with γ = ⌊ε/2⌋, the nearest whole number to ε/2 − 1/2
//   search       the best of `points` equally spaced exposures that include both ends of the domain (2 to 10 million),
//                or of all multiples of the step
enum class ExposureMethod { exact, closed_form, rounded, search };
void best_exposures(std::span<const double> frequencies, std::span<const double> weights, ExposureMethod method,
                    const ExposureDomain& domain, std::size_t points, std::span<double> exposures,
                    std::span<double> objectives);

struct WeightedTone {
  double frequency;  // Hz, finite, > 0
  double weight;     // finite, >= 0
};

struct ExposureWindow {
  double low, high;  // s; 0 < low <= high
  double step = 0;   // s; only whole multiples of it; 0: any exposure
};

constexpr std::size_t kMaxWeightedTones = 32;

// J(T) = Σ w_i·|sin(π f_i T)|/(π f_i) / sqrt(1 + T/T_n): eq. 18 over the noise. Its variance is read noise plus shot
// noise proportional to the collected light; the two are equal at T_n (`noise_exposure`, s, > 0; infinity: eq. 18).
double noisy_exposure_objective(std::span<const WeightedTone> tones, double noise_exposure, double exposure);

// Global maximum of J over the window, to a relative 1e-12 of J, by branch and bound (docs/explanation/exposure.md);
// allocates no memory. Requires 1 to 32 tones, not all of weight 0, at most 10 million lobes in the window, and at
// least one multiple of the step in it.
BestExposure best_noisy_exposure(std::span<const WeightedTone> tones, double noise_exposure,
                                 const ExposureWindow& window);

}  // namespace ocisac
