#include "core/spectrum.hpp"

#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <type_traits>

#include "ocisac/core/require.hpp"
#include "ocisac/core/version.hpp"

namespace ocisac {

namespace {

// OpenCV counts in int; larger signals are refused and not wrapped around.
int checked_int(const char* what, std::size_t value) {
  require(value <= static_cast<std::size_t>(std::numeric_limits<int>::max()), what, value, "at most 2^31 - 1");
  return static_cast<int>(value);
}

}  // namespace

std::string opencv_version() { return cv::getVersionString(); }

std::size_t optimal_dft_length(std::size_t length) {
  const int best = cv::getOptimalDFTSize(checked_int("length", length));
  require(best > 0, "length", length, "a length that OpenCV's DFT can take");
  return static_cast<std::size_t>(best);
}

std::vector<std::complex<double>> half_spectra(std::span<const double> signals, std::size_t length) {
  require(length > 0 && signals.size() % length == 0, "length", length, "a divisor of the number of samples");
  const std::size_t count = signals.size() / length;
  const std::size_t bins = length / 2 + 1;
  const cv::Mat input(checked_int("count", count), checked_int("length", length), CV_64F,
                      const_cast<double*>(signals.data()));
  cv::Mat packed;  // CCS: Re0, Re1, Im1, Re2, … and, for even lengths, Re(length/2) last
  cv::dft(input, packed, cv::DFT_ROWS);
  std::vector<std::complex<double>> spectra(count * bins);
  for (std::size_t signal = 0; signal < count; ++signal) {
    const auto* row = packed.ptr<double>(static_cast<int>(signal));
    auto* out = &spectra[signal * bins];
    out[0] = row[0];
    for (std::size_t k = 1; 2 * k < length; ++k) out[k] = {row[2 * k - 1], row[2 * k]};
    if (length % 2 == 0) out[length / 2] = row[length - 1];
  }
  return spectra;
}

std::vector<double> signals_of_half_spectra(std::span<const std::complex<double>> spectra, std::size_t length) {
  const std::size_t bins = length / 2 + 1;
  require(length > 0 && spectra.size() % bins == 0, "length", length, "2·(bins − 1) or 2·(bins − 1) + 1");
  const std::size_t count = spectra.size() / bins;
  std::vector<double> signals(count * length);
  cv::Mat packed(checked_int("count", count), checked_int("length", length), CV_64F);
  for (std::size_t signal = 0; signal < count; ++signal) {
    auto* row = packed.ptr<double>(static_cast<int>(signal));
    const auto* in = &spectra[signal * bins];
    row[0] = in[0].real();
    for (std::size_t k = 1; 2 * k < length; ++k) {
      row[2 * k - 1] = in[k].real();
      row[2 * k] = in[k].imag();
    }
    if (length % 2 == 0) row[length - 1] = in[length / 2].real();
  }
  cv::Mat output(packed.rows, packed.cols, CV_64F, signals.data());
  cv::dft(packed, output, cv::DFT_INVERSE | cv::DFT_ROWS | cv::DFT_SCALE | cv::DFT_REAL_OUTPUT);
  require(output.ptr<double>() == signals.data(), "length", length, "an output of its own");  // dft may not reallocate
  return signals;
}

template <class T>
void transform_rows(Transform direction, const std::complex<T>* in, std::complex<T>* out, std::size_t count,
                    std::size_t length, std::size_t pitch) {
  const int rows = checked_int("count", count), columns = checked_int("length", length);
  const std::size_t step = pitch * sizeof(std::complex<T>);
  const cv::Mat from(rows, columns, std::is_same_v<T, float> ? CV_32FC2 : CV_64FC2, const_cast<std::complex<T>*>(in),
                     step);
  cv::Mat to(rows, columns, from.type(), out, step);
  cv::dft(from, to, cv::DFT_ROWS | (direction == Transform::inverse ? cv::DFT_INVERSE : 0));
  require(to.data == static_cast<void*>(out), "length", length, "an output of its own");  // dft may not reallocate
}

template void transform_rows(Transform, const std::complex<float>*, std::complex<float>*, std::size_t, std::size_t,
                             std::size_t);
template void transform_rows(Transform, const std::complex<double>*, std::complex<double>*, std::size_t, std::size_t,
                             std::size_t);

}  // namespace ocisac
