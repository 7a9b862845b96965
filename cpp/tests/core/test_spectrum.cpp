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

TEST_CASE_TEMPLATE("rows of complex values agree with the sum that defines them, in both directions", T, float,
                   double) {
  constexpr std::size_t kRows = 2, kPitch = 50;
  std::mt19937 random(2);
  std::normal_distribution<T> normal;
  for (const std::size_t length : {1u, 2u, 5u, 36u, 49u})
    for (const auto direction : {ocisac::Transform::forward, ocisac::Transform::inverse}) {
      CAPTURE(length);
      std::vector<std::complex<T>> in(kRows * kPitch), out(kRows * kPitch, 7);
      for (auto& value : in) value = {normal(random), normal(random)};
      ocisac::transform_rows(direction, in.data(), out.data(), kRows, length, kPitch);
      const double sign = direction == ocisac::Transform::forward ? -2 : 2;
      for (std::size_t row = 0; row < kRows; ++row)
        for (std::size_t k = 0; k < length; ++k) {
          std::complex<double> sum = 0;
          for (std::size_t n = 0; n < length; ++n)
            sum += std::complex<double>(in[row * kPitch + n]) *
                   std::polar(1.0, sign * std::numbers::pi * static_cast<double>(k * n % length) /
                                       static_cast<double>(length));
          CHECK(std::abs(std::complex<double>(out[row * kPitch + k]) - sum) <
                (std::is_same_v<T, float> ? 1e-4 : 1e-12));
        }
      CHECK(out[length] == std::complex<T>(7));  // not written
    }
}
