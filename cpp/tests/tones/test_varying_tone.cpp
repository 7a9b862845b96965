#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "ocisac/tones/varying_tone.hpp"

namespace {

constexpr std::size_t kRows = 720;

// Light of mean 100 with relative slope `slope` along the rows, tone of gain 0.5, frequency that rises by `drift`.
std::vector<double> column(double cycles, double slope, double drift) {
  std::vector<double> signal(kRows);
  for (std::size_t n = 0; n < kRows; ++n) {
    const double u = (static_cast<double>(n) - (kRows - 1) / 2.0) / kRows;
    const double turns = cycles * u + drift / 2 * u * u + 0.3;
    signal[n] = 100 * (1 - slope * u) * (1 + 0.5 * std::cos(2 * std::numbers::pi * turns));
  }
  return signal;
}

ocisac::VaryingToneGain gain_of(const std::vector<double>& signal, double cycles, int degree) {
  const ocisac::FramesView<const double> view{signal.data(), 1, kRows, 1, 0, 1, 0};
  ocisac::Camera camera;
  camera.row_time = 1;
  ocisac::VaryingToneOptions options;
  options.degree = degree;
  return ocisac::varying_tone_gain(view, camera, cycles / kRows, options);
}

}  // namespace

TEST_CASE("a gradient is exact and flagged, where a fit without one is biased") {
  const auto signal = column(3.3, 0.8, 0);
  const auto varying = gain_of(signal, 3.3, 2);
  CHECK(varying.gain[0] == doctest::Approx(0.5).epsilon(1e-10));
  CHECK(varying.mean[0] == doctest::Approx(100).epsilon(1e-10));
  CHECK(std::abs(varying.bias[0]) > 0.01);
  CHECK((varying.flags[0] & ocisac::flag::model_misfit) != 0);
  CHECK(std::abs(gain_of(signal, 3.3, 0).gain[0] - 0.5) > 0.01);
}

TEST_CASE("a drift of the frequency is followed and flagged") {
  const auto varying = gain_of(column(12.3, 0, 1.5), 12.3, 2);
  CHECK(varying.gain[0] == doctest::Approx(0.5).epsilon(5e-3));
  CHECK(varying.bias[0] < -0.01);
  CHECK((varying.flags[0] & ocisac::flag::model_misfit) != 0);
}

TEST_CASE("a steady tone is not flagged") {
  const auto varying = gain_of(column(12.3, 0, 0), 12.3, 3);
  CHECK(varying.gain[0] == doctest::Approx(0.5).epsilon(1e-10));
  CHECK(varying.flags[0] == 0);
}

TEST_CASE("degrees outside their range are refused") {
  CHECK_THROWS_AS(gain_of(column(12.3, 0, 0), 12.3, 5), std::invalid_argument);
  CHECK_THROWS_AS(gain_of(column(12.3, 0, 0), 12.3, -1), std::invalid_argument);
}
