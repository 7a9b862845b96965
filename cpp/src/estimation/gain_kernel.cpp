#include "estimation/gain_kernel.hpp"

#include <numbers>

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

constexpr double kWeak = 3;         // standard errors
constexpr double kRounding = 1e-9;  // contrast below which a steady column differs from 0 by rounding alone

const hn::ScalableTag<double> d64;
using Vector = hn::Vec<decltype(d64)>;

HWY_INLINE Vector constant(double value) { return hn::Set(d64, value); }

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
  const Vector rest = hn::Sub(phase, hn::Mul(turn, hn::Round(hn::Div(phase, turn))));
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
  const Vector level = hn::Div(amplitude, constant(fit.full_depth_ratio));  // G·C
  const Vector rounding = hn::Mul(constant(kRounding), in.mean);
  const auto is_weak =
      hn::Or(hn::Lt(power, hn::Mul(constant(kWeak * kWeak), radial)), hn::Le(power, hn::Mul(rounding, rounding)));
  return {hn::Div(contrast, constant(fit.full_depth_ratio)),
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

HWY_EXPORT(GainsOfFit);

void gains_of_fit(const FittedTone& fit, const GainOutputs& out) { HWY_DYNAMIC_DISPATCH(GainsOfFit)(fit, out); }

}  // namespace ocisac::kernels
#endif
