#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "core/spectrum.hpp"

TEST_CASE("half spectra agree with the sum that defines them, and invert") {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (std::size_t length : {1u, 2u, 3u, 7u, 16u, 97u, 720u}) {
    std::vector<double> signals(3 * length);
    for (double& v : signals) v = normal(random);
    const auto spectra = ocisac::half_spectra(signals, length);
    const std::size_t bins = length / 2 + 1;
    REQUIRE(spectra.size() == 3 * bins);
    for (std::size_t s = 0; s < 3; ++s)
      for (std::size_t k = 0; k < bins; ++k) {
        std::complex<double> sum = 0;
        for (std::size_t n = 0; n < length; ++n)
          sum += signals[s * length + n] * std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(k * n % length) /
                                                               static_cast<double>(length));
        CHECK(std::abs(spectra[s * bins + k] - sum) < 1e-10 * std::sqrt(static_cast<double>(length)));
      }
    const auto back = ocisac::signals_of_half_spectra(spectra, length);
    for (std::size_t i = 0; i < signals.size(); ++i) CHECK(back[i] == doctest::Approx(signals[i]).epsilon(1e-10));
  }
}
