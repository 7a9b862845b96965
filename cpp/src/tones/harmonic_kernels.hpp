// Inner products of a signal with many harmonics of one frequency, compiled once for each SIMD target.
#pragma once

#include <cstddef>

namespace ocisac::kernels {

constexpr std::size_t kHarmonicAlignment = 8;  // harmonics: a vector of double of any target
constexpr std::size_t kRowsPerLeap = 16;

// Even and odd parts of a signal, each `step` apart, at `rows` rows at the distances u = first, first + 1, … from the
// middle.
struct SignalParts {
  const double *even, *odd;
  std::size_t step, rows;
  double first;
};

// cos and sin of each harmonic: at `first`, and of the angles to the next row and kRowsPerLeap rows on; (count,) each.
struct Rotations {
  const double *cosine, *sine, *turn_cosine, *turn_sine, *leap_cosine, *leap_sine;
  std::size_t count;  // a multiple of kHarmonicAlignment
};

// (count,) each: Σ even·cos, Σ odd·sin, Σ even·u·sin, Σ odd·u·cos.
struct HarmonicSums {
  double *cosine, *sine, *u_sine, *u_cosine;
};

void harmonic_sums(const SignalParts& signal, const Rotations& harmonics, const HarmonicSums& sums);

}  // namespace ocisac::kernels
