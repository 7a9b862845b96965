// The DFT along columns beside its equation.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

#include "columns/column_dft.hpp"
#include "core/spectrum.hpp"

namespace {

using ocisac::kernels::kColumnPairs;

template <class T>
std::vector<T> random_block(std::size_t length) {
  std::mt19937 random(static_cast<unsigned>(length));
  std::normal_distribution<double> normal;
  std::vector<T> block(length * 2 * kColumnPairs<T>);
  std::ranges::generate(block, [&] { return static_cast<T>(normal(random)); });
  return block;
}

template <class T>
std::complex<double> at(const std::vector<T>& block, std::size_t row, std::size_t pair) {
  const T* const values = block.data() + row * 2 * kColumnPairs<T> + pair;
  return {static_cast<double>(values[0]), static_cast<double>(values[kColumnPairs<T>])};
}

// Σ_n x(n)·e^{−j2πkn/length} of a pair.
template <class T>
std::complex<double> line(const std::vector<T>& block, std::size_t pair, std::size_t k,
                          const std::vector<std::complex<double>>& turns) {
  std::complex<double> sum = 0;
  for (std::size_t n = 0; n < turns.size(); ++n) sum += at(block, n, pair) * turns[k * n % turns.size()];
  return sum;
}

// At most 60 lines of each of the first `pairs`, and all rows after the DFT and its inverse.
template <class T>
void check_length(std::size_t length, std::size_t pairs, double tolerance) {
  CAPTURE(length);
  CAPTURE(pairs);
  const ocisac::ColumnDft<T> dft(length);
  std::vector<std::complex<double>> turns(length);
  for (std::size_t n = 0; n < length; ++n)
    turns[n] = std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(n) / static_cast<double>(length));
  const auto block = random_block<T>(length);
  auto spectra = block;
  dft.forward(spectra.data(), pairs);
  auto back = spectra;
  dft.inverse(back.data(), pairs);
  const double scale = std::sqrt(static_cast<double>(length));  // of a line of noise
  double worst = 0, worst_back = 0;
  for (std::size_t pair = 0; pair < pairs; ++pair) {
    for (std::size_t n = 0; n < length; n += 1 + length / 60)
      worst = std::max(worst, std::abs(at(spectra, n, pair) - line(block, pair, dft.order()[n], turns)) / scale);
    for (std::size_t n = 0; n < length; ++n)
      worst_back = std::max(worst_back, std::abs(at(back, n, pair) / static_cast<double>(length) - at(block, n, pair)));
  }
  CHECK(worst <= tolerance);
  CHECK(worst_back <= tolerance);
}

}  // namespace

TEST_CASE("the DFT along columns is its equation, for every length up to 2000 of 2, 3 and 5") {
  std::size_t lengths = 0;
  for (std::size_t length = 1; length <= 2000; ++length) {
    if (ocisac::optimal_dft_length(length) != length) continue;
    ++lengths;
    check_length<double>(length, 3, 1e-14);
    check_length<float>(length, 1, 5e-6);
  }
  CHECK(lengths > 90);
}

TEST_CASE("long DFTs along columns, with all pairs") {
  for (const std::size_t length : {1600u, 16'200u, 65'536u}) {
    check_length<double>(length, kColumnPairs<double>, 1e-13);
    check_length<float>(length, kColumnPairs<float>, 1e-5);
  }
}

TEST_CASE("lengths with other factors are refused") {
  CHECK_THROWS_AS(ocisac::ColumnDft<double>(14), std::invalid_argument);
  CHECK_THROWS_AS(ocisac::ColumnDft<float>(0), std::invalid_argument);
}
