// A small fixed workload for counting instructions: `instructions NAME` runs one case once; without a name it lists
// them.
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <numeric>
#include <string>

#include "frames.hpp"
#include "ocisac/exposure/best_exposure.hpp"
#include "ocisac/light/integrate_exposure.hpp"
#include "ocisac/tones/equalize.hpp"
#include "ocisac/tones/find_frequency.hpp"
#include "ocisac/tones/tone_gain.hpp"
#include "ocisac/tones/varying_tone.hpp"

namespace {

constexpr std::size_t kColumns = 640;

const ocisac::Camera kCamera{22.2e-6, 1202e-6, {}, {}};

// Sum of the results: keeps the work from being optimised away and reveals wrong values.
template <class Values>
double total(const Values& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

ocisac::AnyFramesView frame() {
  static const auto pixels = bench::noise<std::uint8_t>(bench::kRows * kColumns);
  return ocisac::dense_view<const std::uint8_t>(pixels.data(), 1, bench::kRows, kColumns);
}

double project(std::size_t outputs, int row_group) {
  return total(ocisac::project(frame(), 0, 0, kColumns, bench::row_weights(outputs, row_group, 1)).sums);
}

double gain(double efficiency, ocisac::WaveformShape waveform) {
  ocisac::ToneGainOptions options;
  options.efficiency = efficiency;
  options.waveform = waveform;
  const double frequency = 500;
  return total(ocisac::tone_gain(frame(), kCamera, {&frequency, 1}, options).mean);
}

double integrate(const ocisac::Waveform& waveform) {
  std::vector<std::int64_t> rows(bench::kRows);
  std::iota(rows.begin(), rows.end(), 0);
  std::vector<double> out(rows.size());
  for (int start = 0; start < 100; ++start) ocisac::integrate_exposure(waveform, kCamera, rows, 1e-5 * start, 0, out);
  return total(out);
}

double choose_exposures() {
  double sum = 0;
  for (int k = 1; k <= 2000; ++k) sum += ocisac::best_exposure_exact(500, 500.0 * k / 2000).exposure;
  return sum;
}

double equalize() {
  std::vector<double> out(bench::kRows * kColumns);
  ocisac::equalize(frame(), {1.0, 7.3, {}, {}}, {}, ocisac::dense_view<double>(out.data(), 1, bench::kRows, kColumns));
  return total(out);
}

// A square wave of 12.3 cycles under noise, each column at its own phase.
ocisac::AnyFramesView flashing(std::size_t columns) {
  static const auto pixels = [] {
    auto values = bench::noise<std::uint8_t>(bench::kRows * kColumns);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double cycles = 12.3 * static_cast<double>(i / kColumns) / bench::kRows;
      const bool bright = std::fmod(cycles + 0.01 * static_cast<double>(i % kColumns), 1) < 0.5;
      values[i] = static_cast<std::uint8_t>(values[i] / 16 + (bright ? 140 : 60));
    }
    return values;
  }();
  auto view = ocisac::dense_view<const std::uint8_t>(pixels.data(), 1, bench::kRows, kColumns);
  view.columns = columns;
  return view;
}

double find_frequency(std::size_t columns) { return ocisac::find_frequency(flashing(columns), {}).frequency; }

double varying_gain() { return total(ocisac::varying_tone_gain(flashing(kColumns), kCamera, 500, {}).mean); }

double pooled_gain() {
  const double frequency = 500;
  return total(ocisac::pooled_tone_gain(flashing(kColumns), kCamera, {&frequency, 1}, {}).gain);
}

const std::map<std::string, std::function<double()>> kCases{
    {"project-3-D1", [] { return project(3, 1); }},
    {"project-3-D4", [] { return project(3, 4); }},
    {"project-9-D1", [] { return project(9, 1); }},
    {"gain-tone-1", [] { return gain(1, ocisac::WaveformShape::tone); }},
    {"gain-tone-0.99", [] { return gain(0.99, ocisac::WaveformShape::tone); }},
    {"gain-square-1", [] { return gain(1, ocisac::WaveformShape::square); }},
    {"integrate-tone", [] { return integrate(ocisac::Tone{500}); }},
    {"integrate-square", [] { return integrate(ocisac::SquareWave{500}); }},
    {"exposure-choice", choose_exposures},
    {"equalize", equalize},
    {"find-frequency", [] { return find_frequency(kColumns); }},
    {"find-frequency-column", [] { return find_frequency(1); }},
    {"gain-varying", varying_gain},
    {"gain-pooled", pooled_gain},
};

}  // namespace

// Counted region: valgrind --tool=callgrind --toggle-collect=run_measured
extern "C" __attribute__((noinline)) double run_measured(const std::function<double()>& work) { return work(); }

int main(int argc, char** argv) {
  if (argc == 1) {
    for (const auto& entry : kCases) std::puts(entry.first.c_str());
    return 0;
  }
  const auto found = kCases.find(argv[1]);
  if (found == kCases.end()) return 2;
  frame();  // creates the frames before the counted region
  flashing(1);
  std::printf("%.12g\n", run_measured(found->second));
}
