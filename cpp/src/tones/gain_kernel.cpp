#include "tones/gain_kernel.hpp"

#include <algorithm>
#include <numbers>

#include "core/aligned_memory.hpp"
#include "core/levels.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tones/gain_kernel.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr double kRoundingOfSquares = 1e-14;  // of a column's sum of squares

const hn::ScalableTag<double> d64;
using Vector = hn::Vec<decltype(d64)>;

HWY_INLINE Vector constant(double value) { return hn::Set(d64, value); }

constexpr std::size_t kAtOnce = 4;  // vectors of columns, which save loads of the matrices

// Solves kAtOnce vectors of columns: `sums` (estimates × width) with the totals first, `squares`, `parameters` and
// `noise` of them, dense. kEstimates: 3 for one tone, or 0: fit.estimates.
template <std::size_t kEstimates>
HWY_INLINE void solve_columns(const FitSums& fit, const double* HWY_RESTRICT sums, const double* HWY_RESTRICT squares,
                              double* HWY_RESTRICT parameters, double* HWY_RESTRICT noise) {
  const std::size_t size = kEstimates ? kEstimates : fit.estimates;
  const std::size_t lanes = hn::Lanes(d64), width = kAtOnce * lanes;
  Vector sum[kAtOnce], rest[kAtOnce];
  for (std::size_t i = 0; i < size; ++i) {
    for (std::size_t v = 0; v < kAtOnce; ++v) sum[v] = hn::Zero(d64);
    for (std::size_t j = 0; j < size; ++j)
      for (std::size_t v = 0; v < kAtOnce; ++v)
        sum[v] =
            hn::MulAdd(constant(fit.transform[i * size + j]), hn::LoadU(d64, sums + j * width + v * lanes), sum[v]);
    for (std::size_t v = 0; v < kAtOnce; ++v) hn::StoreU(sum[v], d64, parameters + i * width + v * lanes);
  }
  for (std::size_t v = 0; v < kAtOnce; ++v) rest[v] = hn::LoadU(d64, squares + v * lanes);
  for (std::size_t i = 0; i < size; ++i) {  // gram is symmetric: off-diagonal entries count twice
    const double* row = fit.gram + i * size;
    for (std::size_t v = 0; v < kAtOnce; ++v) sum[v] = hn::Zero(d64);
    for (std::size_t j = i + 1; j < size; ++j)
      for (std::size_t v = 0; v < kAtOnce; ++v)
        sum[v] = hn::MulAdd(constant(2 * row[j]), hn::LoadU(d64, parameters + j * width + v * lanes), sum[v]);
    for (std::size_t v = 0; v < kAtOnce; ++v) {
      const Vector own = hn::LoadU(d64, parameters + i * width + v * lanes);
      rest[v] = hn::NegMulAdd(own, hn::MulAdd(constant(row[i]), own, sum[v]), rest[v]);
    }
  }
  for (std::size_t v = 0; v < kAtOnce; ++v) {
    const Vector all = hn::LoadU(d64, squares + v * lanes);
    const auto more_than_rounding = hn::Gt(rest[v], hn::Mul(constant(kRoundingOfSquares), all));
    hn::StoreU(hn::IfThenElseZero(more_than_rounding, hn::Mul(rest[v], constant(1 / fit.freedom))), d64,
               noise + v * lanes);
  }
}

// By way of dense copies, padded to whole vectors: rows of a frame of many estimates would displace each other in the
// first-level cache.
template <std::size_t kEstimates>
void parameters_of_estimates(const FitSums& fit, double* parameters, double* noise_variance) {
  thread_local AlignedMemory<double> memory;
  const std::size_t width = kAtOnce * hn::Lanes(d64);
  double* const sums = memory.at_least(2 * (fit.estimates + 1) * width);
  double* const squares = sums + fit.estimates * width;
  double* const solved = squares + width;
  double* const noise = solved + fit.estimates * width;
  std::fill_n(sums, (fit.estimates + 1) * width, 0.0);
  for (std::size_t c = 0; c < fit.count; c += width) {
    const std::size_t here = std::min(width, fit.count - c);
    std::copy_n(fit.totals + c, here, sums);
    for (std::size_t i = 1; i < fit.estimates; ++i)
      std::copy_n(fit.sums + (i - 1) * fit.stride + c, here, sums + i * width);
    std::copy_n(fit.squares + c, here, squares);
    solve_columns<kEstimates>(fit, sums, squares, solved, noise);
    for (std::size_t i = 0; i < fit.estimates; ++i)
      std::copy_n(solved + i * width, here, parameters + i * fit.count + c);
    std::copy_n(noise, here, noise_variance + c);
  }
}

void ParametersOfSums(const FitSums& fit, double* parameters, double* noise_variance) {
  if (fit.estimates == 3) return parameters_of_estimates<3>(fit, parameters, noise_variance);
  parameters_of_estimates<0>(fit, parameters, noise_variance);
}

