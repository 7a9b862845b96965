#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "ocisac/cleaning/light_share.hpp"

namespace ocisac {

namespace {

constexpr std::size_t rows = 120, columns = 90;

// Steps of texture every 30 columns and 25 rows under a tone whose share is 0.8 left of column 45 and 0.2 right of it.
struct Scene {
  std::vector<double> light, variance = std::vector<double>(rows * columns, 0.1), row_light = std::vector<double>(rows);

  Scene() : light(rows * columns) {
    for (std::size_t n = 0; n < rows; ++n) {
      row_light[n] = 1 + 0.9 * std::cos(2 * std::numbers::pi * static_cast<double>(n) / 15);
      for (std::size_t x = 0; x < columns; ++x) {
        const double texture = 40 + 25 * static_cast<double>(((n + 7 * (x / 10)) / 25 + x / 30) % 3);
        const double clean = x < 45 ? 3 * texture : texture;
        light[n * columns + x] = clean * (1 + share(x) * (row_light[n] - 1));
      }
    }
  }

  static double share(std::size_t column) { return column < 45 ? 0.8 : 0.2; }
  BandedPicture picture() const { return {light, variance, 1, rows, columns}; }
};

}  // namespace

TEST_CASE("shares are found up to the edge between them") {
  const Scene scene;
  const std::vector<double> share = light_share(scene.picture(), scene.row_light);
  std::size_t near = 0;
  for (std::size_t i = 0; i < share.size(); ++i)
    near += std::abs(share[i] - Scene::share(i % columns)) < 0.05 ? 1U : 0U;
  CHECK(static_cast<double>(near) > 0.93 * static_cast<double>(share.size()));
}

TEST_CASE("pixels of infinite variance say nothing") {
  Scene scene;
  for (std::size_t i = 0; i < scene.light.size(); i += 7) {
    scene.light[i] = 255;
    scene.variance[i] = INFINITY;
  }
  const std::vector<double> share = light_share(scene.picture(), scene.row_light);
  CHECK(share[60 * columns + 20] == doctest::Approx(0.8).epsilon(0.05));
}

TEST_CASE("the row light is found from a wrong start") {
  const Scene scene;
  std::vector<double> share(rows * columns);
  for (std::size_t i = 0; i < share.size(); ++i) share[i] = Scene::share(i % columns);
  std::vector<double> start(rows, 1.0);
  const RowLight found = refine_row_light(scene.picture(), share, start, 12);
  double error = 0, swing = 0;
  for (std::size_t n = 15; n < 105; ++n) {
    const double expected = scene.row_light[n] - scene.row_light[n - 7];
    error += std::pow(found.light[n] - found.light[n - 7] - expected, 2);
    swing += expected * expected;
  }
  CHECK(error < 0.1 * swing);
}

TEST_CASE("the row light is found within a basis, or near where it starts") {
  const Scene scene;
  std::vector<double> share(rows * columns), basis(2 * rows), start(rows, 1.0);
  for (std::size_t i = 0; i < share.size(); ++i) share[i] = Scene::share(i % columns);
  for (std::size_t n = 0; n < rows; ++n) {
    basis[n] = std::cos(2 * std::numbers::pi * static_cast<double>(n) / 15);
    basis[rows + n] = std::sin(2 * std::numbers::pi * static_cast<double>(n) / 15);
  }
  const RowLight within = refine_row_light(scene.picture(), share, start, 12, {.basis = basis});
  const RowLight held = refine_row_light(scene.picture(), share, start, 12, {.basis = {}, .deviation = 1e-4});
  for (std::size_t n = 0; n < rows; ++n) {
    CHECK(within.light[n] == doctest::Approx(scene.row_light[n]).epsilon(0.02));
    CHECK(held.light[n] == doctest::Approx(1).epsilon(0.01));
  }
  CHECK_THROWS_AS(refine_row_light(scene.picture(), share, start, 1, {.basis = std::span(basis).first(7)}),
                  std::invalid_argument);
}

TEST_CASE("input without meaning is refused") {
  const Scene scene;
  CHECK_THROWS_AS(light_share(scene.picture(), std::vector<double>(3)), std::invalid_argument);
  CHECK_THROWS_AS(light_share({}, {}), std::invalid_argument);
  CHECK_THROWS_AS(refine_row_light(scene.picture(), std::vector<double>(3), scene.row_light), std::invalid_argument);
}

}  // namespace ocisac
