// The transforms of spectrum.hpp by Eigen's FFT, for builds without OpenCV (OCISAC_EIGEN_FFT).
#include <algorithm>
#include <type_traits>
#include <unsupported/Eigen/FFT>

#include "core/spectrum.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/core/version.hpp"

namespace ocisac {

namespace {

// Keeps its plans from call to call.
template <class T>
Eigen::FFT<T>& planned() {
  thread_local Eigen::FFT<T> transform(
      typename Eigen::FFT<T>::impl_type(),
      static_cast<typename Eigen::FFT<T>::Flag>(Eigen::FFT<T>::HalfSpectrum | Eigen::FFT<T>::Unscaled));
  return transform;
}

// A single value is its own transform, which Eigen's FFT does not know.
template <class From, class To>
void forward(const From* in, To* out, std::size_t length) {
  if (length == 1)
    *out = *in;
  else
    planned<typename To::value_type>().fwd(out, in, static_cast<Eigen::Index>(length));
}

template <class T, class To>
void inverse(const std::complex<T>* in, To* out, std::size_t length) {
  if (length > 1)
    planned<T>().inv(out, in, static_cast<Eigen::Index>(length));
  else if constexpr (std::is_same_v<T, To>)
    *out = in->real();
  else
    *out = *in;
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

std::vector<std::complex<double>> half_spectra(std::span<const double> signals, std::size_t length) {
  require(length > 0 && signals.size() % length == 0, "length", length, "a divisor of the number of samples");
  const std::size_t count = signals.size() / length, bins = length / 2 + 1;
  std::vector<std::complex<double>> spectra(count * bins);
  for (std::size_t signal = 0; signal < count; ++signal)
    forward(&signals[signal * length], &spectra[signal * bins], length);
  return spectra;
}

std::vector<double> signals_of_half_spectra(std::span<const std::complex<double>> spectra, std::size_t length) {
  const std::size_t bins = length / 2 + 1;
  require(length > 0 && spectra.size() % bins == 0, "length", length, "2·(bins − 1) or 2·(bins − 1) + 1");
  const std::size_t count = spectra.size() / bins;
  std::vector<double> signals(count * length);
  std::vector<std::complex<double>> one(bins);
  for (std::size_t signal = 0; signal < count; ++signal) {
    std::copy_n(&spectra[signal * bins], bins, one.begin());
    one.front() = one.front().real();
    if (length % 2 == 0) one.back() = one.back().real();
    inverse(one.data(), &signals[signal * length], length);
  }
  for (double& value : signals) value /= static_cast<double>(length);
  return signals;
}

template <class T>
void transform_rows(Transform direction, const std::complex<T>* in, std::complex<T>* out, std::size_t count,
                    std::size_t length, std::size_t pitch) {
  for (std::size_t row = 0; row < count; ++row, in += pitch, out += pitch)
    if (direction == Transform::forward)
      forward(in, out, length);
    else
      inverse(in, out, length);
}

template void transform_rows(Transform, const std::complex<float>*, std::complex<float>*, std::size_t, std::size_t,
                             std::size_t);
template void transform_rows(Transform, const std::complex<double>*, std::complex<double>*, std::size_t, std::size_t,
                             std::size_t);

}  // namespace ocisac
