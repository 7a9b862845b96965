// Removal of bands: the steps of a frame and whole frames. Each case is checked by truth before timing.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "frames.hpp"
#include "ocisac/cleaning/judge_cleaning.hpp"
#include "ocisac/cleaning/picture_motion.hpp"
#include "ocisac/cleaning/slow_light.hpp"
#include "ocisac/cleaning/stream_cleaner.hpp"

namespace {

using bench::kColumns, bench::kRows;

constexpr std::size_t kMerged = 4, kNarrow = kColumns / kMerged;  // columns of a large picture are merged
constexpr double kShare = 0.7, kFast = 18, kSlow = 2;             // cycles in the picture
constexpr double kVariance = 0.5;                                 // DN²

double turn(std::size_t row, double cycles) {
  return std::cos(2 * std::numbers::pi * cycles * (static_cast<double>(row) + 0.5) / kRows);
}

// Light of the rows, mean 1.
std::vector<double> tone(double cycles) {
  std::vector<double> rows;
  for (std::size_t n = 0; n < kRows; ++n) rows.push_back(1 + turn(n, cycles));
  return rows;
}

double box(std::size_t row, std::size_t column) {
  return 60 + 25 * static_cast<double>((row / 131 + column / 223 + (row / 57) * (column / 331)) % 4);
}

// Boxes, `columns` of them `step` apart, under a tone; the box of a pixel moves `moved` columns.
struct Scene {
  std::size_t columns;
  std::vector<double> light, variance;

  explicit Scene(double cycles, std::size_t of_columns = kNarrow, std::size_t step = kMerged, std::size_t moved = 0)
      : columns(of_columns), variance(kRows * of_columns, kVariance) {
    const auto noise = bench::noise<double>(kRows * columns, 5);
    for (std::size_t n = 0; n < kRows; ++n)
      for (std::size_t k = 0; k < columns; ++k)
        light.push_back(box(n, step * k + moved) * (1 + kShare * turn(n, cycles)) / (1 + kShare) +
                        noise[n * columns + k] / 128 - 1);
  }

  [[nodiscard]] ocisac::BandedPicture picture() const { return {light, variance, 1, kRows, columns}; }

  [[nodiscard]] std::vector<std::uint8_t> stored() const {
    std::vector<std::uint8_t> bytes;
    for (const double value : light) bytes.push_back(static_cast<std::uint8_t>(std::lround(std::max(value, 0.0))));
    return bytes;
  }
};

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value / static_cast<double>(values.size());
  return sum;
}

void light_share(benchmark::State& state) {
  const Scene scene(kFast);
  const std::vector<double> rows = tone(kFast);
  if (std::abs(mean_of(ocisac::light_share(scene.picture(), rows)) - kShare) > 0.02)
    return state.SkipWithError("another share");
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::light_share(scene.picture(), rows));
}
BENCHMARK(light_share)->Unit(benchmark::kMillisecond);

void refine_row_light(benchmark::State& state) {
  const Scene scene(kFast);
  const std::vector<double> share(scene.light.size(), kShare), truth = tone(kFast);
  std::vector<double> start, basis, left;
  for (std::size_t n = 0; n < kRows; ++n) {
    start.push_back(1 + 0.8 * (truth[n] - 1));
    basis.push_back(truth[n] - 1);
  }
  const auto refined = [&] { return ocisac::refine_row_light(scene.picture(), share, start, 6, {basis}).light; };
  const std::vector<double> found = refined();
  for (std::size_t n = 0; n < kRows; ++n) left.push_back(std::abs(found[n] - truth[n]));
  if (mean_of(left) > 0.02) return state.SkipWithError("another light");  // 0.13 at the start
  for (auto _ : state) benchmark::DoNotOptimize(refined());
}
BENCHMARK(refine_row_light)->Unit(benchmark::kMillisecond);

void judge_cleaning(benchmark::State& state) {
  const Scene scene(kFast);
  const std::vector<double> rows = tone(kFast), share{kShare};
  const auto judged = [&] { return ocisac::judge_cleaning(scene.picture(), rows, {share, kRows, kNarrow}, 256); };
  if (judged().light_left > 0.1) return state.SkipWithError("light is left");
  for (auto _ : state) benchmark::DoNotOptimize(judged());
}
BENCHMARK(judge_cleaning)->Unit(benchmark::kMillisecond);

void find_slow_lights(benchmark::State& state) {
  const Scene scene(kSlow);
  const ocisac::Camera camera{1e-5, 1e-4, {}, {}};
  const std::vector<std::vector<ocisac::BandedPicture>> frames{{scene.picture()}};
  const auto cycles = ocisac::find_slow_lights(frames, camera).front().tones.front().cycles;
  if (std::abs(cycles - kSlow) > 0.3) return state.SkipWithError("another tone");
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::find_slow_lights(frames, camera));
}
BENCHMARK(find_slow_lights)->Unit(benchmark::kMillisecond);

// Frames are as large as the guide by which they are compared.
void picture_change(benchmark::State& state) {
  constexpr std::size_t rows = 135, columns = 240, moved = 3;
  std::vector<double> before, after;
  const auto texture = bench::noise<double>(rows * (columns + moved), 3);
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t k = 0; k < columns; ++k) {
      before.push_back(texture[n * (columns + moved) + k] / 512);
      after.push_back(texture[n * (columns + moved) + k + moved] / 512);
    }
  const ocisac::LogPicture one{before, rows, columns}, other{after, rows, columns};
  const auto change = ocisac::picture_change(one, other);
  if (std::abs(mean_of(change.motion.right) + moved) > 0.3) return state.SkipWithError("another way");
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::picture_change(one, other));
}
BENCHMARK(picture_change)->Unit(benchmark::kMillisecond);

// Frames of bytes of 1080p: the first, and those after it, with their restored pixels.
void clean_frame(benchmark::State& state) {
  const bool first = state.range(0) == 0;
  const std::vector<std::uint8_t> frames[] = {Scene(kFast, kColumns, 1).stored(),
                                              Scene(kFast, kColumns, 1, 8).stored()};
  ocisac::StreamCleaner cleaner({1e-5, 1e-4, 1.0 / 30, {}});
  std::size_t number = 0;
  const auto cleaned = [&] {
    if (first) cleaner.forget();
    const auto found = cleaner.push({ocisac::dense_view(frames[number++ % 2].data(), 1, kRows, kColumns)});
    const auto& light = found.light.lights.front().lights.front();
    benchmark::DoNotOptimize(
        found.stored.restored<std::uint8_t>(0, 0, found.light.shares.front(), {light.light, light.full, 8}));
    return found.light.unchanged.empty() && found.light.verdicts.front().light_left < 0.1;
  };
  if (!cleaned()) return state.SkipWithError("light is left");
  for (auto _ : state) benchmark::DoNotOptimize(cleaned());
}
BENCHMARK(clean_frame)->Arg(0)->Arg(1)->ArgName("after_the_first")->Unit(benchmark::kMillisecond);

}  // namespace
