// Row signals of a lamp in the field: profile, lit rows, other light, slope. Each case is checked by truth before
// timing.
#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

#include "chips/lit_rows.hpp"
#include "columns/lamp_slope.hpp"
#include "frames.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "ocisac/chips/row_profile.hpp"
#include "ocisac/light/integrate_exposure.hpp"

namespace {

using bench::kRows;

constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kTone = 0.031;  // cycles per row
constexpr std::size_t kProfileFrames = 12, kSmooth = 40, kBlocks = 40;

// Chips of 5.6 rows, an exposure of 5 chips; `frame` selects other chips.
std::vector<double> exposed(std::size_t frame) {
  std::vector<double> levels = bench::noise<double>(4096, 7);
  for (double& level : levels) level = level < 128 ? 0 : 1;
  std::vector<std::int64_t> rows(kRows);
  std::iota(rows.begin(), rows.end(), 0);
  std::vector<double> light(kRows);
  const ocisac::Camera camera{1.0, 28.0, 1500.0, {}};
  ocisac::integrate_exposure(ocisac::Chips{levels, 1 / 5.6, 0, true}, camera, rows, 50,
                             static_cast<std::int64_t>(frame), light);
  return light;
}

double swing_at(std::size_t row) { return 100 * std::exp(-0.5 * std::pow((static_cast<double>(row) - 500) / 400, 2)); }

struct Recording {
  std::vector<std::vector<double>> exposed, signals;
  std::vector<double> shape;
  std::vector<ocisac::ProfileFrame> frames;
};

const Recording& recording() {
  static const Recording made = [] {
    Recording recording;
    for (std::size_t row = 0; row < kRows; ++row) recording.shape.push_back(swing_at(row));
    for (std::size_t frame = 0; frame < kProfileFrames; ++frame) {
      recording.exposed.push_back(exposed(frame));
      recording.signals.emplace_back();
      for (std::size_t row = 0; row < kRows; ++row)
        recording.signals.back().push_back(30 + swing_at(row) * recording.exposed.back()[row]);
    }
    for (std::size_t frame = 0; frame < kProfileFrames; ++frame)
      recording.frames.push_back({recording.signals[frame], recording.exposed[frame]});
    return recording;
  }();
  return made;
}

// Chips with hum and a tone.
std::vector<double> hummed() {
  std::vector<double> signal = recording().exposed.front();
  for (std::size_t row = 0; row < kRows; ++row) {
    const auto n = static_cast<double>(row);
    signal[row] = 30 + 100 * signal[row] + 30 * std::sin(kTurn * 0.0022 * n) + 40 * std::cos(kTurn * kTone * n);
  }
  return signal;
}

void first_profile(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::first_profile(recording().frames, kSmooth));
}
BENCHMARK(first_profile)->Unit(benchmark::kMicrosecond);

void fit_profile(benchmark::State& state) {
  const auto fitted = ocisac::fit_profile(recording().frames, recording().shape, kSmooth, 0.5);
  if (!fitted || !(std::abs(fitted->swing[500] - 100) < 1e-6)) return state.SkipWithError("wrong profile");
  for (auto _ : state)
    benchmark::DoNotOptimize(ocisac::fit_profile(recording().frames, recording().shape, kSmooth, 0.5));
}
BENCHMARK(fit_profile)->Unit(benchmark::kMicrosecond);

void lit_rows(benchmark::State& state) {
  std::vector<double> signal = recording().exposed.front();
  for (std::size_t row = 0; row < kRows; ++row)
    if (row < 300 || row >= 780) signal[row] = 0;
  const auto found = ocisac::lit_rows(signal, 0.01).rows;
  if (found.begin < 299 || found.begin > 360 || found.end < 720 || found.end > 781)
    return state.SkipWithError("other rows than the lamp's");
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::lit_rows(signal, 0.01));
}
BENCHMARK(lit_rows)->Unit(benchmark::kMicrosecond);

void remove_nuisance(benchmark::State& state) {
  const auto signal = hummed();
  const auto& chips = recording().exposed.front();
  const ocisac::RowNuisance nuisance{0.012, {kTone}};
  const auto fit = ocisac::remove_nuisance(signal, nuisance, chips);
  if (!fit || !(fit->squares < 1e-3 * 900 * kRows)) return state.SkipWithError("hum is left");
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::remove_nuisance(signal, nuisance, chips));
}
BENCHMARK(remove_nuisance)->Unit(benchmark::kMicrosecond);

void strongest_tone(benchmark::State& state) {
  const auto signal = hummed();
  if (!(std::abs(ocisac::strongest_tone(signal, kRows, 0.02, 0.4).frequency - kTone) < 0.5 / kRows))
    return state.SkipWithError("another tone");
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::strongest_tone(signal, kRows, 0.02, 0.4));
}
BENCHMARK(strongest_tone)->Unit(benchmark::kMicrosecond);

void without_square_wave(benchmark::State& state) {
  std::vector<double> signal(kRows);
  for (std::size_t row = 0; row < kRows; ++row) signal[row] = std::fmod(kTone * static_cast<double>(row), 1) < 0.5;
  for (const double value : ocisac::without_square_wave(signal, kTone))
    if (!(std::abs(value - 0.5) < 1e-9)) return state.SkipWithError("a wave is left");
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::without_square_wave(signal, kTone));
}
BENCHMARK(without_square_wave)->Unit(benchmark::kMicrosecond);

void lamp_slope(benchmark::State& state) {
  const double slope = 0.1;
  std::vector<double> swings, centres;
  for (std::size_t block = 0; block < kBlocks; ++block) {
    centres.push_back(8 * static_cast<double>(block) + 3.5);
    for (std::size_t row = 0; row < kRows; ++row) {
      const double middle = 159.5 + slope * (static_cast<double>(row) - 539.5);
      const double share = std::exp(-0.5 * std::pow((centres.back() - middle) / 16, 2));
      swings.push_back(share * (recording().exposed.front()[row] - 0.5));
    }
  }
  if (!(std::abs(ocisac::lamp_slope(swings, centres) - slope) < 0.01 * slope))
    return state.SkipWithError("another slope");
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::lamp_slope(swings, centres));
}
BENCHMARK(lamp_slope)->Unit(benchmark::kMicrosecond);

}  // namespace
