#include <doctest/doctest.h>

#include <limits>
#include <random>
#include <vector>

#include "ocisac/chips/preamble.hpp"
#include "ocisac/receiver/frame_reading.hpp"

namespace {

constexpr std::size_t kRows = 720;
constexpr double kRowsPerChip = 5.0;

// Pure noise, for which an unbounded search is endless.
std::vector<double> noise_alone() {
  std::mt19937 random(11);
  std::normal_distribution<double> noise(100, 10);
  std::vector<double> rows(kRows);
  for (double& row : rows) row = noise(random);
  return rows;
}

std::vector<double> light(double exposure) {
  std::mt19937 random(12);
  std::vector<double> chips, rows(kRows);
  for (std::size_t k = 0; k < kRows / 5 + 20; ++k) chips.push_back(random() % 2);
  ocisac::expose_chips({chips, -10}, {kRowsPerChip * 1.003, 1.7, exposure * kRowsPerChip}, rows);
  std::normal_distribution<double> noise(0, 1);
  for (double& row : rows) row = 20 + 100 * row + noise(random);
  return rows;
}

}  // namespace

TEST_CASE("a search in vain ends when its effort is used up, and soon") {
  const auto rows = noise_alone();
  for (const double passes : {0.0, 1.0, 20.0, 200.0}) {
    CAPTURE(passes);
    ocisac::SearchEffort effort{passes * kRows};
    CHECK_FALSE(ocisac::search_frame(rows, {kRowsPerChip, 0.02, {}, {}, &effort}));
    CHECK(effort.rows < 0);
    // Requests after the budget is used up are counted but not executed: at most one per start.
    CHECK(effort.rows > -(passes + 1000.0) * kRows);
  }
}

TEST_CASE("effort that suffices changes nothing") {
  const auto rows = light(1.5);
  const ocisac::FrameSearch unlimited{kRowsPerChip, 0.02, 1.5 * kRowsPerChip, {}};
  const auto whole = ocisac::search_frame(rows, unlimited);
  REQUIRE(whole);
  ocisac::SearchEffort effort{5000.0 * kRows};
  auto limited = unlimited;
  limited.effort = &effort;
  const auto same = ocisac::search_frame(rows, limited);
  REQUIRE(same);
  CHECK(same->llr == whole->llr);
  CHECK(same->first == whole->first);
  CHECK(effort.rows > 0);
  CHECK(effort.rows < 4980.0 * kRows);
}
