#include <doctest/doctest.h>

#include <cmath>
#include <numbers>

#include "tones/row_moments.hpp"

namespace {

long double plain_sum(std::size_t rows, double frequency, int harmonic, std::size_t power) {
  long double sum = 0;
  for (std::size_t n = 0; n < rows; ++n) {
    const long double u = static_cast<long double>(n) - (static_cast<long double>(rows) - 1) / 2;
    const long double angle = 2 * std::numbers::pi_v<long double> * harmonic * static_cast<long double>(frequency) * u;
    sum += std::pow(2 * u / static_cast<long double>(rows), static_cast<long double>(power)) *
           (power % 2 == 0 ? std::cos(angle) : std::sin(angle));
  }
  return sum;
}

}  // namespace

TEST_CASE("moments of the rows are their sums, from a fraction of a cycle to multiples of half the row rate") {
  constexpr std::size_t kHighest = 62, kPower = 4;
  for (const std::size_t rows : {1, 2, 7, 64, 719, 1080})
    for (const double cycles : {0.1, 0.7, 1.6, 5.0, 12.3, 100.0, 359.5}) {
      const double frequency = cycles / static_cast<double>(rows);
      if (frequency > 0.5) continue;
      const ocisac::RowMoments moments(rows, frequency, kHighest, kPower);
      CAPTURE(rows);
      CAPTURE(cycles);
      for (int k = -static_cast<int>(kHighest); k <= static_cast<int>(kHighest); ++k)
        for (std::size_t p = 0; p <= kPower; ++p) {
          CAPTURE(k);
          CAPTURE(p);
          const auto want = static_cast<double>(plain_sum(rows, frequency, k, p));
          CHECK(std::abs(moments.at(p, k) - want) < 1e-12 * static_cast<double>(rows));
        }
    }
}
