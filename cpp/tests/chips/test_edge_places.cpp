// Edges of the light that lie off the chip clock: chips detected beside them, and their places found.
#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <vector>

#include "chips/edge_places.hpp"
#include "ocisac/chips/chip_equations.hpp"
#include "ocisac/chips/detect_chips.hpp"
#include "ocisac/receiver/frame_reading.hpp"
#include "ocisac/rows/chip_clock.hpp"

namespace {

constexpr double kDark = 20, kSwing = 100, kNoise = 0.4;

// Manchester code of random bits whose edges are late by `late(edge, falls)` chips, filmed over `length` chips.
struct Film {
  std::vector<double> chips, signal;
  ocisac::ChannelEstimate channel;  // as it is, with edges on the clock

  template <typename Late>
  Film(double rows_per_chip, double length, const Late& late, unsigned seed = 1, std::size_t rows = 1080) {
    std::mt19937 random(seed);
    std::normal_distribution<double> noise(0, kNoise);
    for (double row = -4 * length * rows_per_chip; row < static_cast<double>(rows) + 4 * length * rows_per_chip;
         row += 2 * rows_per_chip) {
      chips.push_back(static_cast<double>(random() & 1U));
      chips.push_back(1 - chips.back());
    }
    const double phase = -3.7 * length * rows_per_chip, exposure = length * rows_per_chip;
    std::vector<double> edges{phase};  // chip k is bright or dark from edges[k] on
    for (std::size_t k = 1; k < chips.size(); ++k)
      edges.push_back(phase + (static_cast<double>(k) + late(random, chips[k] < chips[k - 1])) * rows_per_chip);
    edges.push_back(phase + static_cast<double>(chips.size()) * rows_per_chip);
    for (std::size_t n = 0; n < rows; ++n) {
      const double begin = static_cast<double>(n) - 0.5 * exposure, end = begin + exposure;
      double light = 0;
      for (std::size_t k = 0; k < chips.size(); ++k)
        light += chips[k] * (std::clamp(edges[k + 1], begin, end) - std::clamp(edges[k], begin, end));
      signal.push_back(kDark + kSwing * light / exposure + noise(random));
    }
    channel = {.clock = {rows_per_chip, phase, exposure},
               .errors = {},
               .dark = {kDark, 0},
               .swing = {kSwing},
               .noise = 0.04 * kSwing,
               .rows = ocisac::rows_of({chips, 0}, {rows_per_chip, phase, exposure}, rows)};
  }

  [[nodiscard]] std::size_t wrong(double edge_std) const {
    ocisac::ChannelEstimate used = *ocisac::fit_channel(signal, {chips, 0}, channel.clock, {1, 0, true});
    used.clock.edge_std = edge_std;
    const ocisac::ChipRows rows(signal, used);
    const auto question = rows.question();
    const auto found = ocisac::detect_chips(question, "reduced").llr;
    std::size_t errors = 0;
    for (std::size_t k = 8; k + 8 < found.size(); ++k)
      errors += (found[k] > 0) != (chips[static_cast<std::size_t>(question.first) + k] > 0.5);
    return errors;
  }
};

double uniform(std::mt19937& random, double reach) {
  return std::uniform_real_distribution<double>(-reach, reach)(random);
}

}  // namespace

TEST_CASE("the noise of edges off the clock is that of its covariance matrix") {
  std::mt19937 random(4);
  std::vector<double> rows(60);
  for (double& row : rows) row = uniform(random, 1);
  const double rows_per_chip = 3.1, length = 2.4, noise = 0.05, edge_std = 0.2;
  const std::size_t count = 24;
  ocisac::ChipClock clock{rows_per_chip, 1.3, length * rows_per_chip};
  clock.edge_std = edge_std;
  const ocisac::ChipEquations equations({rows, clock, noise, -2, count}, 24);
  Eigen::MatrixXd shares(60, 24), edges = Eigen::MatrixXd::Zero(60, 24);
  for (Eigen::Index k = 0; k < 24; ++k) {
    std::vector<double> one(24), seen(60);
    one[static_cast<std::size_t>(k)] = 1;
    ocisac::expose_chips({one, -2}, clock, seen);
    for (Eigen::Index n = 0; n < 60; ++n) {
      shares(n, k) = seen[static_cast<std::size_t>(n)];
      const double place = 1.3 + static_cast<double>(k - 2) * rows_per_chip, off = static_cast<double>(n) - place;
      if (k > 0 && std::abs(off) < 0.5 * length * rows_per_chip) edges(n, k) = 1 / length;
    }
  }
  const double curved = 0.8 * std::pow(edge_std, 3) / (length * length);
  const Eigen::MatrixXd covariance =
      (noise * noise + curved) * Eigen::MatrixXd::Identity(60, 60) + edge_std * edge_std * edges * edges.transpose();
  const Eigen::MatrixXd expected =
      shares.transpose() * covariance.ldlt().solve(shares) + 4 * Eigen::MatrixXd::Identity(24, 24);
  CHECK(equations.band() == 8);
  for (std::size_t k = 0; k < count; ++k)
    for (std::size_t back = 0; back <= std::min(k, equations.band()); ++back)
      CHECK(equations.normal(k, back) ==
            doctest::Approx(expected(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(k - back))).epsilon(1e-6));
}

