// The spectrum of a picture's columns with the tone fitted in it.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/tones/tone_gain.hpp"

namespace ocisac {

// Amplitude over mean at (0 … 2·rows)/(4·rows) cycles per row, of `signal` (rows) with a Hann window, which suppresses
// leakage of the mean, and zeros up to four times the length, which interpolate peaks. A full-depth cosine at one of
// these frequencies gives 1. A mean of 0 or below counts as 1.
std::vector<double> amplitude_spectrum(std::span<const double> signal);

// Unknown numbers are NaN.
struct ToneSpectrum {
  double frequency, frequency_std;          // Hz; no standard error for a given frequency
  double gain, gain_std, phase, mean, snr;  // of the pooled columns, as of tone_gain
  std::size_t columns;                      // that show the tone
  Flags flags;
  std::vector<double> column;     // (rows) their mean, linear light, DN above dark
  std::vector<double> amplitude;  // (2·rows + 1) its amplitude_spectrum over the full-depth ratio of the waveform
};

// `frame`: one picture. `frequency`: Hz; absent: estimated.
ToneSpectrum tone_spectrum(const AnyFramesView& frame, const Camera& camera, std::optional<double> frequency = {},
                           const ToneGainOptions& options = {});

}  // namespace ocisac
