// The lamp's profile along the rows, from several frames.
#include <doctest/doctest.h>

#include <cmath>
#include <random>
#include <vector>

#include "ocisac/chips/row_profile.hpp"

namespace {

constexpr std::size_t kRows = 400, kFrames = 12;

struct Frames {
  std::vector<double> dark, swing;
  std::vector<std::vector<double>> signals, exposed;

  [[nodiscard]] std::vector<ocisac::ProfileFrame> views() const {
    std::vector<ocisac::ProfileFrame> frames;
    for (std::size_t f = 0; f < signals.size(); ++f) frames.push_back({signals[f], exposed[f]});
    return frames;
  }
};

// A spot on a textured wall: reflectance scales the lamp's light and the steady light.
Frames textured_frames(double noise) {
  std::mt19937 random(5);
  std::normal_distribution<double> gauss;
  std::uniform_real_distribution<double> uniform;
  Frames frames;
  for (std::size_t n = 0; n < kRows; ++n) {
    const double reflectance = std::exp(0.2 * std::sin(0.37 * static_cast<double>(n)) + 0.1 * gauss(random));
    const double off = (static_cast<double>(n) - 200) / 150;
    frames.swing.push_back(100 * reflectance * std::exp(-0.5 * off * off));
    frames.dark.push_back(30 * reflectance);
  }
  for (std::size_t f = 0; f < kFrames; ++f) {
    frames.signals.emplace_back();
    frames.exposed.emplace_back();
    for (std::size_t n = 0; n < kRows; ++n) {
      frames.exposed[f].push_back(uniform(random));
      frames.signals[f].push_back(frames.dark[n] + frames.swing[n] * frames.exposed[f][n] + noise * gauss(random));
    }
  }
  return frames;
}

}  // namespace

TEST_CASE("the first profile follows texture and spot") {
  const auto frames = textured_frames(0);
  const auto first = ocisac::first_profile(frames.views(), 40);
  REQUIRE(first);
  double ratio = 0, squares = 0;
  for (std::size_t n = 0; n < kRows; ++n) ratio += first->swing[n] / frames.swing[n] / kRows;
  for (std::size_t n = 0; n < kRows; ++n) squares += std::pow(first->swing[n] / frames.swing[n] / ratio - 1, 2) / kRows;
  CHECK(std::sqrt(squares) < 0.25);  // 12 frames of rows whose chips are independent
  const auto views = frames.views();
  CHECK(!ocisac::first_profile(std::span<const ocisac::ProfileFrame>(views.data(), 1), 40));
}

TEST_CASE("dark and swing of known chips are exact without noise, and their error is that of least squares with it") {
  for (const double noise : {0.0, 0.5}) {
    const auto frames = textured_frames(noise);
    const std::vector<double> shape(kRows, 1.0);
    const auto fitted = ocisac::fit_profile(frames.views(), shape, 40, 0);
    REQUIRE(fitted);
    double squares = 0;
    for (std::size_t n = 0; n < kRows; ++n) squares += std::pow(fitted->swing[n] - frames.swing[n], 2) / kRows;
    const double expected = noise / std::sqrt(kFrames / 12.0);
    CHECK(std::sqrt(squares) < 1.3 * expected + 1e-9);
    const auto rest = ocisac::without_profile(frames.signals[3], *fitted, {10, 300});
    for (std::size_t n = 0; n < rest.size() && noise == 0; ++n)
      CHECK(rest[n] == doctest::Approx(frames.exposed[3][n + 10]));
  }
}

TEST_CASE("a heavy prior keeps the shape, and rows without it stay dark") {
  const auto frames = textured_frames(0);
  auto shape = frames.swing;
  for (double& value : shape) value *= 3;
  shape[7] = 0;
  const auto fitted = ocisac::fit_profile(frames.views(), shape, 40, 1e6);
  REQUIRE(fitted);
  CHECK(fitted->swing[7] == 0);
  CHECK(fitted->swing[100] == doctest::Approx(frames.swing[100]));
  CHECK(ocisac::profile_rows(*fitted, 0.5).begin > 7);
}
