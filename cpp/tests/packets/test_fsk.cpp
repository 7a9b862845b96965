#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

#include "ocisac/packets/fsk.hpp"

namespace {

constexpr std::array kTones{500.0, 1000.0, 1500.0, 2000.0};
constexpr std::size_t kRows = 500;
constexpr double kAmplitude = 20, kNoise = 2;
const ocisac::Camera kCamera{.row_time = 2e-5, .exposure = 1e-4, .frame_time = {}, .tone_curve = {}};

double response(double tone) {
  const double x = std::numbers::pi * tone * *kCamera.exposure;
  return std::sin(x) / x;
}

std::vector<double> rows_of(double tone, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, kNoise);
  std::vector<double> rows;
  for (std::size_t n = 0; n < kRows; ++n) {
    const double t = static_cast<double>(n) * kCamera.row_time;
    rows.push_back(100 + 1000 * t + kAmplitude * response(tone) * std::cos(2 * std::numbers::pi * tone * t + 0.7) +
                   noise(random));
  }
  return rows;
}

// Mean of value(symbol) over trials of a cosine of `cycles` a row in white noise of 1.
template <class Value>
double mean_of_trials(const ocisac::FskDemodulator& demodulator, std::size_t count, double amplitude, double cycles,
                      int trials, unsigned seed, Value value) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1);
  std::vector<double> rows(count);
  double sum = 0;
  for (int trial = 0; trial < trials; ++trial) {
    for (std::size_t n = 0; n < count; ++n)
      rows[n] = amplitude * std::cos(2 * std::numbers::pi * cycles * static_cast<double>(n)) + noise(random);
    sum += value(demodulator.demodulate(rows));
  }
  return sum / trials;
}

// Of M orthogonal tones at E_s/N_0 = `snr`, as a sum over the other tones.
double sum_error_rate(int tones, double snr) {
  double sum = 0, choices = 1;
  for (int k = 1; k < tones; ++k) {
    choices *= static_cast<double>(tones - k) / k;
    sum += (k % 2 == 1 ? 1 : -1) * choices / (k + 1) * std::exp(-k * snr / (k + 1));
  }
  return sum;
}

}  // namespace

TEST_CASE("FSK: each tone is its symbol, with amplitude, noise and energy") {
  const ocisac::FskDemodulator demodulator(kCamera, kTones, kRows);
  REQUIRE(demodulator.bits() == 2);
  for (unsigned symbol = 0; symbol < kTones.size(); ++symbol) {
    CAPTURE(symbol);
    const auto got = demodulator.demodulate(rows_of(kTones[symbol], symbol));
    const double amplitude = kAmplitude * response(kTones[symbol]);
    CHECK(got.symbol == symbol);
    CHECK(got.log_likelihoods[symbol] == 0);
    CHECK(got.llr[0] * (symbol >= 2 ? 1 : -1) > 100);
    CHECK(got.llr[1] * (symbol % 2 == 1 ? 1 : -1) > 100);
    CHECK(got.amplitude == doctest::Approx(amplitude).epsilon(0.03));
    CHECK(got.noise == doctest::Approx(kNoise).epsilon(0.1));
    const double snr = kRows * std::pow(got.amplitude / got.noise, 2) / 4;
    CHECK(got.snr == doctest::Approx(snr).epsilon(1e-9));
    CHECK(got.error_rate < 1e-9);
  }
}

TEST_CASE("FSK: mean and slope are no part of any tone") {
  const ocisac::FskDemodulator demodulator(kCamera, kTones, kRows);
  std::vector<double> rows;
  for (std::size_t n = 0; n < kRows; ++n) {
    const double t = static_cast<double>(n) * kCamera.row_time;
    rows.push_back(1e4 + 1e6 * t + kAmplitude * std::sin(2 * std::numbers::pi * 1000 * t));
  }
  const auto got = demodulator.demodulate(rows, 0.5);
  CHECK(got.symbol == 1);
  // The sine is correlated with the slope: a part of it cannot be told from a slope.
  CHECK(got.amplitude == doctest::Approx(kAmplitude).epsilon(0.01));
  CHECK(got.noise < 1e-6);
  CHECK_NOTHROW((void)demodulator.demodulate(rows, 0.0));
}

TEST_CASE("FSK: a tone that is not orthogonal to the one before it has its whole energy") {
  constexpr std::size_t kShort = 200;
  constexpr std::array kClose{500.0, 650.0};  // 2 and 2.6 cycles
  const ocisac::FskDemodulator demodulator(kCamera, kClose, kShort);
  std::vector<double> rows;
  for (std::size_t n = 0; n < kShort; ++n)
    rows.push_back(kAmplitude * std::cos(2 * std::numbers::pi * 650 * static_cast<double>(n) * kCamera.row_time + 0.4));
  const auto got = demodulator.demodulate(rows);
  CHECK(got.symbol == 1);
  CHECK(got.noise < 1e-5);
}

TEST_CASE("FSK: the error rate of a noisy tone is that of orthogonal tones") {
  for (const int tones : {2, 4, 8})
    for (const double snr : {0.0, 0.5, 2.0, 6.0, 12.0}) {
      CAPTURE(tones);
      CAPTURE(snr);
      const double expected = sum_error_rate(tones, snr);
      CHECK(ocisac::fsk_symbol_error_rate(static_cast<std::size_t>(tones), snr) ==
            doctest::Approx(expected).epsilon(1e-6));
    }
}

