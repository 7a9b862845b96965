#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

#include "ocisac/tones/find_frequency.hpp"
#include "ocisac/tones/periodic_fit.hpp"
#include "rows/verdict.hpp"
#include "tones/tone_combination.hpp"

namespace {

constexpr double two_pi = 2 * std::numbers::pi;

ocisac::AnyFramesView view(const std::vector<double>& pixels, std::size_t rows, std::size_t columns) {
  return ocisac::dense_view(pixels.data(), 1, rows, columns);
}

}  // namespace

TEST_CASE("a Gauss-Newton step leads to the least residual energy") {
  std::vector<double> signal;
  for (std::size_t n = 0; n < 100; ++n) {
    const double cycles = 0.0417 * static_cast<double>(n);
    signal.push_back(std::sin(two_pi * cycles) + 0.3 * std::cos(3 * two_pi * cycles + 1) + 0.01 * std::sin(n * n));
  }
  const ocisac::PeriodicModel model{2, {1, 3}};
  const ocisac::PeriodicSignals prepared(signal, 100);
  const auto refined = [&](double start, double lower) {
    return ocisac::refine_periodic(prepared, ocisac::fit_periodic(prepared, model, start), lower, 0.4);
  };
  const auto best = refined(0.0412, 0.01);
  CHECK(best.frequency == doctest::Approx(0.0417).epsilon(1e-3));
  for (const double aside : {-1e-5, 1e-5})
    CHECK(ocisac::fit_periodic({signal, 100}, model, best.frequency + aside).total_residual() > best.total_residual());
  CHECK(refined(0.05, 0.043).frequency == 0.043);
  CHECK_THROWS_AS(ocisac::fit_periodic({signal, 5}, model, 0.1), std::invalid_argument);
}

// The harmonic is the strongest line, whose misfit a fundamental between two lines of the spectrum has to undercut.
TEST_CASE("a fundamental explains more than its strongest harmonic, wherever it lies between the lines of a spectrum") {
  const std::size_t rows = 400, count = 8;
  for (const double cycles : {7.0, 12.1, 12.25, 12.4, 30.3}) {
    std::vector<double> pixels(rows * count);
    std::mt19937 random(4);
    std::normal_distribution<double> normal(0, 0.1);
    for (std::size_t n = 0; n < rows; ++n)
      for (std::size_t k = 0; k < count; ++k) {
        const double turns = cycles * static_cast<double>(n) / static_cast<double>(rows) + 0.1 * static_cast<double>(k);
        pixels[n * count + k] =
            5 + std::cos(two_pi * turns) + 1.5 * std::cos(3 * two_pi * turns + 0.4) + normal(random);
      }
    const auto found = ocisac::find_frequency(view(pixels, rows, count), {});
    CAPTURE(cycles);
    CHECK(std::abs(found.frequency * static_cast<double>(rows) - cycles) < 0.02);
    CHECK(found.harmonics == 3);
  }
}

TEST_CASE("combined columns keep the power of the noise and all of the tone") {
  const std::size_t rows = 400, count = 6;
  for (const double phase_step : {0.0, 1.1}) {
    std::vector<double> signals(rows * count);
    std::mt19937 random(3);
    std::normal_distribution<double> normal(0, 0.2);
    for (std::size_t k = 0; k < count; ++k)
      for (std::size_t n = 0; n < rows; ++n)
        signals[k * rows + n] =
            std::cos(two_pi * 0.051 * static_cast<double>(n) + phase_step * static_cast<double>(k)) + normal(random);
    const auto model = ocisac::periodic_model(0.051, rows, 1);
    const auto apart = ocisac::fit_periodic({signals, rows}, model, 0.051);
    const auto combined = ocisac::combine_by_tone(signals, rows, count, apart);
    const std::size_t per_frame = combined.signals.size() / rows;
    CHECK(per_frame == (phase_step == 0 ? 1 : 2));
    const auto together = ocisac::fit_periodic({combined.signals, rows}, model, 0.051);
    CHECK(together.harmonic_energy[0] == doctest::Approx(apart.harmonic_energy[0]).epsilon(0.002));
    const double spare = static_cast<double>(per_frame * (rows - model.parameters()));
    CHECK(together.total_residual() / spare == doctest::Approx(0.04).epsilon(0.25));
  }
}

TEST_CASE("chance energies are those of the chi-squared distribution") {
  CHECK(ocisac::chance_energy(2) == doctest::Approx(-2 * std::log(0.79e-6)).epsilon(0.12));  // exact: −2·log(p)
  CHECK(ocisac::chance_energy(1000) == doctest::Approx(1000 + 4.8 * std::sqrt(2000.0)).epsilon(0.02));
}
