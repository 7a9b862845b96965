#include <numbers>

#include "kernel_cases.hpp"
#include "light/waveform_kernels.hpp"

namespace kernel_cases {

namespace {

using ocisac::CycleCounter;
using ocisac::kernels::SquareMeans;
using ocisac::kernels::ToneMeans;

CycleCounter counter() { return {{0.0137, 0}, {{0.25, 0}, 1.5}, {0.1, 0}}; }

double cycles_at(double x) { return 0.0137 * (0.25 + 1.5 * x) + 0.1; }

void add_plain(const ToneMeans& light, const double* x, std::size_t count, double* out) {
  for (std::size_t i = 0; i < count; ++i)
    out[i] += light.level * (1 + light.swing * std::cos(2 * std::numbers::pi * cycles_at(x[i])));
}

// Light of a square wave from cycle 0 on.
double light_until(double cycles, double half_duty) {
  const double since_rise = cycles + half_duty, whole = std::floor(since_rise);
  return whole * 2 * half_duty + std::min(since_rise - whole, 2 * half_duty);
}

void add_plain(const SquareMeans& light, const double* x, std::size_t count, double* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const double end = cycles_at(x[i]);
    out[i] += light.level * (light_until(end, light.half_duty) - light_until(end - light.length, light.half_duty)) /
              light.length;
  }
}

template <class Means>
KernelCase means_case(const std::string& name, const Means& light, std::size_t count) {
  auto x = std::make_shared<Misaligned<double>>(random_rows<double>(1, count, count, 0, 1000));
  const auto run = [=](bool plain, double* out) {
    std::fill_n(out, count, 0.5);
    if (plain) return add_plain(light, x->data(), count, out);
    ocisac::kernels::add_means(light, x->data(), count, out);
  };
  return kernel_case<double>("add_means " + name + ", " + std::to_string(count) + " exposures", 1e-12,
                             {1, count, count}, run, count > 400);
}

void add_cases_of(std::size_t count, std::vector<KernelCase>& cases) {
  cases.push_back(means_case("tone", ToneMeans{counter(), 0.7, 0.8}, count));
  const double duty = 0.3, whole = 2;
  cases.push_back(
      means_case("square wave", SquareMeans{counter(), 0.7, duty / 2, whole + 0.4, 0.4, whole * duty}, count));
}

}  // namespace

std::vector<KernelCase> waveform_cases() {
  std::vector<KernelCase> cases;
  for (const std::size_t count : kLengths) add_cases_of(count, cases);
  add_cases_of(512, cases);
  return cases;
}

}  // namespace kernel_cases
