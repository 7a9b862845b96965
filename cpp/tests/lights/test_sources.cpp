#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

#include "lights/own_pixels.hpp"
#include "lights/screening.hpp"
#include "ocisac/lights/detect_sources.hpp"

namespace ocisac {
namespace {

constexpr std::size_t rows = 240, columns = 320;
constexpr double row_time = 1e-5;

// A dim picture with noise of a linear congruential generator and a square of light with 0.08 cycles per row.
std::vector<std::uint8_t> picture(bool lit) {
  std::vector<std::uint8_t> pixels(rows * columns);
  std::uint32_t state = 1;
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t c = 0; c < columns; ++c) {
      state = state * 1664525U + 1013904223U;
      double value = 30 + static_cast<double>(state >> 30);
      const bool inside = n >= 80 && n < 160 && c >= 100 && c < 180;
      if (lit && inside) value += 80 + 60 * std::cos(2 * std::numbers::pi * 0.08 * static_cast<double>(n));
      pixels[n * columns + c] = static_cast<std::uint8_t>(value);
    }
  return pixels;
}

Camera camera() {
  Camera one;
  one.row_time = row_time;
  return one;
}

TEST_CASE("screening gives the place and, roughly, the frequency") {
  const auto pixels = picture(true);
  const auto suspects =
      screen_sources(lit_frame(dense_view(pixels.data(), 1, rows, columns), 0, {}), {0, 0, columns, rows}, 0.01);
  REQUIRE_FALSE(suspects.empty());
  CHECK(suspects.front().frequency == doctest::Approx(0.08).epsilon(0.15));
  CHECK(suspects.front().box.x <= 100);
  CHECK(suspects.front().box.x + suspects.front().box.width >= 172);
}

TEST_CASE("a light is followed in its box, and searched for in its region where it is not") {
  const auto pixels = picture(true);
  const auto view = dense_view(pixels.data(), 1, rows, columns);
  const LightSource whole = detect_sources(view, camera()).front();
  const Region all{0, 0, columns, rows}, box = whole.box, away{0, 0, 40, 40};
  for (const ExpectedLight& expected :
       {ExpectedLight{box, 8000, all, true, false},
        ExpectedLight{{box.x + 6, box.y - 8, 60, 70}, 8100, all, true, false},
        ExpectedLight{away, 8000, all, true, false}, ExpectedLight{away, 8000, all, false, false},
        ExpectedLight{away, 5000, all, false, true}}) {
    const auto found = follow_sources(view, camera(), std::vector{expected});
    REQUIRE(found.size() == 1);
    CHECK(std::abs(static_cast<double>(found[0].box.x) - static_cast<double>(whole.box.x)) <= 5);
    CHECK(std::abs(static_cast<double>(found[0].box.y) - static_cast<double>(whole.box.y)) <= 2);
    CHECK(found[0].frequency == doctest::Approx(whole.frequency).epsilon(1e-3));
  }
  for (const ExpectedLight& expected :
       {ExpectedLight{away, 8000, away, true, false}, ExpectedLight{box, 20000, all, true, false}})
    CHECK(follow_sources(view, camera(), std::vector{expected}).empty());
  CHECK(follow_sources(view, camera(), {}).empty());
}

TEST_CASE("lights cannot be expected beyond the frame or without a frequency") {
  const auto pixels = picture(true);
  const auto view = dense_view(pixels.data(), 1, rows, columns);
  const Region all{0, 0, columns, rows}, beyond{300, 10, 30, 20}, none{5, 5, 0, 20};
  for (const ExpectedLight& expected :
       {ExpectedLight{beyond, 8000, all, true, false}, ExpectedLight{all, 8000, none, true, false},
        ExpectedLight{all, 0, all, true, false}, ExpectedLight{all, 50000, all, true, false}})
    CHECK_THROWS_AS(follow_sources(view, camera(), std::vector{expected}), std::invalid_argument);
  CHECK_THROWS_AS(follow_sources(dense_view(pixels.data(), 2, rows / 2, columns), camera(), {}), std::invalid_argument);
}

TEST_CASE("a short tone on a slope is measured without bias from its own pixels") {
  for (const double cycles : {2.5, 3.1, 3.7, 4.6})
    for (const double phase : {0.0, 1.1, 2.3, 4.0}) {
      constexpr std::size_t count = 45, groups = 3;
      const double frequency = cycles / count;
      OwnPixels pixels{std::vector<double>(count * groups), std::vector<std::uint8_t>(count * groups, 1),
                       std::vector<double>(count), std::vector<double>(count, groups)};
      for (std::size_t n = 0; n < count; ++n) {
        const auto row = static_cast<double>(n);
        pixels.profile[n] = 0.02 * row + std::cos(2 * std::numbers::pi * frequency * row + phase);
        for (std::size_t g = 0; g < groups; ++g) pixels.light[n * groups + g] = pixels.profile[n];
      }
      CHECK(strongest_frequency(pixels, 0.8 * frequency, 1.2 * frequency) == doctest::Approx(frequency).epsilon(1e-4));
      const RefinedLight light = refined_light(pixels, frequency, 0);
      CHECK(light.periodic == doctest::Approx(1).epsilon(1e-6));
      CHECK(light.texture < 1e-6);
      CHECK(light.frequency_std < 3e-4 * frequency);
    }
}

TEST_CASE("outline and frequency of a short lamp are found together, whatever lies around it") {
  constexpr std::size_t count = 90, groups = 8, first = 28, end = 64;
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise(0, 0.05);
  for (const double cycles : {2.9, 3.3, 4.4})
    for (const double ground : {-0.7, 0.0, 0.8})
      for (const double phase : {0.0, 1.1, 2.3, 4.0}) {
        const double frequency = cycles / (end - first);
        OwnPixels pixels{std::vector<double>(count * groups),
                         std::vector<std::uint8_t>(count * groups),
                         std::vector<double>(count),
                         std::vector<double>(count),
                         {5, 7, groups, count}};
        for (std::size_t n = 0; n < count; ++n)
          for (std::size_t g = 0; g < groups; ++g) {
            const bool lit = n >= first && n < end && g >= 1 && g < 7;
            const double angle = 2 * std::numbers::pi * frequency * static_cast<double>(n) + phase;
            pixels.light[n * groups + g] = (lit ? std::cos(angle) : ground) + noise(random);
            pixels.own[n * groups + g] = n >= first + 4 && n < end + 6 && g < 7;
          }
        OwnPixels raised = pixels;
        for (std::size_t i = 0; i < raised.light.size(); ++i)
          raised.light[i] += 3 * std::sin(static_cast<double>(i % groups));
        const auto found = fit_outline(pixels, 1.05 * frequency);
        CHECK(fit_outline(raised, 1.05 * frequency).value_or(0) ==
              doctest::Approx(found.value_or(1)));  // levels of groups
        CHECK(raised.own == pixels.own);
        CAPTURE(cycles);
        CAPTURE(ground);
        CAPTURE(phase);
        REQUIRE(found);
        CHECK(*found == doctest::Approx(frequency).epsilon(0.01));
        const Region box = own_box(pixels);
        CHECK(box.x >= 6);  // groups beside the ground may be lost
        CHECK(box.right() <= 12);
        CHECK(box.width >= 4);
        CHECK(std::abs(static_cast<double>(box.y) - (7 + first)) <= 2);
        CHECK(std::abs(static_cast<double>(box.bottom()) - (7 + end)) <= 2);
      }
}

}  // namespace
}  // namespace ocisac
