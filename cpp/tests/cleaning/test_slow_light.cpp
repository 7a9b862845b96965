#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

#include "ocisac/cleaning/slow_light.hpp"

namespace ocisac {

namespace {

constexpr std::size_t rows = 400, columns = 120;

// Boxes under a lamp of so many cycles a picture, at a phase in cycles that grows by `tilt` over the columns.
struct Boxes {
  std::vector<double> light, variance = std::vector<double>(rows * columns, 1.0);

  Boxes(double cycles, double depth, double phase, double tilt = 0) {
    std::mt19937 random(3);
    std::vector<double> boxes;
    for (std::size_t k = 0; k < (rows / 29 + 1) * (columns / 8 + 1); ++k)
      boxes.push_back(60 + 10 * static_cast<double>(random() % 6));
    for (std::size_t n = 0; n < rows; ++n)
      for (std::size_t k = 0; k < columns; ++k) {
        const double box = boxes[n / 29 * (columns / 8 + 1) + k / 8];
        const double along = static_cast<double>(n) / rows * cycles + phase + tilt * static_cast<double>(k) / columns;
        light.push_back(box * (1 + depth * std::cos(2 * std::numbers::pi * along)));
      }
  }
  std::vector<BandedPicture> colours() const { return {{light, variance, 1, rows, columns}}; }
};

}  // namespace

TEST_CASE("a slow tone is found in one picture, and no other") {
  const Boxes lit(2, 0.5, 0.1), even(2, 0, 0);
  const std::vector<std::vector<BandedPicture>> one{lit.colours()}, other{even.colours()};
  const SlowLight found = find_slow_lights(one).front();
  CHECK(found.objection.empty());
  CHECK(found.common.front().cycles == doctest::Approx(2).epsilon(0.1));
  CHECK(found.amplitude == doctest::Approx(0.5).epsilon(0.25));
  CHECK_FALSE(find_slow_lights(other).front().objection.empty());
}

TEST_CASE("tilted slow bands are not removed") {
  const Boxes tilted(2, 0.5, 0, 1);
  const std::vector<std::vector<BandedPicture>> frames{tilted.colours()};
  CHECK_FALSE(find_slow_lights(frames).front().objection.empty());
}

TEST_CASE("the light of tones has mean 1, and turns once in a cycle of steps") {
  const SlowTone tone{.cycles = 2, .step = std::numbers::pi / 2, .terms = {0.3, 0.1}};
  const std::vector<SlowTone> two{tone, {.cycles = 3, .step = {}, .terms = {0, 0.2}}};
  const std::vector<double> light = light_of(two, rows);
  double mean = 0;
  for (const double value : light) mean += value / rows;
  CHECK(mean == doctest::Approx(1));
  CHECK(std::ranges::min(light) > 1 - swing_of(two));
  CHECK(std::ranges::min(light) < 0.7);
  for (std::size_t k = 0; k < 2; ++k) CHECK(tone.in_frame(4).terms[k] == doctest::Approx(tone.terms[k]));
}

TEST_CASE("courses of other lengths and missing frames are refused") {
  const Boxes boxes(2, 0.5, 0);
  const std::vector<std::vector<BandedPicture>> frames{boxes.colours()}, none, empty{{}};
  const EarlierFrames other{{{{1, 2}, {1, 1}, {{1, 2}}}}, 1};
  CHECK_THROWS_AS(find_slow_lights(none), std::invalid_argument);
  CHECK_THROWS_AS(find_slow_lights(empty), std::invalid_argument);
  CHECK_THROWS_AS(find_slow_lights(frames, other), std::invalid_argument);
}

}  // namespace ocisac
