// Contrast between columns under a light, a veil and in lines of text.
#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <random>
#include <vector>

#include "columns/contrast_slope.hpp"

namespace {

constexpr std::size_t kRows = 480, kColumns = 160;

// Of light(row, texture of the row and column) with noise; texture is smooth along the rows, of mean 100.
template <class Light>
ocisac::ContrastSlope slope_of(Light light, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> texture(kColumns, 100.0), pixels;
  for (double& value : texture) value += 20 * normal(random);
  for (std::size_t n = 0; n < kRows; ++n)
    for (double& value : texture) {
      value += 0.05 * (100 - value) + 5 * normal(random);
      pixels.push_back(light(n, value) + 2 * normal(random));
    }
  return ocisac::contrast_slope(ocisac::dense_view(const_cast<const double*>(pixels.data()), 1, kRows, kColumns), 0,
                                {0, 0, kColumns, kRows}, {});
}

double wave(std::size_t n) { return 0.3 * std::sin(0.4 * static_cast<double>(n)); }

TEST_CASE("a light multiplies, a veil adds, lines of text have letters where they are dark") {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const auto multiplied = slope_of([](std::size_t n, double x) { return x * (1 + wave(n)); }, seed);
    CHECK(std::abs(multiplied.slope) < 5 * multiplied.std + 0.05);  // seven degrees of freedom, and the floor
    CHECK(multiplied.std < 0.3);
    CHECK_FALSE(multiplied.is_of_texture());
    const auto veil = slope_of([](std::size_t n, double x) { return x + 100 * wave(n); }, seed);
    CHECK(std::abs(veil.slope + 2) < 5 * veil.std);
    CHECK_FALSE(veil.is_of_texture());
    const auto text = slope_of([](std::size_t n, double x) { return 150 - (wave(n) < 0 ? x / 2 : 5); }, seed);
    CHECK(text.is_of_texture());
  }
}

TEST_CASE("few rows, few columns and an even picture tell nothing") {
  const std::vector<double> even(kRows * kColumns, 100.0);
  for (const ocisac::Region box : {ocisac::Region{0, 0, kColumns, kRows}, {0, 0, 8, kRows}, {0, 0, kColumns, 20}})
    CHECK_FALSE(
        ocisac::contrast_slope(ocisac::dense_view(even.data(), 1, kRows, kColumns), 0, box, {}).is_of_texture());
}

}  // namespace
