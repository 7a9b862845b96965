// Oblique lamps: their slope, and frames sheared upright.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include "columns/lamp_slope.hpp"
#include "ocisac/columns/column_combination.hpp"

namespace {

constexpr std::size_t kRows = 720, kColumns = 240;

// A lamp of random chips of 6 rows, σ = 12 columns, that moves by `slope` columns a row.
std::vector<std::uint8_t> oblique_lamp(double slope, double noise) {
  std::mt19937 random(5);
  std::normal_distribution<double> of_pixel(0, noise);
  std::vector<std::uint8_t> pixels(kRows * kColumns);
  double light = 0;
  for (std::size_t row = 0; row < kRows; ++row) {
    if (row % 6 == 0) light = static_cast<double>(random() & 1U);
    const double centre = 0.5 * (kColumns - 1) + slope * (static_cast<double>(row) - 0.5 * (kRows - 1));
    for (std::size_t column = 0; column < kColumns; ++column) {
      const double off = (static_cast<double>(column) - centre) / 12;
      pixels[row * kColumns + column] = static_cast<std::uint8_t>(
          std::lround(std::clamp(20 + 120 * light * std::exp(-0.5 * off * off) + of_pixel(random), 0.0, 255.0)));
    }
  }
  return pixels;
}

ocisac::AnyFramesView view_of(const std::vector<std::uint8_t>& pixels) {
  return ocisac::dense_view<const std::uint8_t>(pixels.data(), 1, kRows, kColumns);
}

}  // namespace

TEST_CASE("the slope of an oblique lamp is found, that of an upright one is 0") {
  for (const double slope : {-0.2, -0.05, 0.1, 0.25}) {
    const auto pixels = oblique_lamp(slope, 2);
    CHECK(ocisac::combine_columns(view_of(pixels), 0, {}).slope == doctest::Approx(slope).epsilon(0.1));
  }
  const auto upright = oblique_lamp(0, 2);
  CHECK(ocisac::combine_columns(view_of(upright), 0, {}).slope == 0);
  const auto dark = std::vector<std::uint8_t>(kRows * kColumns, 20);
  CHECK(ocisac::combine_columns(view_of(dark), 0, {}).slope == 0);
}

TEST_CASE("an oblique lamp sheared upright is combined as well as an upright one") {
  const auto upright = oblique_lamp(0, 2), oblique = oblique_lamp(0.2, 2);
  const ocisac::UprightFrame sheared(view_of(oblique), 0, 0.2);
  const auto of_upright = ocisac::combine_columns(view_of(upright), 0, {});
  const auto of_sheared = ocisac::combine_columns(sheared.view(), 0, {});
  CHECK(of_sheared.slope == 0);
  CHECK(of_sheared.noise < 1.3 * of_upright.noise);
  const auto weights = sheared.own_weights(of_sheared.weights);
  REQUIRE(weights.size() == kColumns);
  double sum = 0;
  for (double weight : weights) sum += weight;
  CHECK(sum == doctest::Approx(1));
}

TEST_CASE("a lamp that leaves the frame keeps at least a column") {
  const auto pixels = oblique_lamp(0, 2);
  const ocisac::UprightFrame sheared(view_of(pixels), 0, 3);
  CHECK(std::visit([](const auto& view) { return view.columns; }, sheared.view()) >= 1);
}
