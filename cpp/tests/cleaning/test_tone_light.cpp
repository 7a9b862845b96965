#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "ocisac/cleaning/column_bundles.hpp"
#include "ocisac/cleaning/row_model.hpp"

namespace ocisac {

namespace {

constexpr std::size_t rows = 240, columns = 200;
constexpr double period = 23.7;

double of_row(std::size_t row, double phase) {
  return 1 + std::cos(2 * std::numbers::pi * static_cast<double>(row) / period + phase);
}

// Boxes under a tone; its share is 0.7, or 0.2 from column 100 on where `part`.
struct Boxes {
  std::vector<double> light, variance = std::vector<double>(rows * columns, 0.5), row_light;
  double scale;

  explicit Boxes(bool part = false, double phase = 0, double brightness = 1) : scale(brightness) {
    for (std::size_t n = 0; n < rows; ++n) {
      row_light.push_back(of_row(n, phase));
      for (std::size_t k = 0; k < columns; ++k) {
        const double box = 30 + 20 * static_cast<double>((n / 34 + k / 25) % 4);
        const double share = part && k >= 100 ? 0.2 : 0.7;
        light.push_back(scale * box * (1 + share * (row_light[n] - 1)));
      }
    }
  }
  BandedPicture picture() const { return {light, variance, 1, rows, columns}; }
};

double largest_difference(std::span<const double> a, std::span<const double> b) {
  double most = 0;
  for (std::size_t n = 0; n < a.size(); ++n) most = std::max(most, std::abs(a[n] - b[n]));
  return most;
}

}  // namespace

TEST_CASE("a tone is found in the rows and in the picture, and followed to another phase") {
  const Boxes first, second(false, 1.9);
  const ColumnBundles picture(first.picture());
  const RowLight rows_alone = picture.free();
  const std::optional<ToneLight> tone = find_tone_light(picture, rows_alone, 0.5);
  REQUIRE(tone);
  CHECK(tone->frequency == doctest::Approx(1 / period).epsilon(1e-3));
  CHECK(largest_difference(tone->light, first.row_light) < 0.05);
  CHECK(explained_share(rows_alone.light, tone->light, rows_alone.information) > 0.9);
  const std::vector<double> share(columns, 0.7);
  const std::vector<double> any(rows, 1.0);
  const ToneLight next = refined_tone_light(ColumnBundles(second.picture(), share), any, *tone);
  CHECK(largest_difference(next.light, second.row_light) < 0.05);
}

TEST_CASE("two lamps are found in the rows and in the picture, and followed") {
  Boxes boxes;
  const double other = 15.1;
  const auto light_of = [&](double phase) {
    std::vector<double> light;
    for (std::size_t n = 0; n < rows; ++n)
      light.push_back(0.65 * of_row(n, 0) +
                      0.35 * (1 + 0.8 * std::cos(2 * std::numbers::pi * static_cast<double>(n) / other + phase)));
    return light;
  };
  const auto lit = [&](const std::vector<double>& row_light) {
    Boxes result;
    for (std::size_t i = 0; i < result.light.size(); ++i)
      result.light[i] *= (1 + 0.7 * (row_light[i / columns] - 1)) / (1 + 0.7 * (boxes.row_light[i / columns] - 1));
    return result;
  };
  const std::vector<double> now = light_of(0), then = light_of(2);
  const Boxes first = lit(now), second = lit(then);
  const ColumnBundles picture(first.picture());
  const std::optional<ToneLight> tone = find_tone_light(picture, picture.free(), 0.5);
  REQUIRE(tone);
  CHECK(tone->frequency == doctest::Approx(1 / period).epsilon(2e-3));
  CHECK(tone->second == doctest::Approx(1 / other).epsilon(2e-3));
  const auto correlation = [](const std::vector<double>& a, const std::vector<double>& b) {
    return explained_share(a, b, std::vector<double>(a.size(), 1.0));
  };
  CHECK(correlation(fully_modulated_rows(now), fully_modulated_rows(tone->light)) > 0.97);
  const ColumnBundles later(second.picture(), std::vector<double>(columns, 0.7));
  const ToneLight next = refined_tone_light(later, std::vector<double>(rows, 1.0), *tone);
  CHECK(correlation(fully_modulated_rows(then), fully_modulated_rows(next.light)) > 0.97);
}

TEST_CASE("rows that a tone explains less than asked for have none") {
  const Boxes boxes;
  const ColumnBundles picture(boxes.picture());
  RowLight steps{std::vector<double>(rows, 1.0), std::vector<double>(rows, 1.0)};
  for (std::size_t n = 0; n < rows; ++n) steps.light[n] = (n * n / 97) % 2 == 0 ? 0.1 : 1.9;
  CHECK_FALSE(find_tone_light(picture, steps, 0.9));
}

TEST_CASE("colours of one course are alike, a colour without the light is not") {
  const Boxes red, green(false, 0, 0.5), blue(false, 1.5);
  const std::vector<BandedPicture> colours{green.picture(), red.picture(), blue.picture()};
  const std::vector<std::vector<std::size_t>> groups = alike_colours(colours);
  REQUIRE(groups.size() == 2);
  CHECK(groups[0] == std::vector<std::size_t>{1, 0});
  CHECK(groups[1] == std::vector<std::size_t>{2});
}

TEST_CASE("a light on a part of the picture has shares by pixel, one on all of it one share") {
  const Boxes all, part(true);
  const std::vector<BandedPicture> even{all.picture()}, uneven{part.picture()};
  const std::vector<std::vector<double>> lights{all.row_light};
  const std::vector<double> one = colour_shares(even, lights).front(), each = colour_shares(uneven, lights).front();
  CHECK(one.front() == one.back());
  CHECK(one.front() == doctest::Approx(0.7).epsilon(0.05));
  CHECK(each[120 * columns + 40] == doctest::Approx(0.7).epsilon(0.1));
  CHECK(each[120 * columns + 160] == doctest::Approx(0.2).epsilon(0.2));
}

TEST_CASE("saturated rows are interpolated, and a picture without data is even") {
  Boxes boxes;
  for (std::size_t i = 0; i < 3 * columns; ++i)
    boxes.variance[i] = boxes.variance[50 * columns + i] = std::numeric_limits<double>::infinity();
  for (const double value : ColumnBundles(boxes.picture()).free().light) CHECK(std::isfinite(value));
  std::fill(boxes.variance.begin(), boxes.variance.end(), std::numeric_limits<double>::infinity());
  CHECK(ColumnBundles(boxes.picture()).free().light == std::vector<double>(rows, 1.0));
}

TEST_CASE("rows, shares and frequencies without meaning are refused") {
  const Boxes boxes;
  const ColumnBundles picture(boxes.picture());
  const std::vector<double> few(3, 1.0);
  CHECK_THROWS_AS(ColumnBundles(boxes.picture(), few), std::invalid_argument);
  CHECK_THROWS_AS(static_cast<void>(picture.refined(few)), std::invalid_argument);
  CHECK_THROWS_AS(static_cast<void>(picture.misfit(few, 1)), std::invalid_argument);
  CHECK_THROWS_AS(find_tone_light(picture, {few, few}, {}), std::invalid_argument);
  CHECK_THROWS_AS(refined_tone_light(picture, boxes.row_light, {{}, 0.7}), std::invalid_argument);
  CHECK_THROWS_AS(refined_tone_light(picture, few, {{}, 0.1}), std::invalid_argument);
  CHECK_THROWS_AS(explained_share(few, boxes.row_light, few), std::invalid_argument);
}

}  // namespace ocisac
