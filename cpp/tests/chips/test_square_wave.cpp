// Another lamp's square wave, and light beside a lamp whose rows are divided by its profile.
#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <random>
#include <stdexcept>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "ocisac/light/integrate_exposure.hpp"

namespace {

constexpr std::size_t kRows = 1080;

// Deviation from the mean, RMS.
double spread(const std::vector<double>& values) {
  double sum = 0, squares = 0;
  for (const double value : values) sum += value, squares += value * value;
  const auto count = static_cast<double>(values.size());
  return std::sqrt(squares / count - std::pow(sum / count, 2));
}

std::vector<double> chips(std::mt19937& random) {
  std::vector<double> rows;
  while (rows.size() < kRows) rows.resize(rows.size() + 6, static_cast<double>(random() & 1U));
  return rows;
}

}  // namespace

TEST_CASE("an exposed square wave beside chips is removed to a fraction of its ramps") {
  ocisac::Camera camera;
  camera.row_time = 1;
  camera.exposure = 3;
  const ocisac::Waveform wave = ocisac::SquareWave{0.02221, 0.5, 45.0, 0.0};
  std::vector<std::int64_t> rows(kRows);
  std::iota(rows.begin(), rows.end(), 0);
  std::vector<double> alone(kRows);
  ocisac::integrate_exposure(wave, camera, rows, 17.3, 0, alone);
  const double swing = spread(alone), sharp = spread(ocisac::without_square_wave(alone, 0.0223));
  CHECK(spread(ocisac::without_square_wave(alone, 0.0223, 3)) < 0.03 * swing);
  CHECK(spread(ocisac::without_square_wave(alone, 0.0223, 3)) < 0.3 * sharp);
  CHECK(spread(ocisac::without_square_wave(std::vector<double>(kRows, 7.0), 0.0223, 3)) == doctest::Approx(0));
}

TEST_CASE("hum beside a lamp is removed where rows are divided by the lamp's profile") {
  std::mt19937 random(3);
  const std::vector<double> exposed = chips(random);
  std::vector<double> scale, signal;
  for (std::size_t row = 0; row < kRows; ++row) {
    const auto n = static_cast<double>(row);
    scale.push_back(std::exp(0.5 * std::pow((n - 500) / 250, 2)));
    signal.push_back(exposed[row] + 0.3 * std::sin(2 * std::numbers::pi * 0.00222 * n + 0.4) * scale[row]);
  }
  const auto fit = ocisac::remove_nuisance(signal, {0, {0.00222}, scale}, exposed);
  REQUIRE(fit);
  for (std::size_t row = 0; row < kRows; ++row) CHECK(std::abs(fit->rest[row] - exposed[row]) < 1e-9);
  CHECK_THROWS_AS(ocisac::remove_nuisance(signal, {0, {0.00222}, {1, 2}}, exposed), std::invalid_argument);
}
