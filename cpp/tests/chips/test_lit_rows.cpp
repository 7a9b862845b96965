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
}

TEST_CASE("an outline is sharper than the exposure's edges and ends the lit rows") {
  // Light of 12 rows a chip through an exposure of 6, in rows 200 to 329; it begins bright and ends as `chips` do.
  const auto lamp = [](const std::vector<int>& chips) {
    std::vector<double> rows(600, 20.0);
    for (std::size_t row = 200; row < 330; ++row) {
      double light = 0;
      for (std::size_t line = row - 200; line < row - 194; ++line)
        light += chips[std::min(line / 12, chips.size() - 1)] / 6.0;
      rows[row] += 100 * light;
    }
    return rows;
  };
  const auto bright = ocisac::rows_within_outline(lamp({1, 1, 0, 0, 0, 1, 0, 1}), 0.1, 6);
  REQUIRE(bright);
  CHECK(bright->rows.begin == 200);
  CHECK(bright->rows.end == 330);
  CHECK(bright->shortest == 12);
  const auto dark = ocisac::rows_within_outline(lamp({1, 1, 0, 1, 0}), 0.1, 6);
  REQUIRE(dark);
  CHECK(dark->rows.begin == 200);
  CHECK(dark->rows.end >= 200 + 4 * 12 + 6);
  CHECK(dark->rows.end <= 200 + 5 * 12 + 6);
  CHECK(!ocisac::rows_within_outline(lamp({1, 1, 0, 1, 0}), 0.1, 2));    // such edges are as sharp as outlines
  CHECK(!ocisac::rows_within_outline(lamp({0}), 0.1, 6));                // no light
  CHECK(!ocisac::rows_within_outline(lamp_rows(0, 1000, 0.1), 0.1, 6));  // no outline
  CHECK(!ocisac::rows_within_outline(std::vector<double>{1.0}, 0, 6));
}
