#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <numeric>
#include <random>
#include <vector>

#include "ocisac/rows/basis.hpp"
#include "ocisac/rows/tone_search.hpp"
#include "rows/fit.hpp"
#include "rows/verdict.hpp"

namespace {

constexpr double kPi = std::numbers::pi;

// Rows read at uneven times in two frames, with two exposures.
ocisac::RowSampling uneven_rows() {
  ocisac::RowSampling rows;
  rows.frames = 2;
  for (int frame = 0; frame < 2; ++frame)
    for (int n = 0; n < 90; ++n) {
      rows.times.push_back(200 * frame + n + 0.3 * std::sin(0.2 * n));
      rows.exposures.push_back(n % 2 == 0 ? 3.0 : 7.5);
    }
  return rows;
}

// Mean of cos(2πft + φ) over an exposure by its antiderivative.
double exposed(double f, double time, double exposure, double phase) {
  const auto integral = [&](double t) { return std::sin(2 * kPi * f * t + phase) / (2 * kPi * f); };
  return (integral(time + exposure / 2) - integral(time - exposure / 2)) / exposure;
}

}  // namespace

TEST_CASE("columns of a basis are what uneven rows with two exposures see") {
  auto rows = uneven_rows();
  const double f = 0.0631;
  std::vector<double> basis;
  ocisac::append_tones(basis, rows, std::vector{f}, 1);
  const auto columns = ocisac::matrix_of(basis, rows);
  REQUIRE(columns.cols() == 4);
  for (Eigen::Index n = 0; n < columns.rows(); ++n) {
    const auto at = static_cast<std::size_t>(n);
    CHECK(columns(n, 0) == doctest::Approx(exposed(f, rows.times[at], rows.exposures[at], 0)).epsilon(1e-9));
    CHECK(columns(n, 2) == doctest::Approx(exposed(f, rows.times[at], rows.exposures[at], -kPi / 2)).epsilon(1e-9));
  }
  CHECK(columns(0, 1) / columns(0, 0) == doctest::Approx(-1).epsilon(0.02));  // at either end of each frame
  CHECK(columns(89, 1) / columns(89, 0) == doctest::Approx(1).epsilon(0.02));
  CHECK(columns(90, 1) / columns(90, 0) == doctest::Approx(-1).epsilon(0.02));
  rows.weights.assign(rows.times.size(), 0.5);
  std::vector<double> weighted;
  ocisac::append_tones(weighted, rows, std::vector{f}, 1);
  for (std::size_t k = 0; k < basis.size(); ++k) CHECK(weighted[k] == doctest::Approx(0.5 * basis[k]));
}

TEST_CASE("slow light is a cosine transform") {
  std::vector<double> basis;
  const auto rows = ocisac::centred_rows(101);
  ocisac::append_slow_light(basis, rows, 4);
  const auto columns = ocisac::matrix_of(basis, rows);
  for (Eigen::Index k = 0; k < 4; ++k)
    for (Eigen::Index n = 0; n < 101; ++n)
      CHECK(columns(n, k) ==
            doctest::Approx(std::cos(kPi * double(k + 1) * (double(n) + 0.5) / 101)).epsilon(1e-12).scale(1));
}

TEST_CASE("a wave turns from row to row as exactly as it is computed") {
  std::vector<double> times(2000), cosine(2000), sine(2000);
  std::iota(times.begin(), times.end(), -999.5);
  ocisac::fill_wave(times, 0.123456789, cosine, sine);
  for (std::size_t n = 0; n < times.size(); ++n) {
    const auto at = ocisac::phasor(0.123456789, times[n]);
    CHECK(std::abs(cosine[n] - at.cosine) < 1e-14);
    CHECK(std::abs(sine[n] - at.sine) < 1e-14);
  }
}

TEST_CASE("a linear fit predicts its errors and finds dependent columns") {
  const auto rows = ocisac::centred_rows(200);
  const auto design = ocisac::tone_design(rows, std::vector{0.031, 0.117}, 1);
  const auto fit = ocisac::linear_fit(design, 3);
  CHECK((fit.weights.transpose() * design).isApprox(Eigen::MatrixXd::Identity(3, design.cols()), 1e-10));
  CHECK(fit.covariance.isApprox(fit.weights.transpose() * fit.weights, 1e-10));
  CHECK(fit.condition < 10);
  Eigen::MatrixXd twice(200, 2);
  twice << design.col(2), 3 * design.col(2);
  CHECK(std::isinf(ocisac::linear_fit(twice, 2).condition));
}

TEST_CASE("two frequencies are refined together from half a bin off, at even and uneven times") {
  for (auto rows : {ocisac::centred_rows(180), uneven_rows()}) {
    const std::vector truth{0.0523, 0.0601};
    std::vector<double> trend, tones;
    ocisac::append_trend(trend, rows, 1);
    ocisac::append_tones(tones, rows, truth);
    const Eigen::Vector4d levels(0.7, -0.4, 0.3, 0.5);
    const Eigen::MatrixXd others = ocisac::orthogonal_factors(ocisac::matrix_of(trend, rows)).basis;
    const Eigen::VectorXd light =
        ocisac::matrix_of(tones, rows) * levels + ocisac::matrix_of(trend, rows).rowwise().sum() * 5;
    const auto fit =
        ocisac::refine_frequencies(rows, {0.0543, 0.0588}, others, light - others * (others.transpose() * light));
    for (std::size_t k = 0; k < 2; ++k) CHECK(fit.frequencies[k] == doctest::Approx(truth[k]).epsilon(1e-7));
    CHECK(fit.amplitudes.isApprox(levels, 1e-5));
    CHECK(fit.rest.norm() < 1e-5);
  }
}

TEST_CASE("noise is estimated beside slow light and beside tones, and is white") {
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, 3);
  std::vector<double> white(4096), slow(4096), tone(4096);
  for (std::size_t n = 0; n < white.size(); ++n) {
    white[n] = noise(random);
    slow[n] = white[n] + 400 * std::cos(0.002 * double(n));
    tone[n] = white[n] + 50 * std::cos(0.9 * double(n));
  }
  CHECK(ocisac::noise_of_differences(slow) == doctest::Approx(9).epsilon(0.08));
  const auto power = ocisac::periodogram(tone, tone.size(), ocisac::padded_length(tone.size()));
  CHECK(ocisac::noise_floor(power) == doctest::Approx(9).epsilon(0.1));
  CHECK(ocisac::is_white(white));
  CHECK_FALSE(ocisac::is_white(tone));
  for (std::size_t n = 1; n < white.size(); ++n) white[n] += 0.15 * white[n - 1];  // 9.6 standard errors
  CHECK_FALSE(ocisac::is_white(white));
}

TEST_CASE("Schwarz's criterion prefers the model with fewer parameters unless energy falls") {
  CHECK(ocisac::schwarz_criterion(1, 1000, 3) < ocisac::schwarz_criterion(0.9999, 1000, 5));
  CHECK(ocisac::schwarz_criterion(1, 1000, 3) > ocisac::schwarz_criterion(0.98, 1000, 5));
}
