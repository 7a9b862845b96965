#include <doctest/doctest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <numbers>
#include <random>

#include "ocisac/exposure/best_exposure.hpp"

namespace {

double on_a_grid(std::array<double, 2> f, std::array<double, 2> w, double longest) {
  double best = 0;
  for (int j = 1; j <= 20000; ++j) {
    const double exposure = longest * j / 20000;
    double sum = 0;
    for (int i = 0; i < 2; ++i) sum += w[i] * std::abs(std::sin(std::numbers::pi * f[i] * exposure)) / f[i];
    best = std::max(best, sum / std::numbers::pi);
  }
  return best;
}

}  // namespace

TEST_CASE("the exact exposure is no worse than a grid, in constant time and lobe by lobe") {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> frequency(20, 5000), weight(0.01, 10);
  for (int trial = 0; trial < 200; ++trial) {
    const std::array f{frequency(random), frequency(random)}, w{weight(random), weight(random)};
    const double longest = 1 / std::min(f[0], f[1]);
    const auto best = ocisac::best_exposure_exact(f[0], f[1], w[0], w[1]);
    CHECK(best.exposure > 0);
    CHECK(best.exposure <= longest);
    CHECK(best.objective >= on_a_grid(f, w, longest) * (1 - 1e-14));
    CHECK(best.objective == ocisac::exposure_objective(f, w, best.exposure));
    const auto by_lobes = ocisac::best_exposure_exact(f, w, {.bounds = {{0, longest}}, .step = {}});
    CHECK(by_lobes.objective == doctest::Approx(best.objective).epsilon(1e-13));
  }
}

TEST_CASE("two tones take less than a microsecond") {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> frequency(20, 5000);
  const auto start = std::chrono::steady_clock::now();
  double sum = 0;
  for (int trial = 0; trial < 100000; ++trial)
    sum += ocisac::best_exposure_exact(frequency(random), frequency(random), 1, 1).exposure;
  const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - start;
  CHECK(sum > 0);
  WARN(spent.count() < 0.1);  // may be slower on busy machines and with sanitizers
}

TEST_CASE("bounds, steps and refusals of the exposure choice") {
  const std::array f{500.0, 350.0, 175.0}, w{1.0, 2.0, 0.0};
  const auto stepped = ocisac::best_exposure_exact(f, w, {.bounds = {{1e-3, 4e-3}}, .step = 22.2e-6});
  const auto searched = ocisac::best_exposure_search(f, w, {.bounds = {{1e-3, 4e-3}}, .step = 22.2e-6});
  CHECK(stepped.objective == doctest::Approx(searched.objective).epsilon(1e-14));
  CHECK(ocisac::best_exposure_closed_form(200, 100).exposure == 0.5 / 200);
  CHECK(ocisac::best_exposure_closed_form(700, 100).exposure == 3.5 / 700);
  CHECK_THROWS_AS(ocisac::best_exposure_exact(0, 100, 1, 1), std::invalid_argument);
  CHECK_THROWS_AS(ocisac::best_exposure_exact(100, 100, 0, 0), std::invalid_argument);
  CHECK_THROWS_AS(ocisac::best_exposure_exact(f, w, {.bounds = {{2, 1}}, .step = {}}), std::invalid_argument);
  CHECK_THROWS_AS(ocisac::best_exposure_exact(f, w, {.bounds = {{0, 1e6}}, .step = {}}), std::invalid_argument);
  CHECK_THROWS_AS(ocisac::best_exposure_exact(f, w, {.bounds = {}, .step = 1.0}), std::invalid_argument);
  CHECK_THROWS_AS(ocisac::best_exposure_search(f, w, {}, 1), std::invalid_argument);
}
