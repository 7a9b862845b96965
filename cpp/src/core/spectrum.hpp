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

// The inverse, scaled by 1/length: `spectra` (count × (length/2 + 1)) → (count × length).
// The imaginary parts at k = 0 and k = length/2 do not count.
std::vector<double> signals_of_half_spectra(std::span<const std::complex<double>> spectra, std::size_t length);

// Complex signals in the caller's memory: (count × length), rows `pitch` apart, without overlap of `in` and `out`.
// inverse: not scaled. T: float or double.
enum class Transform { forward, inverse };
template <class T>
void transform_rows(Transform direction, const std::complex<T>* in, std::complex<T>* out, std::size_t count,
                    std::size_t length, std::size_t pitch);

}  // namespace ocisac
