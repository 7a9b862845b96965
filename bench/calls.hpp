// Whole calls with a fixed input: bench/instructions.cpp counts the instructions of each, bench/calls.cpp times it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <numbers>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "ocisac/exposure/best_exposure.hpp"
#include "ocisac/light/integrate_exposure.hpp"
#include "ocisac/receiver/receive.hpp"
#include "ocisac/tones/equalize.hpp"
#include "ocisac/tones/find_frequency.hpp"
#include "ocisac/tones/projection.hpp"
#include "ocisac/tones/tone_gain.hpp"
#include "ocisac/tones/varying_tone.hpp"

namespace calls {

inline constexpr std::size_t kRows = 1080, kColumns = 640;

template <class T>
std::vector<T> noise(std::size_t size, unsigned seed = 1) {
  std::vector<T> values(size);
  std::uint32_t state = seed;  // linear congruential generator: cheap relative to the measured work
  for (T& value : values) value = static_cast<T>((state = 1664525U * state + 1013904223U) >> 24);
  return values;
}

// (outputs × groups): mean, then cosine and sine of tones.
inline std::vector<double> tone_weights(std::size_t outputs, std::size_t groups) {
  std::vector<double> weights(outputs * groups);
  for (std::size_t o = 0; o < outputs; ++o)
    for (std::size_t g = 0; g < groups; ++g) {
      const double cycles = 12.0 * static_cast<double>((o + 1) / 2 * g) / static_cast<double>(groups);
      const double quarter = o % 2 == 0 && o > 0 ? 0.25 : 0;
      weights[o * groups + g] = std::cos(2 * std::numbers::pi * (cycles - quarter)) / static_cast<double>(groups);
    }
  return weights;
}

inline ocisac::RowWeights row_weights(std::size_t outputs, int row_group, int limbs) {
  const std::size_t groups = kRows / static_cast<std::size_t>(row_group);
  return {tone_weights(outputs, groups), outputs, kRows, row_group, limbs};
}

inline const ocisac::Camera kCamera{22.2e-6, 1202e-6, {}, {}};

// Sum of the results: keeps the work from being optimised away and reveals wrong values.
template <class Values>
inline double total(const Values& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

inline ocisac::AnyFramesView frame() {
  static const auto pixels = noise<std::uint8_t>(kRows * kColumns);
  return ocisac::dense_view<const std::uint8_t>(pixels.data(), 1, kRows, kColumns);
}

inline double project(std::size_t outputs, int row_group) {
  return total(ocisac::project(frame(), 0, 0, kColumns, row_weights(outputs, row_group, 1)).sums);
}

inline double gain(double efficiency, ocisac::WaveformShape waveform) {
  ocisac::ToneGainOptions options;
  options.efficiency = efficiency;
  options.waveform = waveform;
  const double frequency = 500;
  return total(ocisac::tone_gain(frame(), kCamera, {&frequency, 1}, options).mean);
}

inline double integrate(const ocisac::Waveform& waveform) {
  std::vector<std::int64_t> rows(kRows);
  std::iota(rows.begin(), rows.end(), 0);
  std::vector<double> out(rows.size());
  for (int start = 0; start < 100; ++start) ocisac::integrate_exposure(waveform, kCamera, rows, 1e-5 * start, 0, out);
  return total(out);
}

inline double choose_exposures() {
  double sum = 0;
  for (int k = 1; k <= 2000; ++k) sum += ocisac::best_exposure_exact(500, 500.0 * k / 2000).exposure;
  return sum;
}

inline double equalize() {
  std::vector<double> out(kRows * kColumns);
  ocisac::equalize(frame(), {1.0, 7.3, {}, {}}, {}, ocisac::dense_view<double>(out.data(), 1, kRows, kColumns));
  return total(out);
}

// A square wave of 12.3 cycles under noise, each column at its own phase.
inline ocisac::AnyFramesView flashing(std::size_t columns) {
  static const auto pixels = [] {
    auto values = noise<std::uint8_t>(kRows * kColumns);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double cycles = 12.3 * static_cast<double>(i / kColumns) / kRows;
      const bool bright = std::fmod(cycles + 0.01 * static_cast<double>(i % kColumns), 1) < 0.5;
      values[i] = static_cast<std::uint8_t>(values[i] / 16 + (bright ? 140 : 60));
    }
    return values;
  }();
  auto view = ocisac::dense_view<const std::uint8_t>(pixels.data(), 1, kRows, kColumns);
  view.columns = columns;
  return view;
}

inline double find_frequency(std::size_t columns) { return ocisac::find_frequency(flashing(columns), {}).frequency; }

inline double varying_gain() { return total(ocisac::varying_tone_gain(flashing(kColumns), kCamera, 500).mean); }

inline double pooled_gain() {
  const double frequency = 500;
  return total(ocisac::tone_gain(flashing(kColumns), kCamera, {&frequency, 1}, {.pooled = true}).gain);
}

inline double read() {
  static const auto bytes = noise<std::uint8_t>(kRows * kColumns);
  return static_cast<double>(ocisac::read_bytes(bytes));
}

// Chips of 6.2 rows seen through half a chip, noise of 2 % of the swing, 96 columns.
inline const std::vector<std::uint8_t>& flashes() {
  static const auto pixels = [] {
    constexpr std::size_t columns = 96;
    auto levels = noise<double>(kRows);
    for (double& level : levels) level = level < 128 ? 0 : 1;
    std::vector<std::int64_t> rows(kRows);
    std::iota(rows.begin(), rows.end(), 0);
    std::vector<double> light(kRows);
    ocisac::integrate_exposure(ocisac::Chips{levels, 1 / 6.2, 0, false, 1}, {1.0, 3.1, {}, {}}, rows, 10, 0, light);
    std::mt19937 random(1);
    std::normal_distribution<double> noise(0, 4);
    std::vector<std::uint8_t> values;
    for (std::size_t i = 0; i < kRows * columns; ++i)
      values.push_back(
          static_cast<std::uint8_t>(std::clamp(20 + 200 * light[i / columns] + noise(random), 0.0, 255.0)));
    return values;
  }();
  return pixels;
}

inline double receive() {
  const auto& pixels = flashes();
  const std::array<ocisac::AnyFramesView, 1> colours{
      ocisac::dense_view<const std::uint8_t>(pixels.data(), 1, kRows, pixels.size() / kRows)};
  const auto found = ocisac::receive(colours, {1.0, 3.1, {}, {}});
  return found.empty() ? 0 : static_cast<double>(found[0].bits.size());
}

inline const std::map<std::string, std::function<double()>> kCases{
    {"project-3-D1", [] { return project(3, 1); }},
    {"project-3-D4", [] { return project(3, 4); }},
    {"project-9-D1", [] { return project(9, 1); }},
    {"gain-tone-1", [] { return gain(1, ocisac::WaveformShape::tone); }},
    {"gain-tone-0.99", [] { return gain(0.99, ocisac::WaveformShape::tone); }},
    {"gain-square-1", [] { return gain(1, ocisac::WaveformShape::square); }},
    {"integrate-tone", [] { return integrate(ocisac::Tone{500}); }},
    {"integrate-square", [] { return integrate(ocisac::SquareWave{500}); }},
    {"exposure-choice", choose_exposures},
    {"integrate-chips",
     [] {
       return integrate(ocisac::Chips{{0, 1, 1, 0, 1, 0, 0, 1, 0}, 8e3, 0, true, 1});
     }},
    {"equalize", equalize},
    {"find-frequency", [] { return find_frequency(kColumns); }},
    {"find-frequency-column", [] { return find_frequency(1); }},
    {"gain-varying", varying_gain},
    {"gain-pooled", pooled_gain},
    {"read", read},
    {"receive", receive},
};

// Makes the frames that the cases read.
inline void prepare() {
  frame();
  flashing(1);
  flashes();
  read();
}

}  // namespace calls
