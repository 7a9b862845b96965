// Outline and tone of a short light in log light, the slowest step of a lamp's detection; checked by truth before
// timing.
#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include "lights/own_pixels.hpp"

namespace {

// A round lamp of 4.5 cycles on a textured ground, in a patch twice as high; its box is known to a tenth.
ocisac::OwnPixels lamp(std::size_t rows, std::size_t groups) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise(0, 1);
  const double frequency = 9.0 / static_cast<double>(rows);
  ocisac::OwnPixels pixels{std::vector<double>(rows * groups),
                           std::vector<std::uint8_t>(rows * groups),
                           std::vector<double>(rows),
                           std::vector<double>(rows),
                           {0, 0, groups, rows}};
  std::vector<double> ground(groups);
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t g = 0; g < groups; ++g) {
      const double down = 4 * (static_cast<double>(n) + 0.5) / static_cast<double>(rows) - 2;
      const double right = 2 * (static_cast<double>(g) + 0.5) / static_cast<double>(groups) - 1;
      ground[g] += 0.02 * noise(random);
      const double tone = std::sin(2 * std::numbers::pi * frequency * static_cast<double>(n));
      const bool lit = down * down + right * right < 1;
      pixels.light[n * groups + g] = (lit ? 1 + tone : ground[g]) + 0.05 * noise(random);
      pixels.own[n * groups + g] = std::abs(down) < 0.9 && std::abs(right) < 0.9;
    }
  return pixels;
}

void fit_outline(benchmark::State& state) {
  const auto rows = static_cast<std::size_t>(state.range(0)), groups = static_cast<std::size_t>(state.range(1));
  const double frequency = 9.0 / static_cast<double>(rows);
  const ocisac::OwnPixels start = lamp(rows, groups);
  ocisac::OwnPixels pixels = start;
  const auto found = ocisac::fit_outline(pixels, 1.03 * frequency);
  if (!found || !(std::abs(*found / frequency - 1) < 0.005)) return state.SkipWithError("another frequency");
  for (auto _ : state) {
    pixels = start;
    benchmark::DoNotOptimize(ocisac::fit_outline(pixels, 1.03 * frequency));
  }
}
BENCHMARK(fit_outline)->Args({120, 12})->Args({480, 15})->Unit(benchmark::kMicrosecond);

void light_of(benchmark::State& state) {
  ocisac::OwnPixels pixels = lamp(120, 12);
  const auto found = ocisac::fit_outline(pixels, 0.075);
  if (!found) return state.SkipWithError("no outline");
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::light_of(pixels, *found, 0.0025));
}
BENCHMARK(light_of)->Unit(benchmark::kMicrosecond);

}  // namespace
