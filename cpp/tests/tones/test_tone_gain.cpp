#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include "ocisac/rows/basis.hpp"
#include "tones/clipping.hpp"

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

TEST_CASE("the phasor keeps its phase at large indices") {
  // 2^40 rows of 1/3 cycle each, minus a known remainder: 1/3 as a double is 1/3 − 2^−54/3.
  const double third = 1.0 / 3.0;
  const double u = 3.0 * 0x1p40;
  const double rest = -u * 0x1p-54 / 3;
  CHECK(ocisac::phasor(third, u).sine == doctest::Approx(std::sin(2 * kPi * rest)).epsilon(1e-12));
}
