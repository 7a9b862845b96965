// From a fit's parameters to gains, for many columns at once; compiled once for each SIMD target.
#pragma once

#include <cstddef>

namespace ocisac::kernels {

// What a fit's weights made of many columns: totals (count,), sums (estimates − 1 × count, `stride` apart) and squares
// (count,), the sum of a column's squared samples. The parameters are transform·(totals, sums) (transform: estimates ×
// estimates), and what they leave of the squares, parametersᵀ·gram·parameters taken off, over `freedom` is the variance
// of a row's noise.
struct FitSums {
  std::size_t estimates, count, stride;
  const double *totals, *sums, *squares;
  const double *transform, *gram;
  double freedom;
};

// parameters: (estimates × count), noise_variance: (count,).
void parameters_of_sums(const FitSums& fit, double* parameters, double* noise_variance);

// y ≈ mean + cosine·cos(2πνu) + sine·sin(2πνu), u: row from the point that phases are counted from.
struct FittedTone {
  const double* mean;            // (count,), of the source's own light
  const double* cosine;          // (count,)
  const double* sine;            // (count,)
  const double* noise_variance;  // (count,), of one row
  std::size_t count;
  double variance_mean, variance_cosine, variance_sine, covariance_mean_cosine;  // for noise of variance 1
  double full_depth_ratio;
  double phase_at_zero;  // rad
};

// What a column's gain needs a look for: a mean that is not above 0, a tone that is not told from nothing, or a noise
// variance below 1, the first that holds.
constexpr double kNothing = 0, kLittleNoise = 1, kWeakTone = 2, kNoLight = 3;

// (count,) each; see ToneGain.
struct GainOutputs {
  double *gain, *gain_std, *phase, *snr, *remark;
};

// Whether any column has a remark.
bool gains_of_fit(const FittedTone& fit, const GainOutputs& out);

}  // namespace ocisac::kernels
