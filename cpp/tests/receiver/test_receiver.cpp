#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "chips/chip_timing.hpp"
#include "chips/edges.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/receiver/receive.hpp"
#include "ocisac/rows/chip_clock.hpp"

namespace {

struct Frame {
  std::string chips;
  std::vector<std::uint8_t> pixels;
  std::size_t rows = 720, columns = 96;

  [[nodiscard]] ocisac::AnyFramesView view() const {
    return ocisac::dense_view<const std::uint8_t>(pixels.data(), 1, rows, columns);
  }
};

// Random chips through an exposure of half a chip, with noise, under light that halves along the rows.
Frame make_frame(unsigned seed, double rows_per_chip) {
  Frame frame;
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 4);
  for (std::size_t k = 0; k < frame.rows; ++k) frame.chips += random() % 2 ? '1' : '0';
  const double exposure = 0.5 * rows_per_chip;
  for (std::size_t row = 0; row < frame.rows; ++row) {
    double light = 0;
    constexpr int kPoints = 64;
    for (int i = 0; i < kPoints; ++i) {
      const double time = static_cast<double>(row) + exposure * ((i + 0.5) / kPoints - 0.5);
      light += frame.chips[static_cast<std::size_t>(time / rows_per_chip + 2.3)] == '1' ? 1.0 / kPoints : 0.0;
    }
    const double gain = 180 * std::exp2(-static_cast<double>(row) / static_cast<double>(frame.rows));
    for (std::size_t column = 0; column < frame.columns; ++column)
      frame.pixels.push_back(static_cast<std::uint8_t>(std::clamp(20 + gain * light + noise(random), 0.0, 255.0)));
  }
  return frame;
}

}  // namespace

TEST_CASE("colours of different shapes are refused") {
  const Frame frame = make_frame(1, 5);
  const std::array colours{frame.view(),
                           ocisac::AnyFramesView(ocisac::dense_view<const std::uint8_t>(frame.pixels.data(), 1, 9, 9))};
  CHECK_THROWS_WITH_AS(ocisac::receive(colours, {1.0, {}, {}, {}}),
                       "colour: got colours of different shapes, allowed: one shape", std::invalid_argument);
}

TEST_CASE("the common factor of a covariance is found") {
  const std::array gain{1.0, 2.0, 0.5, 3.0, 1.5};
  const std::array own{0.4, 0.2, 0.3, 1.0, 0.5};
  std::vector<double> covariance(25);
  for (std::size_t i = 0; i < 5; ++i)
    for (std::size_t j = 0; j < 5; ++j) covariance[5 * i + j] = gain[i] * gain[j] + (i == j ? own[i] : 0.0);
  const auto factor = ocisac::common_factor(covariance, 5);
  for (std::size_t i = 0; i < 5; ++i) CHECK(factor.loadings[i] == doctest::Approx(gain[i]).epsilon(0.03));
}

TEST_CASE("columns with more noise count less") {
  const Frame frame = make_frame(2, 6.3);
  std::vector<double> pixels(frame.pixels.begin(), frame.pixels.end());
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 60);
  for (std::size_t row = 0; row < frame.rows; ++row)
    for (std::size_t column = 0; column < 48; ++column) pixels[row * 96 + column] += noise(random);
  const auto combined = ocisac::combine_columns(ocisac::dense_view<const double>(pixels.data(), 1, 720, 96), 0, {});
  double noisy = 0, clean = 0;
  for (std::size_t column = 0; column < 96; ++column) (column < 48 ? noisy : clean) += combined.weights[column];
  CHECK(noisy + clean == doctest::Approx(1));
  CHECK(noisy < 0.2 * clean);
}

TEST_CASE("turning points of noise on a step are pruned to the step") {
  std::vector<double> signal(200);
  for (std::size_t n = 0; n < 200; ++n) signal[n] = (n / 50 % 2 ? 10.0 : 0.0) + (n % 2 ? 0.4 : -0.4);
  const auto points = ocisac::prune_turning_points(signal, ocisac::turning_points(signal, 0.1));
  const auto edges = ocisac::edges_between(signal, points, 0.5);
  REQUIRE(edges.rows.size() == 3);
  for (std::size_t k = 0; k < 3; ++k)
    CHECK(edges.rows[k] == doctest::Approx(49.5 + 50 * static_cast<double>(k)).epsilon(0.01));
  CHECK(edges.rising == std::vector<std::uint8_t>{1, 0, 1});
}

TEST_CASE("the slowest lattice is found, and where bright runs are longer than whole chips") {
  ocisac::Edges edges;
  const std::array<double, 12> chips{0, 1, 3, 4, 5, 8, 10, 11, 12, 14, 17, 18};
  for (std::size_t k = 0; k < chips.size(); ++k) {
    edges.rows.push_back(11.3 + 7.1 * chips[k] + (k % 2 ? 0.9 : 0.0));
    edges.rising.push_back(k % 2 == 0);
  }
  const auto timing = ocisac::find_lattice(edges, 200, {1.0 / 50, 0.5});
  REQUIRE(timing);
  CHECK(timing->lattice.clock.rows_per_chip == doctest::Approx(7.1));
  CHECK(timing->lattice.duty_offset == doctest::Approx(0.9));
  CHECK(std::remainder(timing->lattice.clock.phase - 11.3 - 0.45, 7.1) == doctest::Approx(0).epsilon(1e-9));
  CHECK(timing->residual < 1e-9);
}

TEST_CASE("only whole chips are in the grid") {
  const auto grid = ocisac::whole_chips({10, 3}, 100);
  CHECK(grid.count == 9);
  CHECK(grid.start(0) == doctest::Approx(3));
  CHECK(ocisac::whole_chips({10, -0.5}, 100).count == 10);
  CHECK(ocisac::whole_chips({200, 3}, 100).count == 0);
}
