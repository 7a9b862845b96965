// The light of the columns beside a lamp.
#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include "ocisac/columns/column_combination.hpp"

namespace {

constexpr std::size_t kRows = 600, kColumns = 64;

double hum(std::size_t row) { return 60 + 25 * std::sin(2 * std::numbers::pi * static_cast<double>(row) / 450); }

// A lamp of the width `sigma` in the middle of the columns, with chips of 6 rows, and hum on all columns.
std::vector<std::uint8_t> pixels(double sigma) {
  std::mt19937 random(11);
  std::normal_distribution<double> noise(0, 1);
  std::vector<std::uint8_t> frame(kRows * kColumns);
  bool bright = false;
  for (std::size_t row = 0; row < kRows; ++row) {
    if (row % 6 == 0) bright = (random() & 1U) != 0;
    for (std::size_t column = 0; column < kColumns; ++column) {
      const double away = (static_cast<double>(column) - 31.5) / sigma;
      const double lamp = bright ? 80 * std::exp(-0.5 * away * away) : 0.0;
      frame[row * kColumns + column] = static_cast<std::uint8_t>(std::lround(hum(row) + lamp + noise(random)));
    }
  }
  return frame;
}

ocisac::CombinedColumn combined(const std::vector<std::uint8_t>& frame) {
  const ocisac::FramesView<const std::uint8_t> view{frame.data(), 1, kRows, kColumns, 0, kColumns, 1};
  return ocisac::combine_columns(view, 0, {});
}

}  // namespace

TEST_CASE("columns beside a lamp show the light that is not the lamp's") {
  const auto column = combined(pixels(9));
  REQUIRE(column.beside.size() == kRows);
  double squares = 0;
  for (std::size_t row = 0; row < kRows; ++row) squares += std::pow(column.beside[row] - hum(row), 2);
  CHECK(std::sqrt(squares / kRows) < 5);  // a part of the lamp's 80
}

TEST_CASE("a lamp that fills the columns leaves none beside it") { CHECK(combined(pixels(60)).beside.empty()); }
