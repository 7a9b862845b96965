// One list of kernels: each case runs a kernel on the current SIMD target and compares it with its plain loop.
// test_kernels.cpp runs it on every target, bench/kernels.cpp times it. A new kernel needs one more function here.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace kernel_cases {

struct KernelCase {
  std::string name;           // kernel and variant
  std::function<void()> run;  // the kernel alone, for timing; empty: not timed
  // From the plain loop, relative to the largest magnitude; infinite for writes out of bounds.
  std::function<double()> deviation;
  double tolerance;
};

std::vector<KernelCase> projection_cases();
std::vector<KernelCase> gain_cases();
std::vector<KernelCase> screening_cases();
std::vector<KernelCase> refinement_cases();
std::vector<KernelCase> equalizer_cases();
std::vector<KernelCase> column_dft_cases();
std::vector<KernelCase> waveform_cases();
std::vector<KernelCase> sequence_cases();
std::vector<KernelCase> channel_cases();
std::vector<KernelCase> frequency_cases();
std::vector<KernelCase> packed_cases();
std::vector<KernelCase> pooling_cases();
std::vector<KernelCase> restoring_cases();

inline std::vector<KernelCase> all() {
  std::vector<KernelCase> cases;
  for (const auto& some :
       {projection_cases, gain_cases, screening_cases, refinement_cases, equalizer_cases, column_dft_cases,
        waveform_cases, sequence_cases, channel_cases, frequency_cases, packed_cases, pooling_cases, restoring_cases})
    for (auto& one : some()) cases.push_back(std::move(one));
  return cases;
}

// Lengths around one vector of any target: from 1 value to more than two of the longest vectors.
inline constexpr std::array<std::size_t, 12> kLengths{1, 2, 3, 4, 7, 8, 9, 15, 16, 17, 33, 70};

constexpr double kInfinite = std::numeric_limits<double>::infinity();

template <class T>
constexpr T filler() {
  if constexpr (std::is_floating_point_v<T>) return std::numeric_limits<T>::quiet_NaN();
  return std::numeric_limits<T>::max();
}

// Values at an offset that is unaligned for every vector, surrounded by NaN (or the largest integer).
template <class T>
class Misaligned {
 public:
  explicit Misaligned(std::size_t size) : memory_(size + 2 * kMargin + 1, filler<T>()), size_(size) {}
  [[nodiscard]] T* data() { return memory_.data() + kMargin + 1; }
  [[nodiscard]] const T* data() const { return memory_.data() + kMargin + 1; }
  [[nodiscard]] std::size_t size() const { return size_; }
  void clear() { std::ranges::fill(memory_, filler<T>()); }
  [[nodiscard]] std::span<const T> before() const { return {memory_.data(), kMargin + 1}; }
  [[nodiscard]] std::span<const T> after() const { return {data() + size_, kMargin}; }

 private:
  static constexpr std::size_t kMargin = 16;
  std::vector<T> memory_;
  std::size_t size_;
};

// Normal values, mean 0 and variance 1. A prime number of them is drawn and repeated: drawing took three quarters of
// the time of all cases.
inline double next_normal() {
  static const std::vector<double> drawn = [] {
    std::mt19937 source(7);
    std::normal_distribution<double> distribution;
    std::vector<double> values(131'071);
    std::ranges::generate(values, [&] { return distribution(source); });
    return values;
  }();
  static std::size_t next = 0;
  return drawn[next++ % drawn.size()];
}

// `rows` of `length` random values, `stride` apart, with filler between.
template <class T>
Misaligned<T> random_rows(std::size_t rows, std::size_t length, std::size_t stride, double mean = 0, double std = 1) {
  Misaligned<T> values(rows * stride);
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t i = 0; i < length; ++i) {
      const double value = mean + std * next_normal();
      values.data()[n * stride + i] = std::is_floating_point_v<T>
                                          ? static_cast<T>(value)
                                          : static_cast<T>(std::clamp(value, 0.0, static_cast<double>(filler<T>())));
    }
  return values;
}

// Largest |got − want| over the largest |want|. Equal NaN and equal infinities count as 0.
template <class T>
double deviation(std::span<const T> got, std::span<const T> want) {
  double largest = 1e-300, worst = 0;
  for (const T value : want)
    if (std::isfinite(static_cast<double>(value))) largest = std::max(largest, std::abs(static_cast<double>(value)));
  for (std::size_t i = 0; i < want.size(); ++i) {
    const auto a = static_cast<double>(got[i]), b = static_cast<double>(want[i]);
    if (a == b || (std::isnan(a) && std::isnan(b))) continue;
    worst = std::max(worst, std::isfinite(a) && std::isfinite(b) ? std::abs(a - b) / largest : kInfinite);
  }
  return worst;
}

// Outputs of a kernel: `sections` of `length` values each, `stride` apart; the kernel may write the padding.
struct Sections {
  std::size_t sections, length, stride;
};

// `run(plain, out)`: runs the kernel or its plain loop into a buffer for all sections; writes elsewhere are errors.
template <class T, class Run>
KernelCase kernel_case(std::string name, double tolerance, Sections of, Run run, bool timed) {
  const auto out = std::make_shared<std::array<Misaligned<T>, 2>>(
      std::array{Misaligned<T>(of.sections * of.stride), Misaligned<T>(of.sections * of.stride)});
  const auto compare = [out, run, of] {
    auto& [got, want] = *out;
    got.clear();
    want.clear();
    run(false, got.data());
    run(true, want.data());
    double worst = std::max(deviation(got.before(), want.before()), deviation(got.after(), want.after()));
    for (std::size_t k = 0; k < of.sections; ++k)
      worst = std::max(worst, deviation(std::span<const T>(got.data() + k * of.stride, of.length),
                                        std::span<const T>(want.data() + k * of.stride, of.length)));
    return worst;
  };
  const auto kernel = [out, run] { run(false, (*out)[0].data()); };
  return {std::move(name), timed ? std::function<void()>(kernel) : nullptr, compare, tolerance};
}

}  // namespace kernel_cases