TEST_CASE("FSK: tones that cannot be told apart are refused") {
  const std::vector<std::vector<double>> refused{{500}, {500, 600, 700}, {500, 500}, {500, 25e3}, {500, -1}, {500, 0}};
  for (const auto& tones : refused) CHECK_THROWS_AS(ocisac::check_tones(kCamera, tones), std::invalid_argument);
  CHECK_NOTHROW(ocisac::check_tones(kCamera, std::array{500.0, 24.9e3}));
  CHECK_THROWS_AS(ocisac::FskDemodulator(kCamera, kTones, 7), std::invalid_argument);
  CHECK_THROWS_AS(ocisac::FskDemodulator(kCamera, kTones, 99), std::invalid_argument);  // no cycle of 500 Hz
  CHECK_NOTHROW(ocisac::FskDemodulator(kCamera, kTones, 100));
  CHECK_THROWS_AS(ocisac::fsk_symbol_error_rate(1, 2), std::invalid_argument);
}

TEST_CASE("FSK: rows and amplitudes whose squares overflow are refused by name") {
  const ocisac::FskDemodulator demodulator(kCamera, kTones, kRows);
  auto rows = rows_of(500, 1);
  for (const double amplitude : {-1.0, 1e300, std::numeric_limits<double>::quiet_NaN()})
    CHECK_THROWS_WITH_AS((void)demodulator.demodulate(rows, amplitude), doctest::Contains("amplitude: got"),
                         std::invalid_argument);
  for (double& row : rows) row *= 1e298;
  CHECK_THROWS_WITH_AS((void)demodulator.demodulate(rows), doctest::Contains("signal: got"), std::invalid_argument);
  const auto near = rows_of(500, 1);
  for (std::size_t n = 0; n < kRows; ++n) rows[n] = 1e90 * near[n];
  CHECK(demodulator.demodulate(rows).symbol == 0);
  CHECK(demodulator.demodulate(rows).snr == doctest::Approx(demodulator.demodulate(near).snr));
  std::ranges::fill(rows, 0.0);
  rows[7] = 1e100;
  CHECK_NOTHROW((void)demodulator.demodulate(rows, 1e100));
}

TEST_CASE("FSK: the energy told is right on average") {
  constexpr double kEnergy = 16;
  constexpr int kTrials = 1000;
  const ocisac::FskDemodulator demodulator(kCamera, kTones, kRows);
  const double amplitude = std::sqrt(4 * kEnergy / kRows);  // for noise of 1
  const double mean = mean_of_trials(demodulator, kRows, amplitude, 1500 * kCamera.row_time, kTrials, 3,
                                     [](const ocisac::FskSymbol& got) { return got.snr; });
  CHECK(std::abs(mean - kEnergy) < 3 * std::sqrt(2 * kEnergy / kTrials));  // standard errors
}

TEST_CASE("FSK: the light that is not stated is the strongest tone's amplitude before the exposure") {
  const ocisac::FskDemodulator demodulator(kCamera, kTones, kRows);
  const auto rows = rows_of(2000, 4);
  const auto found = demodulator.demodulate(rows);
  const auto stated = demodulator.demodulate(rows, found.amplitude / response(2000));
  for (std::size_t m = 0; m < kTones.size(); ++m)
    CHECK(found.log_likelihoods[m] == doctest::Approx(stated.log_likelihoods[m]).epsilon(1e-9));
}

TEST_CASE("FSK: the noise is estimated without bias: mean, slope, cosine and sine take four of the rows") {
  constexpr std::size_t kFew = 10;
  constexpr int kTrials = 4000;
  constexpr std::array kFast{10e3, 20e3};
  const ocisac::FskDemodulator demodulator({.row_time = 2e-5, .exposure = {}, .frame_time = {}, .tone_curve = {}},
                                           kFast, kFew);
  const double mean = mean_of_trials(demodulator, kFew, 100, 0.2, kTrials, 5,
                                     [](const ocisac::FskSymbol& got) { return got.noise * got.noise; });
  CHECK(std::abs(mean - 1) < 4 * std::sqrt(2.0 / (kFew - 4) / kTrials));  // standard errors
}

TEST_CASE("FSK: likelihoods are those of amplitudes over noise, in any unit") {
  const ocisac::FskDemodulator demodulator(kCamera, kTones, kRows);
  const auto rows = rows_of(500, 1);
  const auto one = demodulator.demodulate(rows);
  for (const double unit : {1e-3, 1e3, 1e90}) {
    CAPTURE(unit);
    auto scaled = rows;
    for (double& row : scaled) row *= unit;
    const auto got = demodulator.demodulate(scaled);
    CHECK(got.amplitude == doctest::Approx(unit * one.amplitude));
    CHECK(got.noise == doctest::Approx(unit * one.noise));
    for (std::size_t m = 0; m < kTones.size(); ++m)
      CHECK(got.log_likelihoods[m] == doctest::Approx(one.log_likelihoods[m]).epsilon(1e-9));
  }
}
