// Exposure time that maximises the sum of several tones over noise that grows with the exposure.
#pragma once

#include <cstddef>
#include <span>

#include "ocisac/exposure/best_exposure.hpp"

namespace ocisac {

struct WeightedTone {
  double frequency;  // Hz, finite, > 0
  double weight;     // finite, >= 0
};

struct ExposureWindow {
  double low, high;  // s; 0 < low <= high
  double step = 0;   // s; only whole multiples of it; 0: any exposure
};

constexpr std::size_t max_weighted_tones = 32;

// J(T) = Σ w_i·|sin(π f_i T)|/(π f_i) / sqrt(1 + T/T_n): eq. 18 over the noise. Its variance is read noise plus shot
// noise proportional to the collected light; the two are equal at T_n (`noise_exposure`, s, > 0; infinity: eq. 18).
double noisy_exposure_objective(std::span<const WeightedTone> tones, double noise_exposure, double exposure);

// Global maximum of J over the window, to a relative 1e-12 of J, by branch and bound (docs/explanation/exposure.md);
// allocates no memory. Requires 1 to 32 tones, not all of weight 0, at most a million lobes in the window, and at least
// one multiple of the step in it.
BestExposure best_noisy_exposure(std::span<const WeightedTone> tones, double noise_exposure,
                                 const ExposureWindow& window);

}  // namespace ocisac
