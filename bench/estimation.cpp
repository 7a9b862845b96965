// Projection, reading, gains, spectra, equalisation and exposure choice. Each case is checked once before timing.
#include <benchmark/benchmark.h>

#include <array>
#include <cmath>
#include <complex>
#include <numeric>

#include "core/spectrum.hpp"
#include "frames.hpp"
#include "ocisac/exposure/best_exposure.hpp"
#include "ocisac/tones/equalize.hpp"
#include "ocisac/tones/read_bytes.hpp"
#include "ocisac/tones/tone_gain.hpp"

namespace {

using bench::kColumns;
using bench::kRows;

template <class T>
const std::vector<T>& pool() {
  static const std::vector<T> frames = bench::noise<T>(kRows * kColumns * bench::kFrames / sizeof(T));
  return frames;
}

template <class T>
ocisac::AnyFramesView view_of_pool() {
  return ocisac::dense_view<const T>(pool<T>().data(), pool<T>().size() / (kRows * kColumns), kRows, kColumns);
}

void count_frames(benchmark::State& state, std::size_t bytes) {
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) * static_cast<std::int64_t>(bytes));
}

// Range: outputs, D.
template <class T>
void project(benchmark::State& state) {
  const auto weights =
      bench::row_weights(static_cast<std::size_t>(state.range(0)), static_cast<int>(state.range(1)), 1);
  const auto frames = view_of_pool<T>();
  const auto fast = ocisac::project(frames, 0, 0, kColumns, weights);
  const auto plain = ocisac::project_plainly(frames, 0, 0, kColumns, weights);
  for (std::size_t i = 0; i < plain.sums.size(); ++i)
    if (!(std::abs(fast.sums[i] - plain.sums[i]) < 1e-9 * 255 * kRows)) return state.SkipWithError("wrong sums");
  if (fast.maximum != plain.maximum) return state.SkipWithError("wrong maximum");
  std::size_t frame = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(ocisac::project(frames, frame, 0, kColumns, weights));
    frame = (frame + 1) % (pool<T>().size() / (kRows * kColumns));
  }
  count_frames(state, kRows * kColumns * sizeof(T));
}
BENCHMARK(project<std::uint8_t>)->ArgsProduct({{3, 9}, {1, 2, 4, 8}})->ArgNames({"outputs", "D"});
BENCHMARK(project<std::uint16_t>)->ArgsProduct({{3, 9}, {1, 4}})->ArgNames({"outputs", "D"});
BENCHMARK(project<float>)->ArgsProduct({{3, 9}, {1, 4}})->ArgNames({"outputs", "D"});
BENCHMARK(project<double>)->ArgsProduct({{3, 9}, {1, 4}})->ArgNames({"outputs", "D"});

void read(benchmark::State& state) {
  const std::span bytes(pool<std::uint8_t>());
  const std::size_t size = kRows * kColumns;
  const auto first = bytes.first(size);
  if (ocisac::read_bytes(first) != std::accumulate(first.begin(), first.end(), std::uint64_t{0}))
    return state.SkipWithError("wrong sum");
  std::size_t frame = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(ocisac::read_bytes(bytes.subspan(frame * size, size)));
    frame = (frame + 1) % bench::kFrames;
  }
  count_frames(state, size);
}
BENCHMARK(read);

// Range: efficiency in percent, tones.
void gain(benchmark::State& state) {
  const ocisac::Camera camera{22.2e-6, {}, {}, {}};
  const std::array every{500.5, 1543.0, 2543.0, 3753.0};
  const std::span tones(every.data(), static_cast<std::size_t>(state.range(1)));
  ocisac::ToneGainOptions options;
  options.efficiency = static_cast<double>(state.range(0)) / 100;
  auto frames = std::get<ocisac::FramesView<const std::uint8_t>>(view_of_pool<std::uint8_t>());
  const auto found = ocisac::tone_gain(frames.frame(0), camera, tones, options);
  for (std::size_t i = 0; i < found.gain.size(); ++i)  // noise of 74 DN: no tone
    if (!(found.gain[i] < 8 * found.gain_std[i] + 0.2)) return state.SkipWithError("a tone in noise");
  std::size_t frame = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(ocisac::tone_gain(frames.frame(frame), camera, tones, options));
    frame = (frame + 1) % bench::kFrames;
  }
  count_frames(state, kRows * kColumns);
}
BENCHMARK(gain)->ArgsProduct({{99, 100}, {1, 4}})->ArgNames({"efficiency", "tones"});

// Range: length of the signals, 256 of them.
void spectra(benchmark::State& state) {
  const auto length = static_cast<std::size_t>(state.range(0));
  const std::size_t count = 256;
  const auto signals = bench::noise<double>(length * count);
  const auto half = ocisac::half_spectra(signals, length);
  const auto back = ocisac::signals_of_half_spectra(half, length);
  for (std::size_t i = 0; i < signals.size(); ++i)
    if (!(std::abs(back[i] - signals[i]) < 1e-9)) return state.SkipWithError("wrong spectra");
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::half_spectra(signals, length));
}
BENCHMARK(spectra)->Arg(720)->Arg(1080)->Arg(1087)->Arg(4352)->ArgName("length");

void equalize(benchmark::State& state) {
  const std::size_t columns = 64;
  const ocisac::Camera camera{1.0, 7.3, {}, {}};
  std::vector<double> ramp(kRows * columns), out(kRows * columns);
  for (std::size_t row = 0; row < kRows; ++row)
    std::fill_n(ramp.begin() + static_cast<std::ptrdiff_t>(row * columns), columns, static_cast<double>(row));
  const ocisac::EqualizerSettings settings{
      state.range(0) ? ocisac::EqualizerMethod::wiener : ocisac::EqualizerMethod::inverse, 10, {}};
  const auto view = ocisac::dense_view<double>(out.data(), 1, kRows, columns);
  ocisac::equalize(ocisac::dense_view<const double>(ramp.data(), 1, kRows, columns), camera, settings, view);
  for (std::size_t i = 0; i < out.size(); ++i)  // a ramp is restored half an exposure earlier
    if (!(std::abs(out[i] - ramp[i] - 3.65) < 1e-6)) return state.SkipWithError("a ramp not restored");
  const auto noisy = bench::noise<std::uint8_t>(kRows * columns);
  const auto frames = ocisac::dense_view<const std::uint8_t>(noisy.data(), 1, kRows, columns);
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::equalize(frames, camera, settings, view));
}
BENCHMARK(equalize)->Arg(0)->Arg(1)->ArgName("wiener")->Unit(benchmark::kMillisecond);

void best_exposure_exact(benchmark::State& state) {
  const std::array frequencies{500.0, 350.0}, weights{1.0, 1.0};
  const auto best = ocisac::best_exposure_exact(500.0, 350.0);
  const auto searched = ocisac::best_exposure_search(frequencies, weights, {}, 1'000'001);
  if (!(std::abs(best.objective - searched.objective) < 1e-9 * best.objective))
    return state.SkipWithError("not the maximum");
  const auto ratios = bench::noise<double>(1024);
  std::size_t k = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(ocisac::best_exposure_exact(500.0, 100.0 + ratios[k]));
    k = (k + 1) % ratios.size();
  }
}
BENCHMARK(best_exposure_exact);

}  // namespace