TEST_CASE("chips whose edges jitter, fall late or rise late are detected beside the noise of their edges") {
  for (const double length : {0.6, 2.0, 5.0, 9.0}) {
    const Film jitter(5.63, length, [](std::mt19937& random, bool) { return uniform(random, 0.2); });
    CHECK(jitter.wrong(0.15) == 0);
    const Film late_falls(5.63, length, [](std::mt19937&, bool falls) { return falls ? 0.22 : -0.22; });
    CHECK(late_falls.wrong(0.15) == 0);
    const Film on_clock(5.63, length, [](std::mt19937&, bool) { return 0.0; });
    CHECK(on_clock.wrong(0.15) == 0);
  }
  const Film jitter(5.63, 5, [](std::mt19937& random, bool) { return uniform(random, 0.3); });
  CHECK(jitter.wrong(0) > 10);
  CHECK(jitter.wrong(0.15) == 0);
}

TEST_CASE("edges of known chips are put on the clock, and the levels are found beside them") {
  for (const auto& [rows_per_chip, length] : {std::pair{5.63, 5.0}, std::pair{11.26, 2.5}, std::pair{5.63, 9.0}}) {
    const Film film(rows_per_chip, length, [](std::mt19937& random, bool) { return uniform(random, 0.2); });
    ocisac::ChannelEstimate channel = film.channel;
    channel.clock.edge_std = 0.15;
    channel.dark = {kDark + 1, 1};
    channel.swing = {kSwing - 3};
    const auto rest = ocisac::place_edges(film.signal, {film.chips, 0}, channel).rest;
    CHECK(channel.noise == doctest::Approx(kNoise).epsilon(0.15));
    CHECK(channel.dark[0] == doctest::Approx(kDark).epsilon(0.05));
    CHECK(channel.swing[0] == doctest::Approx(kSwing).epsilon(0.02));
    const auto left = ocisac::channel_residual(rest, {film.chips, 0}, channel);
    CHECK(std::sqrt(std::inner_product(left.begin(), left.end(), left.begin(), 0.0) / 1080) < 1.2 * kNoise);
  }
}

TEST_CASE("a frame whose edges jitter is a misfit on the clock, and fits with edges off it") {
  const Film film(5.63, 5, [](std::mt19937& random, bool) { return uniform(random, 0.2); });
  const auto even = ocisac::read_frame(film.signal, film.channel, true);
  REQUIRE(even);
  CHECK(even->trust < ocisac::Trust::fits);
  ocisac::ChannelEstimate loose = even->channel;
  loose.clock.edge_std = 0.15;
  const auto reading = ocisac::read_frame(film.signal, loose, true);
  REQUIRE(reading);
  CHECK(reading->trust == ocisac::Trust::fits);
  CHECK(reading->channel.noise == doctest::Approx(kNoise).epsilon(0.15));
}

TEST_CASE("a frame whose edges lie off the clock alike is a misfit with edges off it: the clock is wrong") {
  std::size_t edge = 0;
  const Film film(5.63, 5, [&edge](std::mt19937&, bool) { return 0.3 * std::sin(0.1 * static_cast<double>(edge++)); });
  ocisac::ChannelEstimate loose = film.channel;
  loose.clock.edge_std = 0.15;
  const auto reading = ocisac::read_frame(film.signal, loose, true);
  REQUIRE(reading);
  CHECK(reading->trust < ocisac::Trust::fits);
  CHECK(reading->edge_correlation > 0.5);
}
