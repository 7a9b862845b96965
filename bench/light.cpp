// Exposure integration of every waveform, 1080 rows per call, against the mean of 20000 samples of one exposure.
#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdint>
#include <numeric>
#include <vector>

#include "frames.hpp"
#include "ocisac/light/integrate_exposure.hpp"

namespace {

const ocisac::Camera kCamera{22.2e-6, 1202e-6, {}, {}};

// Mean of samples over the exposure of the row; steps of the light give errors of order step/samples.
double oversampled(const ocisac::Waveform& waveform, std::int64_t row) {
  constexpr int kSamples = 20000;
  std::vector<double> times(kSamples), values(kSamples);
  for (int i = 0; i < kSamples; ++i)
    times[static_cast<std::size_t>(i)] =
        static_cast<double>(row) * kCamera.row_time - (i + 0.5) / kSamples * *kCamera.exposure;
  ocisac::sample_waveform(waveform, times, values);
  return std::accumulate(values.begin(), values.end(), 0.0) / kSamples;
}

void integrate(benchmark::State& state, const ocisac::Waveform& waveform) {
  std::vector<std::int64_t> rows(bench::kRows);
  std::iota(rows.begin(), rows.end(), 0);
  std::vector<double> out(rows.size());
  ocisac::integrate_exposure(waveform, kCamera, rows, 0, 0, out);
  for (std::size_t row = 0; row < rows.size(); row += 97)
    if (!(std::abs(out[row] - oversampled(waveform, rows[row])) < 2e-3)) return state.SkipWithError("wrong integral");
  for (auto _ : state) {
    ocisac::integrate_exposure(waveform, kCamera, rows, 0, 0, out);
    benchmark::DoNotOptimize(out.data());
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations()) * static_cast<std::int64_t>(rows.size()));
}

std::vector<double> levels(std::size_t count) {
  std::vector<double> values = bench::noise<double>(count);
  for (double& value : values) value = value < 128 ? 0 : 1;
  return values;
}

const ocisac::Tone kTone{500};
const ocisac::SquareWave kSquare{500};

BENCHMARK_CAPTURE(integrate, tone, kTone);
BENCHMARK_CAPTURE(integrate, square_wave, kSquare);
BENCHMARK_CAPTURE(integrate, chips, ocisac::Chips{levels(255), 8e3, 0, true, 1});
BENCHMARK_CAPTURE(integrate, chips_of_an_led, ocisac::Chips{levels(255), 8e3, 0, true, 1, 0.5, 0.3});
BENCHMARK_CAPTURE(integrate, samples, ocisac::Samples{levels(255), 8e3, 0, true});
BENCHMARK_CAPTURE(integrate, product_of_tones, ocisac::Waveform(kTone) * ocisac::Tone{175});
BENCHMARK_CAPTURE(integrate, product_of_square_and_tone, ocisac::Waveform(kSquare) * ocisac::Tone{175});

}  // namespace
