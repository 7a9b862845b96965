#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "ocisac/cleaning/row_model.hpp"

namespace ocisac {

namespace {

constexpr std::size_t rows = 400, columns = 60;
constexpr double rows_per_chip = 6.2, exposure = 4;

// Chips of a shift register, seen through an exposure of 4 rows.
std::vector<double> chip_rows() {
  std::vector<double> bits;
  for (unsigned state = 0x2AU, k = 0; k < 100; ++k) {
    bits.push_back(state & 1U ? 1.0 : 0.0);
    state = (state >> 1U) | (((state ^ (state >> 1U)) & 1U) << 6U);
  }
  std::vector<double> light;
  for (std::size_t n = 0; n < rows; ++n) {
    double sum = 0;
    for (int part = 0; part < 40; ++part)
      sum += bits[static_cast<std::size_t>((static_cast<double>(n) + exposure * part / 40) / rows_per_chip)];
    light.push_back(sum / 40);
  }
  double mean = 0;
  for (const double value : light) mean += value / static_cast<double>(rows);
  for (double& value : light) value /= mean;
  return light;
}

std::vector<double> tone_rows(double phase) {
  std::vector<double> light;
  for (std::size_t n = 0; n < rows; ++n)
    light.push_back(1 + std::cos(2 * std::numbers::pi * static_cast<double>(n) / 31 + phase));
  return light;
}

// Boxes of which the light has a share of 0.8.
struct Boxes {
  std::vector<double> light, variance = std::vector<double>(rows * columns, 0.5);

  explicit Boxes(const std::vector<double>& row_light) {
    for (std::size_t n = 0; n < rows; ++n)
      for (std::size_t k = 0; k < columns; ++k)
        light.push_back((40 + 20 * static_cast<double>((n / 43 + k / 15) % 4)) * (1 + 0.8 * (row_light[n] - 1)));
  }
  BandedPicture picture() const { return {light, variance, 1, rows, columns}; }
};

double mean_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t n = 0; n < a.size(); ++n) sum += std::abs(a[n] - b[n]) / static_cast<double>(a.size());
  return sum;
}

}  // namespace

TEST_CASE("chips are found where they are the light, with their rate") {
  const std::vector<double> truth = chip_rows();
  const ModelledLight found = find_row_light(ColumnBundles(Boxes(truth).picture()), RowModel::automatic);
  CHECK(name_of(found.model) == "chips");
  CHECK(found.frequency == doctest::Approx(1 / rows_per_chip).epsilon(0.01));
  CHECK(mean_difference(found.light, truth) < 0.05);
  CHECK(found.full >= 1);
}

TEST_CASE("chips explain rows of chips, and less of a stretched scale") {
  RowLight rows_of_chips{chip_rows(), std::vector<double>(rows, 1.0)};
  const double unexplained = unexplained_by_chips(rows_of_chips);
  for (double& value : rows_of_chips.light) value = value * value * value;
  CHECK(unexplained < 0.02);
  CHECK(unexplained_by_chips(rows_of_chips) > 2 * unexplained);
  const RowLight even{std::vector<double>(rows, 1.0), std::vector<double>(rows, 1.0)};
  CHECK(unexplained_by_chips(even) == 1);
}

TEST_CASE("an asked model is used, and rows are what is left") {
  const Boxes boxes(tone_rows(0));
  const ColumnBundles picture(boxes.picture());
  CHECK(find_row_light(picture, RowModel::automatic).model == RowModel::tone);
  const ModelledLight found = find_row_light(picture, RowModel::rows);
  CHECK(found.model == RowModel::rows);
  CHECK(std::isnan(found.frequency));
  CHECK_FALSE(found.tone);
}

TEST_CASE("colours share a light, or have tones of one frequency and their own phase") {
  const Boxes red(tone_rows(0)), green(tone_rows(0.01)), blue(tone_rows(1));
  const std::vector<BandedPicture> colours{red.picture(), green.picture(), blue.picture()};
  const ColourLights found = find_colour_lights(colours, RowModel::automatic);
  CHECK(found.of_colour[0] == found.of_colour[1]);
  CHECK(found.of_colour[2] != found.of_colour[0]);
  CHECK(mean_difference(found.lights[found.of_colour[2]].light, tone_rows(1)) < 0.05);
  CHECK_THROWS_AS(find_colour_lights({}, RowModel::automatic), std::invalid_argument);
}

}  // namespace ocisac
