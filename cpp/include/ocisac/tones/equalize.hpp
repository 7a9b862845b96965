// Deconvolution of the exposure along columns: from mean light over each exposure to the light at its end.
#pragma once

#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/light/exposure_modulation.hpp"

namespace ocisac {

enum class EqualizerMethod { inverse, wiener };

struct EqualizerSettings {
  EqualizerMethod method = EqualizerMethod::inverse;
  double max_boost = 10;  // maximum gain at any frequency, 1 … 1e6 (20·log10 of it in dB)
  // RMS noise of a row in linear light, for wiener: empty (estimated per column), one value for all columns, or frames
  // × columns values.
  std::span<const double> noise = {};
  int threads = 1;
};

struct EqualizerReport {
  // Hz, the highest to infinity: restored amplitude below 1/2; mean over the columns
  std::vector<Interval> frequencies_lost;
  std::vector<double> noise_gain;  // frames × columns: RMS noise of the output over that of the input
  std::vector<double> noise;       // frames × columns: the RMS noise assumed by wiener; 0 for inverse
};

// Row n of `out` (same shape as `frames`, without overlap) estimates the light at the end of row n's exposure, in
// linear light above dark. Method: docs/explanation/tones.md. Exposures of a whole frame and longer leave the mean.
EqualizerReport equalize(const AnyFramesView& frames, const Camera& camera, const EqualizerSettings& settings,
                         const FramesView<double>& out);
// The same in float32, which keeps 10⁻⁵ of a column's largest light at max_boost 10.
EqualizerReport equalize(const AnyFramesView& frames, const Camera& camera, const EqualizerSettings& settings,
                         const FramesView<float>& out);

// Bands in which the bounded inverse restores less than half of the amplitude: |sinc(f·T_e)| < 1/(√2·max_boost), and
// all frequencies above half the row rate, which alias.
std::vector<Interval> lost_frequencies(const Camera& camera, double max_boost);

}  // namespace ocisac
