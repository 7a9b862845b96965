#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

#include "ocisac/exposure/exposure_controller.hpp"

namespace {

using namespace ocisac;
namespace reason = exposure_reason;

double on_a_grid(std::span<const WeightedTone> tones, double noise, const ExposureWindow& window, int points) {
  double best = 0;
  for (int j = 0; j <= points; ++j) {
    const double exposure = window.low + (window.high - window.low) * j / points;
    double sum = 0;
    for (const auto& [f, w] : tones) sum += w * std::abs(std::sin(std::numbers::pi * f * exposure)) / f;
    best = std::max(best, sum / std::numbers::pi / std::sqrt(1 + exposure / noise));
  }
  return best;
}

ExposureControllerOptions camera() {
  ExposureControllerOptions options;
  options.range = {20e-6, 10e-3, 20e-6};
  options.highest_gain = 8;
  return options;
}

}  // namespace

TEST_CASE("the best exposure over noise is no worse than a grid, and that of no noise is eq. 18's") {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> frequency(50, 5000), weight(0, 1), log_noise(-11, -2);
  for (int trial = 0; trial < 100; ++trial) {
    std::vector<WeightedTone> tones;
    for (int i = 0; i <= trial % 4; ++i) tones.push_back({frequency(random), weight(random) + 1e-3});
    const double noise = trial % 5 == 0 ? std::numeric_limits<double>::infinity() : std::exp(log_noise(random));
    const ExposureWindow window{1e-5, 2e-2};
    const BestExposure best = best_noisy_exposure(tones, noise, window);
    CHECK(best.objective >= on_a_grid(tones, noise, window, 20000) * (1 - 1e-12));
    CHECK(best.objective == noisy_exposure_objective(tones, noise, best.exposure));
    const BestExposure stepped = best_noisy_exposure(tones, noise, {1e-5, 2e-2, 1e-5});
    CHECK(stepped.objective >= on_a_grid(tones, noise, window, 1999) * (1 - 1e-12));
    CHECK(stepped.objective <= best.objective);
    if (std::isfinite(noise)) continue;
    std::vector<double> f, w;
    for (const auto& tone : tones) {
      f.push_back(tone.frequency);
      w.push_back(tone.weight);
    }
    const BestExposure plain = best_exposure_exact(f, w, {.bounds = {{1e-5, 2e-2}}, .step = {}});
    CHECK(best.objective == doctest::Approx(plain.objective).epsilon(1e-12));
  }
}

TEST_CASE("the controller moves where it pays, holds where it does not, and never loses more than its hysteresis") {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> drift(-1, 1);
  ExposureController controller(camera());
  double speed = 300;
  int moves = 0;
  for (int frame = 0; frame < 400; ++frame) {
    speed *= 1 + 0.01 * drift(random);
    const std::array tones{MeasuredTone{500 + drift(random)}, MeasuredTone{speed, ToneKind::sensing}};
    const ExposureSuggestion next = controller.update({.tones = tones, .level = 0.3, .peak = 0.5});
    CHECK(next.objective * 1.01 >= next.best_objective);
    CHECK(next.exposure >= next.low * 0.98);
    CHECK(next.exposure <= next.high * 1.02);
    if (next.reasons & reason::moved) ++moves;
    CHECK(((next.reasons & reason::first) != 0) == (frame == 0));
  }
  CHECK(moves > 0);
  CHECK(moves < 200);
}

TEST_CASE("saturation shortens the exposure and does not return at once; darkness lengthens it") {
  ExposureController controller(camera());
  const std::array tones{MeasuredTone{100}};
  double exposure = controller.update({.tones = tones}).exposure;
  CHECK(exposure == doctest::Approx(5e-3));
  const double radiance = 1.2 / 4e-3;  // a mean of 0.9 is reached at 3 ms
  int saturated = 0;
  for (int frame = 0; frame < 60; ++frame) {
    const double level = radiance * exposure;
    const bool clipped = level > 0.9;
    saturated += clipped;
    const ExposureSuggestion next = controller.update({.tones = tones, .level = level, .saturated = clipped ? 0.5 : 0});
    exposure = next.exposure;
    CHECK(next.gain == doctest::Approx(1));
  }
  CHECK(saturated == 2);
  controller.reset();
  const auto dark = controller.update({.tones = tones, .exposure = 1e-4, .gain = 1, .level = 1e-6});
  CHECK((dark.reasons & reason::too_dark) != 0);
  CHECK(dark.exposure == doctest::Approx(10e-3));
  CHECK(dark.gain == 8);
}

TEST_CASE("options and measurements without meaning are refused") {
  auto options = camera();
  options.hysteresis = -1;
  CHECK_THROWS_AS(ExposureController{options}, std::invalid_argument);
  options = camera();
  options.range = {1e-3, 1.5e-3, 1e-2};
  CHECK_THROWS_AS(ExposureController{options}, std::invalid_argument);
  ExposureController controller(camera());
  ExposureMeasurement measurement;
  measurement.saturated = 2;
  CHECK_THROWS_AS(controller.update(measurement), std::invalid_argument);
  const std::vector<MeasuredTone> many(33, MeasuredTone{100});
  measurement = {.tones = many};
  CHECK_THROWS_AS(controller.update(measurement), std::invalid_argument);
  const std::array tone{WeightedTone{100, 1}};
  const ExposureWindow window{1e-3, 1e-2}, backwards{2e-3, 1e-3};
  CHECK_THROWS_AS(best_noisy_exposure(tone, 0, window), std::invalid_argument);
  CHECK_THROWS_AS(best_noisy_exposure(tone, 1, backwards), std::invalid_argument);
}
