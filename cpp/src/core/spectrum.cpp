#include "core/spectrum.hpp"

#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

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

std::vector<std::complex<double>> transformed_rows(Transform direction, std::span<const std::complex<double>> signals,
                                                   std::size_t length) {
  std::vector<std::complex<double>> lines(signals.begin(), signals.end());
  cv::Mat rows(checked_int("count", lines.size() / length), checked_int("length", length), CV_64FC2, lines.data());
  cv::dft(rows, rows, cv::DFT_ROWS | (direction == Transform::inverse ? cv::DFT_INVERSE : 0));
  return lines;
}

}  // namespace ocisac
