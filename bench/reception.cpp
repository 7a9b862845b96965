// Blind reception of on-off keying; the bits are compared with those sent before timing.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <random>
#include <string>
#include <vector>

#include "ocisac/light/integrate_exposure.hpp"
#include "ocisac/receiver/receive.hpp"

namespace {

// Range: columns. 720 rows, 6.2 rows per chip, an exposure of half a chip, noise 2 % of the swing.
void receive(benchmark::State& state) {
  const std::size_t rows = 720;
  const auto columns = static_cast<std::size_t>(state.range(0));
  std::mt19937 random(1);
  std::vector<double> levels(rows);
  for (double& level : levels) level = static_cast<double>(random() % 2);
  const ocisac::Camera camera{1.0, 3.1, {}, {}};
  std::vector<std::int64_t> numbers(rows);
  for (std::size_t row = 0; row < rows; ++row) numbers[row] = static_cast<std::int64_t>(row);
  std::vector<double> light(rows);
  ocisac::integrate_exposure(ocisac::Chips{levels, 1 / 6.2, 0, false, 1}, camera, numbers, 10.0, 0, light);
  std::normal_distribution<double> noise(0, 4);
  std::vector<std::uint8_t> pixels;
  for (std::size_t row = 0; row < rows; ++row)
    for (std::size_t column = 0; column < columns; ++column)
      pixels.push_back(static_cast<std::uint8_t>(std::clamp(20 + 200 * light[row] + noise(random), 0.0, 255.0)));
  const std::array<ocisac::AnyFramesView, 1> colours{
      ocisac::dense_view<const std::uint8_t>(pixels.data(), 1, rows, columns)};
  std::string sent;
  for (const double level : levels) sent += level > 0 ? '1' : '0';
  const auto received = ocisac::receive(colours, camera);
  if (received.empty() || received[0].bits.size() < 100 || sent.find(received[0].bits) == std::string::npos)
    return state.SkipWithError("other bits than those sent");
  for (auto _ : state) benchmark::DoNotOptimize(ocisac::receive(colours, camera));
}
BENCHMARK(receive)->Arg(96)->Arg(1280)->ArgName("columns")->Unit(benchmark::kMillisecond);

}  // namespace