// NaN stays NaN.
HWY_INLINE Vector not_negative(Vector v) { return hn::IfThenElse(hn::Lt(v, hn::Zero(d64)), hn::Zero(d64), v); }

// Direction of (x, y): the octant's multiple of π/8 nearest to it (rad), the tangent of the rest, and the cosine.
// Cosine and tangent share a division; for (0, 0) the cosine is √½.
HWY_INLINE void find_direction(Vector x, Vector y, Vector& nearest, Vector& tangent, Vector& cosine) {
  constexpr double kOneEighth = 0.41421356237309504880;        // tan(π/8)
  constexpr double kOneSixteenth = 0.19891236737965800691;     // tan(π/16)
  constexpr double kThreeSixteenths = 0.66817863791929891999;  // tan(3π/16)
  const Vector length = hn::Sqrt(hn::MulAdd(x, x, hn::Mul(y, y)));
  const Vector high = hn::Max(hn::Abs(x), hn::Abs(y)), low = hn::Min(hn::Abs(x), hn::Abs(y));
  const auto past_first = hn::Gt(low, hn::Mul(constant(kOneSixteenth), high));
  const auto past_second = hn::Gt(low, hn::Mul(constant(kThreeSixteenths), high));
  const Vector turned = hn::IfThenElse(past_second, constant(1), hn::IfThenElseZero(past_first, constant(kOneEighth)));
  nearest = hn::IfThenElse(past_second, constant(std::numbers::pi / 4),
                           hn::IfThenElseZero(past_first, constant(std::numbers::pi / 8)));
  const Vector beside = hn::NegMulAdd(turned, high, low), along = hn::MulAdd(turned, low, high);
  const Vector reciprocal = hn::Div(constant(1), hn::Mul(along, length));
  tangent = hn::Mul(hn::Mul(beside, length), reciprocal);
  cosine = hn::IfThenElse(hn::Gt(length, hn::Zero(d64)), hn::Mul(hn::Mul(x, along), reciprocal),
                          constant(std::numbers::sqrt2 / 2));
}

// Angle of (x, y) in (−π, π], 0 for (0, 0). t is at most tan(π/16), where eleven terms of t − t³/3 + t⁵/5 − … have an
// error of 2·10⁻¹⁷.
HWY_INLINE Vector angle_of(Vector x, Vector y, Vector nearest, Vector t) {
  const Vector zero = hn::Zero(d64);
  const Vector square = hn::Mul(t, t), fourth = hn::Mul(square, square);
  // Positive and negative terms in separate sums, which are independent.
  Vector added = constant(1.0 / 21), taken_off = constant(1.0 / 19);
  for (int n = 17; n > 0; n -= 4) added = hn::MulAdd(added, fourth, constant(1.0 / n));
  for (int n = 15; n > 0; n -= 4) taken_off = hn::MulAdd(taken_off, fourth, constant(1.0 / n));
  const Vector series = hn::NegMulAdd(square, taken_off, added);
  const Vector octant = hn::MulAdd(t, series, nearest);
  const Vector steep = hn::Sub(constant(std::numbers::pi / 2), octant);
  const Vector acute =
      hn::IfThenZeroElse(hn::Eq(y, zero), hn::IfThenElse(hn::Gt(hn::Abs(y), hn::Abs(x)), steep, octant));
  return hn::CopySign(hn::IfThenElse(hn::Lt(x, zero), hn::Sub(constant(std::numbers::pi), acute), acute), y);
}

// Into (−π, π].
HWY_INLINE Vector wrapped(Vector phase) {
  const Vector turn = constant(2 * std::numbers::pi);
  const Vector rest = hn::Sub(phase, hn::Mul(turn, hn::Round(hn::Mul(phase, constant(0.5 / std::numbers::pi)))));
  return hn::IfThenElse(hn::Le(rest, constant(-std::numbers::pi)), hn::Add(rest, turn), rest);
}

