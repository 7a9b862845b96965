// The evidence of many signals for a tone of each frequency.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

// For each bin k of a DFT of `length`, up to half of it, summed over the signals: −log(1 − fraction of the
// Hann-weighted energy explained by a tone at k/length). This is the log-likelihood if each signal has its own noise
// level. samples: (count × rows) dense, none constant; length: 2^a·3^b·5^c, at least rows.
std::vector<double> spectral_votes(std::span<const double> samples, std::size_t rows, std::size_t length);

}  // namespace ocisac
