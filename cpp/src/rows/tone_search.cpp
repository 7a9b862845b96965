#include "ocisac/rows/tone_search.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "core/levels.hpp"
#include "core/spectrum.hpp"
#include "core/statistics.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kPadding = 4;                                       // bins per width of a spectral line
constexpr std::size_t kNearBins = 2 * kPadding, kFarBins = 8 * kPadding;  // from a tone to its neighbourhood

}  // namespace

std::size_t padded_length(std::size_t rows) { return optimal_dft_length(kPadding * rows); }

std::vector<double> hann_window(std::size_t rows) {
  std::vector<double> window(rows);
  for (std::size_t n = 0; n < rows; ++n)
    window[n] = std::pow(std::sin(std::numbers::pi * (static_cast<double>(n) + 0.5) / static_cast<double>(rows)), 2);
  return window;
}

std::vector<double> periodogram(std::span<const double> signals, std::size_t rows, std::size_t length) {
  const std::vector<double> window = hann_window(rows);
  std::vector<double> power(length / 2 + 1), windowed(length);
  const double energy = std::inner_product(window.begin(), window.end(), window.begin(), 0.0);
  const std::size_t count = signals.size() / rows;
  const double scale = 1 / (energy * static_cast<double>(count));
  for (std::size_t begin = 0; begin + rows <= signals.size(); begin += rows) {
    const auto signal = signals.subspan(begin, rows);
    const double mean = mean_of(signal);
    const auto varies = [&](double value) { return std::abs(value - mean) > kEqual * std::abs(mean); };
    if (std::ranges::none_of(signal, varies)) continue;
    for (std::size_t n = 0; n < rows; ++n) windowed[n] = window[n] * (signal[n] - mean);
    const auto spectrum = half_spectra(windowed, length);
    for (std::size_t k = 0; k < power.size(); ++k) power[k] += scale * std::norm(spectrum[k]);
  }
  return power;
}

StrongestTone strongest_tone(std::span<const double> signals, std::size_t rows, double lowest, double highest) {
  const std::size_t length = padded_length(rows), bins = length / 2 + 1;
  const std::vector<double> powers = periodogram(signals, rows, length);
  const auto bin_of = [&](double frequency) {
    return std::min(static_cast<std::size_t>(std::ceil(frequency * static_cast<double>(length))), bins);
  };
  const std::size_t first = bin_of(lowest), last = bin_of(highest);
  if (first >= last) return {};
  const auto strongest = static_cast<std::size_t>(std::max_element(powers.begin() + static_cast<std::ptrdiff_t>(first),
                                                                   powers.begin() + static_cast<std::ptrdiff_t>(last)) -
                                                  powers.begin());
  std::vector<double> nearby;
  for (std::size_t k = strongest - std::min(strongest, kFarBins); k < std::min(strongest + kFarBins + 1, bins); ++k)
    if (std::max(k, strongest) - std::min(k, strongest) > kNearBins) nearby.push_back(powers[k]);
  if (nearby.empty()) return {};
  return {static_cast<double>(strongest) / static_cast<double>(length),
          powers[strongest] / std::max(median(std::move(nearby)), 1e-300)};
}

}  // namespace ocisac