// The last vector of the columns overlaps its neighbour. Copies of the arguments, which no output can overwrite: they
// are read once.
bool write_gains(const FittedTone fit, const GainOutputs out) {
  const std::size_t lanes = hn::Lanes(d64), last = fit.count - lanes;
  const Vector at_zero = constant(fit.phase_at_zero);
  const double per_depth = 1 / fit.full_depth_ratio;
  Vector remarks = hn::Zero(d64);
  for (std::size_t c = 0; c < fit.count; c += lanes) {
    const std::size_t i = std::min(c, last);
    const Vector mean = hn::LoadU(d64, fit.mean + i), variance_of_row = hn::LoadU(d64, fit.noise_variance + i);
    const Vector cosine = hn::LoadU(d64, fit.cosine + i), sine = hn::LoadU(d64, fit.sine + i);
    Vector nearest, tangent, direction;  // its cosine
    find_direction(cosine, hn::Neg(sine), nearest, tangent, direction);
    const Vector power = hn::MulAdd(cosine, cosine, hn::Mul(sine, sine));
    const Vector share_cosine = hn::Mul(direction, direction);
    const Vector share_sine = hn::Sub(constant(1), share_cosine);
    const Vector radial =
        hn::MulAdd(share_cosine, constant(fit.variance_cosine), hn::Mul(share_sine, constant(fit.variance_sine)));
    const Vector tangential =
        hn::MulAdd(share_sine, constant(fit.variance_cosine), hn::Mul(share_cosine, constant(fit.variance_sine)));
    // Noise biases the length: E|z|² = A² + radial + tangential, and E|z| − A = tangential/(2A).
    const Vector amplitude = hn::Sqrt(not_negative(hn::NegMulAdd(variance_of_row, tangential, power)));
    const auto noiseless = hn::Eq(variance_of_row, hn::Zero(d64));
    const Vector noise = hn::IfThenElse(noiseless, constant(1), variance_of_row);
    const Vector reciprocal = hn::Div(constant(1), hn::Mul(mean, noise));  // of both
    const Vector per_mean = hn::Mul(noise, reciprocal);
    const Vector per_noise = hn::IfThenElse(noiseless, hn::Inf(d64), hn::Mul(mean, reciprocal));
    const Vector contrast = hn::Mul(amplitude, per_mean);
    // First-order propagation of the ratio's error.
    const Vector of_mean = hn::MulAdd(contrast, constant(fit.variance_mean),
                                      hn::Mul(direction, constant(-2 * fit.covariance_mean_cosine)));
    const Vector variance = hn::Mul(variance_of_row, hn::MulAdd(contrast, of_mean, radial));
    const Vector level = hn::Mul(amplitude, constant(per_depth));  // G·C
    const Vector rounding = hn::Mul(constant(kEqual), mean);
    const auto weak = hn::Or(hn::Lt(power, hn::Mul(hn::Mul(constant(kWeak * kWeak), variance_of_row), radial)),
                             hn::Le(power, hn::Mul(rounding, rounding)));
    const Vector per_full_mean = hn::Mul(per_mean, constant(per_depth));
    const Vector remark =
        hn::IfThenElse(hn::Gt(mean, hn::Zero(d64)),
                       hn::IfThenElse(weak, constant(kWeakTone),
                                      hn::IfThenElseZero(hn::Lt(variance_of_row, constant(1)), constant(kLittleNoise))),
                       constant(kNoLight));
    hn::StoreU(wrapped(hn::Add(at_zero, angle_of(cosine, hn::Neg(sine), nearest, tangent))), d64, out.phase + i);
    hn::StoreU(hn::Mul(amplitude, per_full_mean), d64, out.gain + i);
    hn::StoreU(hn::Mul(hn::Sqrt(not_negative(variance)), per_full_mean), d64, out.gain_std + i);
    hn::StoreU(mean, d64, out.mean + i);
    hn::StoreU(hn::Mul(hn::Mul(level, level), per_noise), d64, out.snr + i);
    hn::StoreU(remark, d64, out.remark + i);
    remarks = hn::Max(remarks, remark);
  }
  return !hn::AllTrue(d64, hn::Eq(remarks, hn::Zero(d64)));
}

// Fewer columns than a vector has lanes, by way of padded copies.
bool gains_of_few(FittedTone fit, const GainOutputs& out) {
  const std::size_t count = fit.count;
  double in[4][hn::MaxLanes(d64)], padded[6][hn::MaxLanes(d64)];
  const auto pad = [&](const double*& values, double* to) {
    std::fill(std::copy_n(values, count, to), to + hn::Lanes(d64), values[0]);
    values = to;
  };
  pad(fit.mean, in[0]);
  pad(fit.cosine, in[1]);
  pad(fit.sine, in[2]);
  pad(fit.noise_variance, in[3]);
  fit.count = hn::Lanes(d64);
  const bool any = write_gains(fit, {padded[0], padded[1], padded[2], padded[3], padded[4], padded[5]});
  double* const to[] = {out.gain, out.gain_std, out.phase, out.mean, out.snr, out.remark};
  for (std::size_t i = 0; i < 6; ++i) std::copy_n(padded[i], count, to[i]);
  return any;
}

bool GainsOfFit(const FittedTone& fit, const GainOutputs& out) {
  if (fit.count >= hn::Lanes(d64)) return write_gains(fit, out);
  return fit.count > 0 && gains_of_few(fit, out);
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

bool gains_of_fit(const FittedTone& fit, const GainOutputs& out) { return HWY_DYNAMIC_DISPATCH(GainsOfFit)(fit, out); }

}  // namespace ocisac::kernels
#endif
