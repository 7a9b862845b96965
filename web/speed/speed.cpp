// Times of tone_gain and detect_sources in a frame of 1080p under two lamps, the fastest of REPEATS, ms:
// speed [REPEATS]. scripts/web-speed compares WebAssembly with the machine's own code.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <vector>

#include "ocisac/core/views.hpp"
#include "ocisac/lights/detect_sources.hpp"
#include "ocisac/tones/tone_gain.hpp"

namespace {

constexpr std::size_t rows = 1080, columns = 1920;
constexpr double row_time = 22.2e-6;

// Two tones side by side, with noise of 2 DN.
std::vector<std::uint8_t> two_lamps() {
  std::vector<std::uint8_t> pixels;
  std::uint32_t random = 1;
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t k = 0; k < columns; ++k) {
      const auto wave = [&](double frequency, double centre) {
        const double place = (static_cast<double>(k) / columns - centre) / 0.1;
        const double angle = 2 * std::numbers::pi * frequency * row_time * static_cast<double>(n);
        return 90 * (1 + std::cos(angle)) * std::exp(-place * place);
      };
      random = 1664525U * random + 1013904223U;
      const double noise = static_cast<double>(random >> 24) / 37 - 3.5;
      pixels.push_back(static_cast<std::uint8_t>(std::lround(14 + wave(900, 0.25) + wave(1700, 0.75) + noise)));
    }
  return pixels;
}

template <class Call>
double fastest(int repeats, Call call) {
  double best = 1e9;
  for (int k = 0; k < repeats; ++k) {
    const auto start = std::chrono::steady_clock::now();
    call();
    best = std::min(best, std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

}  // namespace

int main(int count, char** arguments) {
  const int repeats = count > 1 ? std::atoi(arguments[1]) : 20;
  const std::vector<std::uint8_t> pixels = two_lamps();
  const ocisac::AnyFramesView frame = ocisac::dense_view(pixels.data(), 1, rows, columns);
  ocisac::Camera camera;
  camera.row_time = row_time;
  camera.exposure = 100e-6;
  const double frequency = 900;
  const double gain = fastest(10 * repeats, [&] {
    static_cast<void>(ocisac::tone_gain(frame, camera, {&frequency, 1}, {}));
  });
  std::size_t found = 0;
  const double detect = fastest(repeats, [&] { found = ocisac::detect_sources(frame, camera).size(); });
  std::printf("%.3f %.3f\n", gain, detect);
  return found == 2 ? 0 : 1;
}
