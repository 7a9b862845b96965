#include <complex>
#include <numbers>

#include "columns/column_dft_kernels.hpp"
#include "kernel_cases.hpp"

namespace kernel_cases {

namespace {

using ocisac::kernels::DftStep;
using ocisac::kernels::kColumnPairs;

template <class T>
constexpr std::size_t kRow = 2 * kColumnPairs<T>;

// (length/radix × radix − 1 × 2)
template <class T>
std::vector<T> turns_of(std::size_t radix, std::size_t length) {
  std::vector<T> turns;
  for (std::size_t j = 0; j < length / radix; ++j)
    for (std::size_t q = 1; q < radix; ++q) {
      const auto turn =
          std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(j * q) / static_cast<double>(length));
      turns.push_back(static_cast<T>(turn.real()));
      turns.push_back(static_cast<T>(turn.imag()));
    }
  return turns;
}

// The step by its equation, or the inverse: its conjugate transpose.
template <class T>
void plain_step(std::size_t radix, std::size_t length, T* rows, bool inverse) {
  const std::size_t part = length / radix;
  for (std::size_t j = 0; j < part; ++j)
    for (std::size_t c = 0; c < kColumnPairs<T>; ++c) {
      const auto at = [&](std::size_t p) { return rows + (j + p * part) * kRow<T> + c; };
      std::vector<std::complex<double>> in(radix), out(radix);
      for (std::size_t p = 0; p < radix; ++p) in[p] = {at(p)[0], at(p)[kColumnPairs<T>]};
      for (std::size_t p = 0; p < radix; ++p)
        for (std::size_t q = 0; q < radix; ++q) {
          const auto turn = std::polar(1.0, -2 * std::numbers::pi *
                                                (static_cast<double>(j * q) / static_cast<double>(length) +
                                                 static_cast<double>(p * q) / static_cast<double>(radix)));
          out[inverse ? p : q] += inverse ? std::conj(turn) * in[q] : turn * in[p];
        }
      for (std::size_t p = 0; p < radix; ++p) {
        at(p)[0] = static_cast<T>(out[p].real());
        at(p)[kColumnPairs<T>] = static_cast<T>(out[p].imag());
      }
    }
}

template <class T>
constexpr double kTolerance = std::is_same_v<T, float> ? 1e-6 : 1e-14;

template <class T>
std::string named(const char* kernel, std::size_t length) {
  return std::string(kernel) + (std::is_same_v<T, float> ? " float " : " double ") + std::to_string(length);
}

// All pairs are calculated; two blocks after each other.
template <class T>
KernelCase step_case(std::size_t radix, std::size_t length, bool inverse) {
  constexpr std::size_t kBlocks = 2;
  const std::size_t size = length * kRow<T>;
  auto rows = std::make_shared<Misaligned<T>>(random_rows<T>(kBlocks, size, size));
  auto turns = std::make_shared<std::vector<T>>(turns_of<T>(radix, length));
  const auto run = [=](bool plain, T* out) {
    std::copy_n(rows->data(), kBlocks * size, out);
    const DftStep<T> step{radix, length, turns->data()};
    if (!plain && inverse) return ocisac::kernels::dft_loops<T>().inverse_step(step, out, kBlocks, kColumnPairs<T>);
    if (!plain) return ocisac::kernels::dft_loops<T>().step(step, out, kBlocks, kColumnPairs<T>);
    for (std::size_t block = 0; block < kBlocks; ++block) plain_step<T>(radix, length, out + block * size, inverse);
  };
  const auto name = named<T>(inverse ? "inverse_dft_step" : "dft_step", length) + " by " + std::to_string(radix);
  return kernel_case<T>(name, kTolerance<T>, {1, kBlocks * size, kBlocks * size}, run, length >= 125);
}

template <class T>
KernelCase multiply_case(std::size_t count) {
  const std::size_t size = count * kRow<T>;
  auto rows = std::make_shared<Misaligned<T>>(random_rows<T>(1, size, size));
  auto gain = std::make_shared<Misaligned<T>>(random_rows<T>(1, 2 * count, 2 * count));
  const auto run = [=](bool plain, T* out) {
    std::copy_n(rows->data(), size, out);
    if (!plain) return ocisac::kernels::dft_loops<T>().multiply_rows(out, gain->data(), count, kColumnPairs<T>);
    for (std::size_t i = 0; i < size; ++i) {
      const std::size_t n = i / kRow<T>, c = i % kRow<T> % kColumnPairs<T>;
      const T* const from = rows->data() + n * kRow<T> + c;
      const auto product = std::complex<double>(from[0], from[kColumnPairs<T>]) *
                           std::complex<double>(gain->data()[2 * n], gain->data()[2 * n + 1]);
      out[i] = static_cast<T>(i % kRow<T> < kColumnPairs<T> ? product.real() : product.imag());
    }
  };
  return kernel_case<T>(named<T>("multiply_rows", count), kTolerance<T>, {1, size, size}, run, count >= 200);
}

template <class T>
void add_cases_of(std::vector<KernelCase>& cases) {
  for (const std::size_t radix : {2u, 3u, 4u, 5u})
    for (const std::size_t part : {1u, 2u, 3u, 25u})
      for (const bool inverse : {false, true}) cases.push_back(step_case<T>(radix, radix * part, inverse));
  for (const std::size_t count : {1u, 7u, 200u}) cases.push_back(multiply_case<T>(count));
}

}  // namespace

std::vector<KernelCase> column_dft_cases() {
  std::vector<KernelCase> cases;
  add_cases_of<float>(cases);
  add_cases_of<double>(cases);
  return cases;
}

}  // namespace kernel_cases
