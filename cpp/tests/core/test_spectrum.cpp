#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "core/spectrum.hpp"

TEST_CASE("half spectra agree with the sum that defines them") {
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
  }
}

TEST_CASE("rows of complex values agree with the sum that defines them, in both directions") {
  constexpr std::size_t kRows = 2;
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  for (const std::size_t length : {1u, 2u, 5u, 36u, 49u})
    for (const auto direction : {ocisac::Transform::forward, ocisac::Transform::inverse}) {
      CAPTURE(length);
      std::vector<std::complex<double>> in(kRows * length);
      for (auto& value : in) value = {normal(random), normal(random)};
      const auto out = ocisac::transformed_rows(direction, in, length);
      const double sign = direction == ocisac::Transform::forward ? -2 : 2;
      for (std::size_t row = 0; row < kRows; ++row)
        for (std::size_t k = 0; k < length; ++k) {
          std::complex<double> sum = 0;
          for (std::size_t n = 0; n < length; ++n)
            sum +=
                in[row * length + n] * std::polar(1.0, sign * std::numbers::pi * static_cast<double>(k * n % length) /
                                                           static_cast<double>(length));
          CHECK(std::abs(out[row * length + k] - sum) < 1e-12);
        }
    }
}
