// Spectra of many signals by OpenCV's DFT, one plan for all (DFT_ROWS).
#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

// The smallest length of the form 2^a·3^b·5^c that is not below `length`.
std::size_t optimal_dft_length(std::size_t length);

// `signals`: (count × length) dense. Result: (count × (length/2 + 1)), X(k) = Σ_n x(n)·e^{−j2πkn/length}.
std::vector<std::complex<double>> half_spectra(std::span<const double> signals, std::size_t length);

// Complex signals (count × length) in either direction; the inverse is not scaled.
enum class Transform { forward, inverse };
std::vector<std::complex<double>> transformed_rows(Transform direction, std::span<const std::complex<double>> signals,
                                                   std::size_t length);

}  // namespace ocisac
