// Texture about a tone, in what a fit of the tone leaves: it stands still from frame to frame, and its spectrum falls
// with the square of the frequency (Field 1987) or is flat there.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/levels.hpp"

namespace ocisac {

// Powers are those of a row: a sum of squares over the number of squares.
struct Texture {
  double white = 0;              // of the noise
  double flat = 0, falling = 0;  // of texture at the tone, if its spectrum is flat there, or falls
  double odds = 0;               // probability that it falls
  std::size_t lines = 0;         // of the spectrum that tell it; 0: it does not exceed the noise

  [[nodiscard]] double power() const { return odds > kNearlyAll ? falling : flat; }
  // Probability that noise and texture have these powers at harmonics of these orders, or more in sum over the expected
  // ones: k exponential variates over a mean that is known from `lines` others. 0 without texture.
  [[nodiscard]] double chance(std::span<const double> powers, std::span<const std::size_t> orders) const;
};

// Texture is seen half-way between the harmonics of the tone, or a part of that, up to 8 cycles apart. `residuals`:
// (signals × rows). The first looks at each signal, the second at the mean of their spectra.
std::vector<Texture> textures_about(double frequency, std::span<const double> residuals, std::size_t rows);
Texture texture_about(double frequency, std::span<const double> residuals, std::size_t rows);

// Number of harmonics that a fit has to take off before, since they leak to where texture is seen.
std::size_t orders_about(double frequency, std::size_t rows);

}  // namespace ocisac
