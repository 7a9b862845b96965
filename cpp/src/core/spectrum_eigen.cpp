// The transforms of spectrum.hpp by Eigen's FFT, for builds without OpenCV (OCISAC_EIGEN_FFT).
#include <unsupported/Eigen/FFT>

#include "core/spectrum.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/core/version.hpp"

namespace ocisac {

namespace {

// Keeps its plans from call to call.
Eigen::FFT<double>& planned() {
  using Fft = Eigen::FFT<double>;
  thread_local Fft transform(Fft::impl_type(), static_cast<Fft::Flag>(Fft::HalfSpectrum | Fft::Unscaled));
  return transform;
}

}  // namespace

std::string opencv_version() { return "none, Eigen's FFT"; }

std::size_t optimal_dft_length(std::size_t length) {
  for (std::size_t tried = length;; ++tried) {
    std::size_t rest = tried;
    for (const std::size_t factor : {2U, 3U, 5U})
      while (rest > 0 && rest % factor == 0) rest /= factor;
    if (rest == 1) return tried;
  }
}

// A single value is its own transform, which Eigen's FFT does not know.
std::vector<std::complex<double>> half_spectra(std::span<const double> signals, std::size_t length) {
  require(length > 0 && signals.size() % length == 0, "length", length, "a divisor of the number of samples");
  if (length == 1) return {signals.begin(), signals.end()};
  const std::size_t count = signals.size() / length, bins = length / 2 + 1;
  std::vector<std::complex<double>> spectra(count * bins);
  for (std::size_t signal = 0; signal < count; ++signal)
    planned().fwd(&spectra[signal * bins], &signals[signal * length], static_cast<Eigen::Index>(length));
  return spectra;
}

std::vector<std::complex<double>> transformed_rows(Transform direction, std::span<const std::complex<double>> signals,
                                                   std::size_t length) {
  std::vector<std::complex<double>> lines(signals.begin(), signals.end());
  for (std::size_t first = 0; length > 1 && first < lines.size(); first += length)
    if (direction == Transform::forward)
      planned().fwd(&lines[first], &signals[first], static_cast<Eigen::Index>(length));
    else
      planned().inv(&lines[first], &signals[first], static_cast<Eigen::Index>(length));
  return lines;
}

}  // namespace ocisac
