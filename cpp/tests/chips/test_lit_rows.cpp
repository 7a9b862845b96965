// The rows in which a lamp stands.
#include <doctest/doctest.h>

#include <random>
#include <vector>

#include "chips/lit_rows.hpp"

namespace {

std::vector<double> lamp_rows(std::size_t begin, std::size_t end, double noise) {
  std::mt19937 random(7);
  std::normal_distribution<double> of_row(0, noise);
  std::vector<double> signal(1000);
  unsigned bit = 0;
  for (std::size_t row = 0; row < signal.size(); ++row) {
    if (row % 10 == 0) bit = random() & 1U;
    if (row % 10 == 5) bit ^= 1U;  // Manchester code, 5 rows a chip
    signal[row] = 20 + (row >= begin && row < end && bit != 0 ? 100.0 : 0.0) + of_row(random);
  }
  return signal;
}

}  // namespace

TEST_CASE("rows that no lamp reaches are left out") {
  for (const double noise : {0.5, 3.0}) {
    const auto lit = ocisac::lit_rows(lamp_rows(300, 640, noise), noise);
    CHECK(lit.rows.begin >= 300);
    CHECK(lit.rows.begin <= 310);
    CHECK(lit.rows.end <= 640);
    CHECK(lit.rows.end >= 630);
    CHECK(lit.shortest >= 3);
    CHECK(lit.shortest <= 7);
  }
}

TEST_CASE("where the light was found with a margin, few dark rows are enough, and none leave that place") {
  const auto few = ocisac::lit_rows(lamp_rows(60, 960, 1), 1, {40, 980}).rows;
  CHECK(few.begin >= 60);
  CHECK(few.begin <= 70);
  CHECK(few.end <= 960);
  CHECK(few.end >= 950);
  const auto whole = ocisac::lit_rows(lamp_rows(0, 1000, 1), 1, {100, 900}).rows;
  CHECK(whole.begin == 100);
  CHECK(whole.end == 900);
}

TEST_CASE("a lamp that fills the frame keeps all rows, and so does a frame without one") {
  const auto whole = ocisac::lit_rows(lamp_rows(0, 1000, 2), 2);
  CHECK(whole.rows.begin == 0);
  CHECK(whole.rows.end == 1000);
  CHECK(ocisac::lit_rows(lamp_rows(0, 0, 2), 2).rows.size() == 1000);
  CHECK(ocisac::lit_rows(std::vector<double>(1000, 5.0), 0).rows.size() == 1000);
  CHECK(ocisac::lit_rows(std::vector<double>{1.0}, 0).rows.size() == 1);
  std::vector<double> turning(1000);  // from row to row
  for (std::size_t n = 0; n < turning.size(); n += 2) turning[n] = 1;
  CHECK(ocisac::lit_rows(turning, 0.02).rows.size() == 1000);
  CHECK(ocisac::lit_rows(turning, 0.02, {0, 1000}, {.expected = true}).rows.size() == 1000);
}
