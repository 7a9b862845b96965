#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <random>
#include <vector>

#include "tones/spectral_votes.hpp"

TEST_CASE("spectral votes are logarithms of what a tone leaves of each signal's weighted energy") {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (const auto& [count, rows, length] :
       {std::array{1u, 9u, 20u}, std::array{2u, 40u, 80u}, std::array{19u, 25u, 27u}, std::array{33u, 30u, 64u}}) {
    std::vector<double> samples(count * rows);
    for (double& v : samples) v = normal(random);
    for (std::size_t n = 0; n < rows; ++n) samples[n] = 3 * std::cos(0.9 * n);  // a tone that leaves little
    const auto votes = ocisac::spectral_votes(samples, rows, length);
    REQUIRE(votes.size() == length / 2 + 1);
    for (std::size_t k = 0; k < votes.size(); ++k) {
      double want = 0;
      for (std::size_t s = 0; s < count; ++s) {
        std::complex<double> sum;
        double window_sum = 0, energy = 0;
        for (std::size_t n = 0; n < rows; ++n) {
          const double window = std::pow(std::sin(std::numbers::pi * (n + 0.5) / rows), 2), v = samples[s * rows + n];
          sum += window * v * std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(k * n % length) / length);
          window_sum += window;
          energy += window * v * v;
        }
        want -= std::log(1 - std::min(2 * std::norm(sum) / (window_sum * energy), 0.9999));
      }
      CAPTURE(k);
      CHECK(votes[k] == doctest::Approx(want).epsilon(1e-9));
    }
  }
}
