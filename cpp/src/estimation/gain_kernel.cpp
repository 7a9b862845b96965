#include "estimation/gain_kernel.hpp"

#include <algorithm>
#include <numbers>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "estimation/gain_kernel.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr double kWeak = 3;                   // standard errors
constexpr double kRounding = 1e-9;            // contrast below which a steady column differs from 0 by rounding alone
constexpr double kRoundingOfSquares = 1e-14;  // of a column's sum of squares

const hn::ScalableTag<double> d64;
using Vector = hn::Vec<decltype(d64)>;

HWY_INLINE Vector constant(double value) { return hn::Set(d64, value); }

// start + row·values, values one vector of columns each.
HWY_INLINE Vector product(Vector start, const double* HWY_RESTRICT row, const double* HWY_RESTRICT values,
                          std::size_t size, std::size_t stride) {
  Vector sum = start;
  for (std::size_t j = 0; j < size; ++j)
    sum = hn::Add(sum, hn::Mul(constant(row[j]), hn::LoadU(d64, values + j * stride)));
  return sum;
}

// One vector of columns.
HWY_INLINE void solve_columns(const FitSums& fit, const double* HWY_RESTRICT totals, const double* HWY_RESTRICT sums,
                              const double* HWY_RESTRICT squares, std::size_t stride, double* HWY_RESTRICT parameters,
                              double* HWY_RESTRICT noise) {
  const std::size_t size = fit.estimates;
  const Vector total = hn::LoadU(d64, totals);
  for (std::size_t i = 0; i < size; ++i) {
    const double* row = fit.transform + i * size;
    hn::StoreU(product(hn::Mul(constant(*row), total), row + 1, sums, size - 1, stride), d64, parameters + i * stride);
  }
  const Vector all = hn::LoadU(d64, squares);
  Vector rest = all;
  for (std::size_t i = 0; i < size; ++i)
    rest = hn::Sub(rest, hn::Mul(hn::LoadU(d64, parameters + i * stride),
                                 product(hn::Zero(d64), fit.gram + i * size, parameters, size, stride)));
  const auto more_than_rounding = hn::Gt(rest, hn::Mul(constant(kRoundingOfSquares), all));
  hn::StoreU(hn::IfThenElseZero(more_than_rounding, hn::Div(rest, constant(fit.freedom))), d64, noise);
}

void ParametersOfSums(const FitSums& fit, double* parameters, double* noise_variance) {
  const std::size_t lanes = hn::Lanes(d64);
  std::size_t c = 0;
  for (; c + lanes <= fit.count; c += lanes)
    solve_columns(fit, fit.totals + c, fit.sums + c, fit.squares + c, fit.count, parameters + c, noise_variance + c);
  if (c == fit.count) return;
  // What is left, in padded copies.
  const std::size_t rest = fit.count - c;
  std::vector<double> padded(2 * (fit.estimates + 1) * lanes);
  double* sums = padded.data();  // the totals first
  double* squares = sums + fit.estimates * lanes;
  double* result = squares + lanes;
  double* noise = result + fit.estimates * lanes;
  std::copy_n(fit.totals + c, rest, sums);
  for (std::size_t i = 1; i < fit.estimates; ++i)
    std::copy_n(fit.sums + (i - 1) * fit.count + c, rest, sums + i * lanes);
  std::copy_n(fit.squares + c, rest, squares);
  solve_columns(fit, sums, sums + lanes, squares, lanes, result, noise);
  for (std::size_t i = 0; i < fit.estimates; ++i) std::copy_n(result + i * lanes, rest, parameters + i * fit.count + c);
  std::copy_n(noise, rest, noise_variance + c);
}

// NaN stays NaN.
HWY_INLINE Vector not_negative(Vector v) { return hn::IfThenElse(hn::Lt(v, hn::Zero(d64)), hn::Zero(d64), v); }

// Of (0, 0): 0.
HWY_INLINE Vector arc_tangent(Vector y, Vector x) {
  const auto zero = hn::Zero(d64);
  const Vector acute = hn::IfThenZeroElse(hn::Eq(y, zero), hn::Atan(d64, hn::Div(hn::Abs(y), hn::Abs(x))));
  return hn::CopySign(hn::IfThenElse(hn::Lt(x, zero), hn::Sub(constant(std::numbers::pi), acute), acute), y);
}

// Into (−π, π].
HWY_INLINE Vector wrapped(Vector phase) {
  const Vector turn = constant(2 * std::numbers::pi);
  const Vector rest = hn::Sub(phase, hn::Mul(turn, hn::Round(hn::Mul(phase, constant(0.5 / std::numbers::pi)))));
  return hn::IfThenElse(hn::Le(rest, constant(-std::numbers::pi)), hn::Add(rest, turn), rest);
}

