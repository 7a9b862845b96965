#include <numbers>

#include "kernel_cases.hpp"
#include "tones/gain_kernel.hpp"

namespace kernel_cases {

namespace {

using ocisac::kernels::FitSums;
using ocisac::kernels::FittedTone;
using ocisac::kernels::GainOutputs;

// (estimates + 1 × count): parameters, then noise variances.
void plain_parameters(const FitSums& fit, double* out) {
  for (std::size_t c = 0; c < fit.count; ++c) {
    const auto input = [&](std::size_t j) { return j == 0 ? fit.totals[c] : fit.sums[(j - 1) * fit.stride + c]; };
    double left = fit.squares[c];
    for (std::size_t i = 0; i < fit.estimates; ++i) {
      double parameter = 0;
      for (std::size_t j = 0; j < fit.estimates; ++j) parameter += fit.transform[i * fit.estimates + j] * input(j);
      out[i * fit.count + c] = parameter;
    }
    for (std::size_t i = 0; i < fit.estimates; ++i)
      for (std::size_t j = 0; j < fit.estimates; ++j)
        left -= out[i * fit.count + c] * fit.gram[i * fit.estimates + j] * out[j * fit.count + c];
    out[fit.estimates * fit.count + c] = left / fit.freedom;
  }
}

struct FitInput {
  std::size_t estimates, count, stride;
  Misaligned<double> totals, sums, squares, transform, gram;

  [[nodiscard]] FitSums view() const {
    return {estimates, count, stride, totals.data(), sums.data(), squares.data(), transform.data(), gram.data(), 700};
  }
};

KernelCase parameters_case(std::size_t estimates, std::size_t count) {
  const std::size_t stride = count + 3;
  auto input = std::make_shared<FitInput>(FitInput{
      estimates, count, stride, random_rows<double>(1, count, count, 100),
      random_rows<double>(estimates, count, stride), random_rows<double>(1, count, count, 1e8, 1e3),
      random_rows<double>(estimates, estimates, estimates), random_rows<double>(estimates, estimates, estimates)});
  for (std::size_t i = 0; i < estimates; ++i)  // a Gram matrix is symmetric
    for (std::size_t j = 0; j < i; ++j) input->gram.data()[i * estimates + j] = input->gram.data()[j * estimates + i];
  const auto run = [input](bool plain, double* out) {
    const FitSums fit = input->view();
    if (plain) return plain_parameters(fit, out);
    ocisac::kernels::parameters_of_sums(fit, out, out + fit.estimates * fit.count);
  };
  return kernel_case<double>(
      "parameters_of_sums " + std::to_string(estimates) + " estimates, " + std::to_string(count) + " columns", 1e-12,
      {estimates + 1, count, count}, run, count > 1000);
}

double wrapped(double phase) {
  const double turn = 2 * std::numbers::pi;
  const double rest = phase - turn * std::round(phase / turn);
  return rest <= -std::numbers::pi ? rest + turn : rest;
}

void plain_gains(const FittedTone& fit, const GainOutputs& out) {
  for (std::size_t i = 0; i < fit.count; ++i) {
    const double mean = fit.mean[i], c = fit.cosine[i], s = fit.sine[i], noise = fit.noise_variance[i];
    const double power = c * c + s * s;
    const double towards = power > 0 ? c / std::sqrt(power) : std::sqrt(0.5), share = towards * towards;
    const double radial = share * fit.variance_cosine + (1 - share) * fit.variance_sine;
    const double tangential = (1 - share) * fit.variance_cosine + share * fit.variance_sine;
    const double amplitude = std::sqrt(std::max(power - noise * tangential, 0.0)), contrast = amplitude / mean;
    const double variance = noise * (radial + contrast * contrast * fit.variance_mean -
                                     2 * contrast * towards * fit.covariance_mean_cosine);
    out.gain[i] = contrast / fit.full_depth_ratio;
    out.gain_std[i] = std::sqrt(std::max(variance, 0.0)) / mean / fit.full_depth_ratio;
    out.phase[i] = wrapped(fit.phase_at_zero + std::atan2(-s, c));
    out.mean[i] = mean;
    out.snr[i] = amplitude * amplitude / (fit.full_depth_ratio * fit.full_depth_ratio) / noise;
    const bool weak = power < 9 * noise * radial || power <= 1e-18 * mean * mean;
    out.remark[i] = !(mean > 0) ? ocisac::kernels::kNoLight
                    : weak      ? ocisac::kernels::kWeakTone
                    : noise < 1 ? ocisac::kernels::kLittleNoise
                                : ocisac::kernels::kNothing;
  }
}

struct ToneInput {
  Misaligned<double> mean, cosine, sine, noise;
};

KernelCase gains_case(std::size_t count) {
  auto input = std::make_shared<ToneInput>(
      ToneInput{random_rows<double>(1, count, count, 100, 5), random_rows<double>(1, count, count, 0, 20),
                random_rows<double>(1, count, count, 0, 20), random_rows<double>(1, count, count, 4, 0.5)});
  // Columns with each remark: no tone, little noise, no noise.
  if (count > 2) input->cosine.data()[1] = input->sine.data()[1] = 0;
  if (count > 3) input->noise.data()[2] = 0.25;
  if (count > 4) input->noise.data()[3] = 0;
  const auto run = [input, count](bool plain, double* out) {
    const FittedTone fit{input->mean.data(),
                         input->cosine.data(),
                         input->sine.data(),
                         input->noise.data(),
                         count,
                         0.001,
                         0.002,
                         0.0025,
                         0.0001,
                         0.9,
                         3.0};
    const auto output = [&](std::size_t i) { return out + i * count; };
    const GainOutputs outputs{output(0), output(1), output(2), output(3), output(4), output(5)};
    if (plain) return plain_gains(fit, outputs);
    ocisac::kernels::gains_of_fit(fit, outputs);
  };
  return kernel_case<double>("gains_of_fit " + std::to_string(count) + " columns", 1e-12, {6, count, count}, run,
                             count > 1000);
}

}  // namespace

std::vector<KernelCase> gain_cases() {
  std::vector<KernelCase> cases;
  for (const std::size_t count : kLengths)
    for (const std::size_t estimates : {1u, 3u, 5u}) cases.push_back(parameters_case(estimates, count));
  for (const std::size_t count : kLengths) cases.push_back(gains_case(count));
  cases.push_back(parameters_case(3, 1920));
  cases.push_back(gains_case(1920));
  return cases;
}

}  // namespace kernel_cases
