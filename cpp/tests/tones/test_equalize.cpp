#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "ocisac/light/exposure_response.hpp"
#include "ocisac/tones/equalize.hpp"

namespace {

ocisac::Camera camera_of(double exposure_rows) { return {1e-5, exposure_rows * 1e-5, {}, {}}; }

std::vector<double> equalised(const std::vector<double>& seen, std::size_t columns, const ocisac::Camera& camera,
                              const ocisac::EqualizerSettings& settings = {}) {
  const std::size_t rows = seen.size() / columns;
  std::vector<double> out(seen.size(), std::numeric_limits<double>::quiet_NaN());
  ocisac::equalize(ocisac::dense_view(seen.data(), 1, rows, columns), camera, settings,
                   ocisac::dense_view(out.data(), 1, rows, columns));
  return out;
}

}  // namespace

TEST_CASE("the equaliser restores tones in the interior") {
  const std::size_t rows = 1080;
  const double exposure_rows = 17.3;
  for (double frequency : {0.011, 0.031, 0.085}) {
    const double x = frequency * exposure_rows;
    REQUIRE(std::abs(ocisac::sinc(x)) > 0.2);
    std::vector<double> seen(rows);
    const auto angle = [&](std::size_t n) { return 2 * std::numbers::pi * frequency * static_cast<double>(n) + 0.3; };
    for (std::size_t n = 0; n < rows; ++n) seen[n] = ocisac::sinc(x) * std::cos(angle(n) - std::numbers::pi * x);
    const auto light = equalised(seen, 1, camera_of(exposure_rows));
    for (std::size_t n = 400; n < 680; ++n) CHECK(std::abs(light[n] - std::cos(angle(n))) < 0.01);
  }
}

TEST_CASE("equalised constants and ramps are exact for any number of rows") {
  for (std::size_t rows : {1u, 2u, 3u, 31u, 720u})
    for (auto method : {ocisac::EqualizerMethod::inverse, ocisac::EqualizerMethod::wiener}) {
      const double exposure_rows = 0.7 * static_cast<double>(rows), slope = rows > 1 ? 0.25 : 0;
      std::vector<double> seen(2 * rows);
      for (std::size_t n = 0; n < rows; ++n) {
        seen[2 * n] = 100;
        seen[2 * n + 1] = slope * (static_cast<double>(n) - exposure_rows / 2);
      }
      const auto light = equalised(seen, 2, camera_of(exposure_rows), {.method = method, .max_boost = 10, .noise = {}});
      for (std::size_t n = 0; n < rows; ++n) {
        CHECK(light[2 * n] == doctest::Approx(100).epsilon(1e-13));
        CHECK(std::abs(light[2 * n + 1] - slope * static_cast<double>(n)) < 1e-12 * static_cast<double>(rows));
      }
    }
}

TEST_CASE("frequencies lost are those of a small sinc, and refusals of the equaliser") {
  const auto bands = ocisac::lost_frequencies(camera_of(28), 10);
  REQUIRE(bands.size() > 3);
  for (const auto& band : bands)
    if (band.high < 5e4) {
      CHECK(std::abs(ocisac::sinc(band.low * 28e-5)) == doctest::Approx(0.1 / std::numbers::sqrt2));
      CHECK(std::abs(ocisac::sinc(band.high * 28e-5)) == doctest::Approx(0.1 / std::numbers::sqrt2));
    }
  CHECK(bands.back().high == std::numeric_limits<double>::infinity());
  const std::vector<double> seen(20, 1.0), noise(3, 1.0);
  CHECK_THROWS_AS(equalised(seen, 2, {1e-5, {}, {}, {}}), std::invalid_argument);
  CHECK_THROWS_AS(equalised(seen, 2, camera_of(2), {.max_boost = 0.5, .noise = {}}), std::invalid_argument);
  CHECK_THROWS_AS(equalised(seen, 2, camera_of(2), {.noise = noise}), std::invalid_argument);
}