struct Inputs {
  Vector mean, cosine, sine, noise;
};

struct Outputs {
  Vector gain, gain_std, phase, snr, weak;
};

HWY_INLINE Outputs gains(const Inputs& in, const FittedTone& fit) {
  const Vector power = hn::Add(hn::Mul(in.cosine, in.cosine), hn::Mul(in.sine, in.sine));
  const auto some_power = hn::Gt(power, hn::Zero(d64));
  const Vector share_cosine = hn::IfThenElse(some_power, hn::Div(hn::Mul(in.cosine, in.cosine), power), constant(0.5));
  const Vector share_sine = hn::Sub(constant(1), share_cosine);
  const Vector variance_cosine = hn::Mul(in.noise, constant(fit.variance_cosine));
  const Vector variance_sine = hn::Mul(in.noise, constant(fit.variance_sine));
  const Vector radial = hn::Add(hn::Mul(share_cosine, variance_cosine), hn::Mul(share_sine, variance_sine));
  const Vector tangential = hn::Add(hn::Mul(share_sine, variance_cosine), hn::Mul(share_cosine, variance_sine));
  // Noise across the phasor lengthens it: E|z|² = A² + radial + tangential, and E|z| − A = tangential/(2A).
  const Vector amplitude = hn::Sqrt(not_negative(hn::Sub(power, tangential)));
  const Vector contrast = hn::Div(amplitude, in.mean);
  // The ratio's error by its first derivatives.
  const Vector covariance =
      hn::Mul(hn::Mul(in.noise, constant(fit.covariance_mean_cosine)), hn::CopySign(hn::Sqrt(share_cosine), in.cosine));
  const Vector of_mean = hn::Mul(hn::Mul(contrast, contrast), hn::Mul(in.noise, constant(fit.variance_mean)));
  const Vector variance = hn::Add(hn::Sub(radial, hn::Mul(hn::Mul(constant(2), contrast), covariance)), of_mean);
  const Vector level = hn::Mul(amplitude, constant(1 / fit.full_depth_ratio));  // G·C
  const Vector rounding = hn::Mul(constant(kRounding), in.mean);
  const auto is_weak =
      hn::Or(hn::Lt(power, hn::Mul(constant(kWeak * kWeak), radial)), hn::Le(power, hn::Mul(rounding, rounding)));
  return {hn::Mul(contrast, constant(1 / fit.full_depth_ratio)),
          hn::Div(hn::Sqrt(not_negative(variance)), hn::Mul(in.mean, constant(fit.full_depth_ratio))),
          wrapped(hn::Add(constant(fit.phase_at_zero), arc_tangent(hn::Neg(in.sine), in.cosine))),
          hn::Div(hn::Mul(level, level), in.noise), hn::IfThenElseZero(is_weak, constant(1))};
}

void GainsOfFit(const FittedTone& fit, const GainOutputs& out) {
  const std::size_t lanes = hn::Lanes(d64);
  std::size_t i = 0;
  for (; i + lanes <= fit.count; i += lanes) {
    const Outputs result = gains({hn::LoadU(d64, fit.mean + i), hn::LoadU(d64, fit.cosine + i),
                                  hn::LoadU(d64, fit.sine + i), hn::LoadU(d64, fit.noise_variance + i)},
                                 fit);
    hn::StoreU(result.gain, d64, out.gain + i);
    hn::StoreU(result.gain_std, d64, out.gain_std + i);
    hn::StoreU(result.phase, d64, out.phase + i);
    hn::StoreU(result.snr, d64, out.snr + i);
    hn::StoreU(result.weak, d64, out.weak + i);
  }
  // What is left, one column in all lanes: the same numbers as in a full vector.
  for (; i < fit.count; ++i) {
    const Outputs result = gains(
        {constant(fit.mean[i]), constant(fit.cosine[i]), constant(fit.sine[i]), constant(fit.noise_variance[i])}, fit);
    out.gain[i] = hn::GetLane(result.gain);
    out.gain_std[i] = hn::GetLane(result.gain_std);
    out.phase[i] = hn::GetLane(result.phase);
    out.snr[i] = hn::GetLane(result.snr);
    out.weak[i] = hn::GetLane(result.weak);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(ParametersOfSums);
HWY_EXPORT(GainsOfFit);

void parameters_of_sums(const FitSums& fit, double* parameters, double* noise_variance) {
  HWY_DYNAMIC_DISPATCH(ParametersOfSums)(fit, parameters, noise_variance);
}

void gains_of_fit(const FittedTone& fit, const GainOutputs& out) { HWY_DYNAMIC_DISPATCH(GainsOfFit)(fit, out); }

}  // namespace ocisac::kernels
#endif
