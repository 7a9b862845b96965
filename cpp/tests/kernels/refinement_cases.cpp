#include <complex>
#include <numbers>

#include "kernel_cases.hpp"
#include "lights/refinement_kernels.hpp"

namespace kernel_cases {

namespace {

using namespace ocisac::kernels;

constexpr double kFrequency = 0.0437;  // cycles per row

// e^{−j2πf·m} for m from `first` on.
struct Phasors {
  std::vector<double> real, imaginary;

  Phasors(double frequency, double first, std::size_t count) : real(count), imaginary(count) {
    for (std::size_t i = 0; i < count; ++i) {
      const double angle = -2 * std::numbers::pi * frequency * (first + static_cast<double>(i));
      real[i] = std::cos(angle), imaginary[i] = std::sin(angle);
    }
  }
  [[nodiscard]] ComplexValues values() const { return {real, imaginary}; }
};

struct Patch {
  std::size_t rows, stride, length;
  Misaligned<double> values, mean;
  Phasors below, middle, above, turns;

  Patch(std::size_t row_count, std::size_t row_stride, std::size_t window_length)
      : rows(row_count),
        stride(row_stride),
        length(window_length),
        values(random_rows<double>(rows, stride, stride, 4)),
        mean(random_rows<double>(1, stride, stride, 4)),
        below(carrier(-1)),
        middle(carrier(0)),
        above(carrier(1)),
        turns(1.0 / static_cast<double>(length), 0, rows) {}
  [[nodiscard]] Phasors carrier(int line) const {
    return {kFrequency + line / static_cast<double>(length), -static_cast<double>(length / 2), rows + length - 1};
  }
};

void plain_demodulate(const Patch& patch, double* real, double* imaginary) {
  const auto reach = static_cast<std::ptrdiff_t>(patch.length / 2), last = static_cast<std::ptrdiff_t>(patch.rows) - 1;
  for (std::size_t g = 0; g < patch.stride; ++g)
    for (std::ptrdiff_t n = 0; n <= last; ++n) {
      std::complex<double> sum = 0;
      for (std::ptrdiff_t m = n - reach; m <= n + reach; ++m) {
        const auto row = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(m, 0, last));
        const double along = 2 * std::numbers::pi * static_cast<double>(m - n) / static_cast<double>(patch.length);
        const double window = (1 + std::cos(along)) / static_cast<double>(patch.length);
        sum += window * (patch.values.data()[row * patch.stride + g] - patch.mean.data()[g]) *
               std::polar(1.0, -2 * std::numbers::pi * kFrequency * static_cast<double>(m));
      }
      const std::size_t at = static_cast<std::size_t>(n) * patch.stride + g;
      real[at] = sum.real(), imaginary[at] = sum.imag();
    }
}

KernelCase demodulate_case(std::size_t rows, std::size_t stride, std::size_t length) {
  const auto patch = std::make_shared<Patch>(rows, stride, length);
  const auto run = [patch](bool plain, double* out) {
    double* imaginary = out + patch->rows * patch->stride;
    if (plain) return plain_demodulate(*patch, out, imaginary);
    const HannWindow window{patch->below.values(), patch->middle.values(), patch->above.values(), patch->turns.values(),
                            patch->length};
    hann_demodulate({patch->values.data(), patch->rows, patch->stride}, patch->mean.data(), window, out, imaginary);
  };
  return kernel_case<double>("hann_demodulate " + std::to_string(rows) + " rows, stride " + std::to_string(stride) +
                                 ", window of " + std::to_string(length),
                             1e-12, {1, 2 * rows * stride, 2 * rows * stride}, run, rows > 200);
}

template <class T>
KernelCase logarithms_case(std::size_t count, double tolerance) {
  const auto light = std::make_shared<Misaligned<T>>(random_rows<T>(1, count, count, 60, 60));
  const auto run = [=](bool plain, T* out) {
    if (!plain) return logarithms(light->data(), count, T{0.5}, out);
    for (std::size_t i = 0; i < count; ++i)
      out[i] = static_cast<T>(std::log(std::max(double{light->data()[i]}, 0.0) + 0.5));
  };
  return kernel_case<T>(
      (sizeof(T) == 4 ? "logarithms<float> " : "logarithms<double> ") + std::to_string(count) + " values", tolerance,
      {1, count, count}, run, count > 200);
}

}  // namespace

std::vector<KernelCase> refinement_cases() {
  std::vector<KernelCase> cases;
  for (const std::size_t stride : {8u, 16u, 24u})
    for (const std::size_t rows : {1u, 2u, 17u, 40u})
      for (const std::size_t length : {3u, 9u, 31u}) cases.push_back(demodulate_case(rows, stride, length));
  cases.push_back(demodulate_case(240, 16, 31));
  for (const std::size_t count : {1u, 2u, 3u, 7u, 8u, 9u, 15u, 16u, 17u, 24u, 33u, 40u, 70u, 240u}) {
    cases.push_back(logarithms_case<float>(count, 1e-5));
    if (count % kPatchPadding == 0) cases.push_back(logarithms_case<double>(count, 1e-15));
  }
  return cases;
}

}  // namespace kernel_cases
