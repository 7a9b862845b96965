// Spectra of row signals and the tones that stand out in them.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

inline constexpr std::array kMains{100.0, 120.0};  // Hz; hum of mains of 50 and 60 Hz

std::vector<double> hann_window(std::size_t rows);  // sin²

// Mean power density of signals, each of `rows` rows, less their means, under a Hann window: |DFT|² in bins of 1/length
// cycles per row, up to half the row rate, scaled so that white noise has its variance in each. Constant signals are
// left out. length: 2^a·3^b·5^c, at least rows.
std::vector<double> periodogram(std::span<const double> signals, std::size_t rows, std::size_t length);

// The length whose bins are a quarter of a spectral line of the rows, or less.
std::size_t padded_length(std::size_t rows);

// The strongest tone between two frequencies (cycles per row) in the periodogram of `signals`, and the ratio of its
// power to the median of its neighbourhood.
struct StrongestTone {
  double frequency = 0, prominence = 0;
};
inline constexpr double kProminent = 6;  // least prominence of a tone beside chips, which reach 4
StrongestTone strongest_tone(std::span<const double> signals, std::size_t rows, double lowest, double highest);

}  // namespace ocisac
