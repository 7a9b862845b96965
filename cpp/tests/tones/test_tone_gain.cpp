#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include "ocisac/rows/basis.hpp"
#include "tones/clipping.hpp"
#include "tones/harmonic_model.hpp"

namespace {

constexpr double kPi = std::numbers::pi;

// Samples of 0 to 4 in 700 rows of 37 columns, every third sample of a row, counted one by one.
template <class T>
void check_counts(double level, double beside) {
  constexpr std::size_t kRows = 700, kColumns = 37, kStride = 3;
  std::mt19937 random(7);
  std::vector<T> samples(kRows * kColumns * kStride);
  for (T& sample : samples) sample = static_cast<T>(random() % 5);
  auto view = ocisac::dense_view<const T>(samples.data(), 1, kRows, kColumns * kStride);
  view.columns = kColumns, view.column_stride = kStride;
  const auto counts = ocisac::count_pile(view, 0, {level, beside, 1});
  for (std::size_t c = 0; c < kColumns; ++c) {
    std::uint32_t at = 0, of_beside = 0, beyond = 0, runs = 0;
    bool was_at = false;
    for (std::size_t n = 0; n < kRows; ++n) {
      const double value = view(0, n, c);
      const bool is_at = value == level;
      at += is_at, of_beside += value == beside, runs += is_at && !was_at;
      beyond += level < beside ? value < level : value > level;
      was_at = is_at;
    }
    CHECK(counts.at[c] == at);
    CHECK(counts.beside[c] == of_beside);
    CHECK(counts.beyond[c] == beyond);
    CHECK(counts.runs[c] == runs);
  }
}

}  // namespace

TEST_CASE("a pile is counted in more rows than a counter of a byte holds, at any stride and of any type") {
  check_counts<std::uint8_t>(1, 2);
  check_counts<std::uint16_t>(3, 2);
  check_counts<float>(1, 2);
  check_counts<double>(3, 2);
}

TEST_CASE("weights of the harmonic model are a pseudo-inverse: they return what the model is made of") {
  for (const std::size_t rows : {5u, 8u, 97u, 720u}) {
    const std::vector<ocisac::ModelTone> tones{{0.21, {1, 2}}};
    const auto model = ocisac::harmonic_model(rows, tones);
    REQUIRE(model.estimates == 3);
    const double middle = (static_cast<double>(rows) - 1) / 2;
    double sums[3] = {0, 0, 0};
    for (std::size_t n = 0; n < rows; ++n) {
      const auto p = ocisac::phasor(0.21, static_cast<double>(n) - middle);
      for (std::size_t i = 0; i < 3; ++i)
        sums[i] += model.weights.col(static_cast<Eigen::Index>(i))[static_cast<Eigen::Index>(n)] *
                   (3 + 2 * p.cosine - 5 * p.sine);
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
  const Eigen::MatrixXd products = model.basis.transpose() * model.basis;
  CHECK((products - Eigen::MatrixXd::Identity(products.rows(), products.cols())).cwiseAbs().maxCoeff() < 1e-12);
}

TEST_CASE("the phasor keeps its phase at large indices") {
  // 2^40 rows of 1/3 cycle each, minus a known remainder: 1/3 as a double is 1/3 − 2^−54/3.
  const double third = 1.0 / 3.0;
  const double u = 3.0 * 0x1p40;
  const double rest = -u * 0x1p-54 / 3;
  CHECK(ocisac::phasor(third, u).sine == doctest::Approx(std::sin(2 * kPi * rest)).epsilon(1e-12));
}
