// Outline and tone of a short light in log light, the slowest step of a lamp's detection, and the recognition of a lamp
// in a 1080p frame; checked by truth before timing.
#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include "frames.hpp"
#include "lights/own_pixels.hpp"
#include "ocisac/lights/known_light.hpp"

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

// A lamp of 500 rows and a tone of 45 rows a cycle.
void find_known_light(benchmark::State& state) {
  constexpr std::size_t kLamp = 500, kFirst = 300;
  std::vector<std::uint8_t> pixels = bench::noise<std::uint8_t>(bench::kRows * bench::kColumns);
  for (std::size_t row = 0; row < bench::kRows; ++row)
    for (std::size_t column = 0; column < bench::kColumns; ++column) {
      std::uint8_t& pixel = pixels[row * bench::kColumns + column];
      pixel /= 16;
      if (row - kFirst < kLamp && column - kFirst < kLamp)
        pixel += static_cast<std::uint8_t>(100 + 60 * std::sin(2 * std::numbers::pi * static_cast<double>(row) / 45));
    }
  const auto frame = ocisac::as_const(ocisac::dense_view(pixels.data(), 1, bench::kRows, bench::kColumns));
  const ocisac::Camera camera{.row_time = 1e-5};
  const ocisac::KnownLight light(frame, camera, {kFirst, kFirst, kLamp, kLamp}, 1e5 / 45, false);
  const std::vector<ocisac::Place> places{{kFirst, kFirst}};
  const auto found = light.find(frame, places);
  if (!found || !(std::abs(found->swing - 1) < 1e-9)) return state.SkipWithError("not recognised");
  for (auto _ : state) benchmark::DoNotOptimize(light.find(frame, places));
}
BENCHMARK(find_known_light)->Unit(benchmark::kMicrosecond);

}  // namespace
