// Gains from the parameters of a fit, for many columns at once; compiled once for each SIMD target.
#pragma once

#include <cstddef>

namespace ocisac::kernels {

// Weighted sums of many columns: totals (count,), sums (estimates − 1 × count, `stride` apart) and squares (count,),
// the sum of a column's squared samples. parameters = transform·(totals, sums), with transform: estimates × estimates.
// noise variance of a row = (squares − parametersᵀ·gram·parameters)/freedom.
struct FitSums {
  std::size_t estimates, count, stride;
  const double *totals, *sums, *squares;
  const double *transform, *gram;
  double freedom;
};

// parameters: (estimates × count), noise_variance: (count,).
void parameters_of_sums(const FitSums& fit, double* parameters, double* noise_variance);

// y ≈ mean + cosine·cos(2πνu) + sine·sin(2πνu), u: row relative to the phase origin.
struct FittedTone {
  const double* mean;            // (count,), of the source's light
  const double* cosine;          // (count,)
  const double* sine;            // (count,)
  const double* noise_variance;  // (count,), of one row
  std::size_t count;
  double variance_mean, variance_cosine, variance_sine, covariance_mean_cosine;  // for noise of variance 1
  double full_depth_ratio;
  double phase_at_zero;  // rad
};

// Remarks on a column that needs further checks, the first that applies: mean not above 0, tone not significant, noise
// variance below 1.
enum Remark { kNothing, kLittleNoise, kWeakTone, kNoLight };

// (count,) each; see ToneGain.
struct GainOutputs {
  double *gain, *gain_std, *phase, *mean, *snr, *remark;
};

// Columns that are fitted and turned into gains together: what they need fits the first-level cache.
inline constexpr std::size_t kColumnsAtOnce = 256;

// Returns whether any column has a remark.
bool gains_of_fit(const FittedTone& fit, const GainOutputs& out);

}  // namespace ocisac::kernels
