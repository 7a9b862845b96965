// Slow light and tones fitted out of the rows, alone and beside chips.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "ocisac/chips/row_nuisance.hpp"

namespace {

constexpr double kTurn = 2 * std::numbers::pi;

}  // namespace

TEST_CASE("tones and slow light are fitted out beside chips to the last digit, and not beside nothing") {
  std::mt19937 random(3);
  std::vector<double> exposed, light, signal;
  for (std::size_t row = 0; row < 900; ++row) {
    const auto n = static_cast<double>(row);
    if (row % 6 == 0) exposed.resize(exposed.size() + 6, static_cast<double>(random() & 1U));
    light.push_back(30 + 80 * exposed[row]);
    signal.push_back(light[row] + 9 * std::cos(kTurn * 0.031 * n + 1) + 3 * std::sin(kTurn * 0.062 * n) +
                     12 * std::cos(std::numbers::pi * 5 * (n + 0.5) / 900));
  }
  const ocisac::RowNuisance nuisance{0.006, {0.031}};
  const auto beside = ocisac::remove_nuisance(signal, nuisance, exposed);
  REQUIRE(beside);
  CHECK(beside->residual_energy == doctest::Approx(0).epsilon(1e-6));
  double off = 0, off_alone = 0;
  const auto alone = ocisac::remove_nuisance(signal, nuisance);
  REQUIRE(alone);
  for (std::size_t row = 0; row < 900; ++row) {
    off = std::max(off, std::abs(beside->rest[row] - light[row]));
    off_alone = std::max(off_alone, std::abs(alone->rest[row] - light[row]));
  }
  CHECK(off < 1e-8);
  CHECK(off_alone > 1e-3);
  CHECK(!ocisac::remove_nuisance(std::vector<double>(10, 1.0), {0.5, {0.1}}));
}

TEST_CASE("a share of the frame before is fitted out beside chips") {
  std::mt19937 random(7);
  std::vector<double> exposed, before, light, signal;
  for (std::size_t row = 0; row < 900; ++row) {
    if (row % 6 == 0) exposed.resize(exposed.size() + 6, static_cast<double>(random() & 1U));
    if (row % 6 == 0) before.resize(before.size() + 6, static_cast<double>(random() & 1U));
    light.push_back(30 + 80 * exposed[row]);
    signal.push_back(light[row] + 0.35 * before[row]);
  }
  const auto beside = ocisac::remove_nuisance(signal, {.before = before}, exposed);
  REQUIRE(beside);
  double off = 0;
  for (std::size_t row = 0; row < 900; ++row) off = std::max(off, std::abs(beside->rest[row] - light[row]));
  CHECK(off < 1e-8);
}

TEST_CASE("as many harmonics of rectified mains are fitted out before chips are known as are asked for") {
  std::vector<double> signal;
  for (std::size_t row = 0; row < 1080; ++row)
    signal.push_back(std::abs(std::sin(0.5 * kTurn * 0.00222 * static_cast<double>(row))));
  CHECK(ocisac::remove_nuisance(signal, {0, {0.00222}})->residual_energy / 1080 > 2e-3);
  CHECK(ocisac::remove_nuisance(signal, {0, {0.00222}, {}, 3})->residual_energy / 1080 < 5e-4);
}

TEST_CASE("steps of the tones' frequencies beside chips lead to those that the rows have") {
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 0.5);
  constexpr std::size_t kRows = 1080;
  constexpr double kHum = 0.00222, kLamp = 0.0231;
  std::vector<double> exposed, signal;
  for (std::size_t row = 0; row < kRows; ++row) {
    const auto n = static_cast<double>(row);
    if (row % 6 == 0) exposed.resize(exposed.size() + 6, static_cast<double>(random() & 1U));
    signal.push_back(30 + 80 * exposed[row] + 20 * std::cos(kTurn * kHum * n + 1) + 15 * std::cos(kTurn * kLamp * n) +
                     5 * std::sin(3 * kTurn * kLamp * n) + noise(random));
  }
  ocisac::RowNuisance nuisance{0, {kHum + 0.12 / kRows, kLamp - 0.12 / kRows}};
  CHECK(ocisac::remove_nuisance(signal, nuisance)->tone_steps.empty());  // chips leak into the tones
  for (int round = 0; round < 3; ++round) {
    const auto fit = ocisac::remove_nuisance(signal, nuisance, exposed);
    REQUIRE(fit);
    REQUIRE(fit->tone_steps.size() == 2);
    for (std::size_t k = 0; k < 2; ++k) nuisance.tones[k] += fit->tone_steps[k];
  }
  CHECK(std::abs(nuisance.tones[0] - kHum) * kRows < 0.01);  // of a spectral line
  CHECK(std::abs(nuisance.tones[1] - kLamp) * kRows < 0.01);
}

TEST_CASE("the strongest tone stands out at its frequency") {
  std::mt19937 random(4);
  std::normal_distribution<double> noise(0, 1);
  std::vector<double> signal(1080);
  for (std::size_t row = 0; row < signal.size(); ++row)
    signal[row] = 50 + noise(random) + 2 * std::cos(kTurn * 0.0222 * static_cast<double>(row));
  const auto found = ocisac::strongest_tone(signal, signal.size(), 0.006, 0.1);
  CHECK(found.frequency == doctest::Approx(0.0222).epsilon(0.01));
  CHECK(found.prominence > 50);
  for (double& value : signal) value = noise(random);
  CHECK(ocisac::strongest_tone(signal, signal.size(), 0.006, 0.1).prominence < 20);
  // Light with a spectrum of its own: prominence is relative to the tone's neighbourhood, in the mean of several
  // frames.
  std::vector<double> frames(6 * 1080);
  for (std::size_t row = 1; row < frames.size(); ++row) frames[row] = 0.95 * frames[row - 1] + noise(random);
  CHECK(ocisac::strongest_tone(frames, 1080, 0.006, 0.1).prominence < 6);
  for (std::size_t row = 0; row < frames.size(); ++row)
    frames[row] += 2 * std::cos(kTurn * 0.03 * static_cast<double>(row));
  CHECK(ocisac::strongest_tone(frames, 1080, 0.006, 0.1).prominence > 12);
  CHECK(ocisac::strongest_tone(frames, 1080, 0.006, 0.1).frequency == doctest::Approx(0.03).epsilon(0.01));
}
