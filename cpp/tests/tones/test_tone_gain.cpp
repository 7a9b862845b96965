#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "ocisac/rows/basis.hpp"
#include "tones/harmonic_model.hpp"

namespace {

constexpr double kPi = std::numbers::pi;

}  // namespace

TEST_CASE("weights of the harmonic model are a pseudo-inverse: they return what the model is made of") {
  for (const std::size_t rows : {5u, 8u, 97u, 720u}) {
    const std::vector<ocisac::ModelTone> tones{{0.21, {1, 2}}};
    const auto model = ocisac::harmonic_model(rows, tones);
    REQUIRE(model.estimates == 3);
    const double middle = (static_cast<double>(rows) - 1) / 2;
    double sums[3] = {0, 0, 0};
    for (std::size_t n = 0; n < rows; ++n) {
      const auto p = ocisac::phasor(0.21, static_cast<double>(n) - middle);
      for (std::size_t i = 0; i < 3; ++i) sums[i] += model.weights[i * rows + n] * (3 + 2 * p.cosine - 5 * p.sine);
    }
    CHECK(sums[0] == doctest::Approx(3).epsilon(1e-12));
    CHECK(sums[1] == doctest::Approx(2).epsilon(1e-12));
    CHECK(sums[2] == doctest::Approx(-5).epsilon(1e-12));
  }
}

TEST_CASE("basis of the harmonic model is orthonormal") {
  const std::vector<ocisac::ModelTone> tones{{0.013, ocisac::square_wave_harmonics(0.013, 0.5)}};
  const auto model = ocisac::harmonic_model(720, tones);
  CHECK(model.parameters == 1 + 2 * tones[0].harmonics.size());
  for (std::size_t i = 0; i < model.parameters; ++i)
    for (std::size_t j = 0; j <= i; ++j) {
      double sum = 0;
      for (std::size_t n = 0; n < 720; ++n) sum += model.basis[i * 720 + n] * model.basis[j * 720 + n];
      CHECK(std::abs(sum - (i == j)) < 1e-12);
    }
}

TEST_CASE("the phasor keeps its phase at large indices") {
  // 2^40 rows of 1/3 cycle each, minus a known remainder: 1/3 as a double is 1/3 − 2^−54/3.
  const double third = 1.0 / 3.0;
  const double u = 3.0 * 0x1p40;
  const double rest = -u * 0x1p-54 / 3;
  CHECK(ocisac::phasor(third, u).sine == doctest::Approx(std::sin(2 * kPi * rest)).epsilon(1e-12));
}
