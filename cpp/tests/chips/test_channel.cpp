#include <doctest/doctest.h>

#include <array>
#include <random>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/tones/projection.hpp"

namespace {

std::vector<double> random_chips(unsigned seed, std::size_t count) {
  std::mt19937 random(seed);
  std::vector<double> chips(count);
  for (double& chip : chips) chip = random() % 2;
  return chips;
}

// 720 rows with swing 40 above 10, noise 1 % of the swing.
std::vector<double> make_rows(const ocisac::KnownChips& chips, const ocisac::ChipClock& clock, unsigned seed) {
  std::vector<double> rows(720);
  ocisac::expose_chips(chips, clock, rows);
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 0.4);
  for (double& row : rows) row = 10 + 40 * row + noise(random);
  return rows;
}

}  // namespace

TEST_CASE("a channel is the same to the last bit on every SIMD target") {
  const auto chips = random_chips(5, 150);
  const ocisac::ChipClock clock{5.63, 20.2, 27.0};
  const auto rows = make_rows({chips, -3}, clock, 5);
  const ocisac::ChipClock start{5.64, 20.9, 25.0};
  const auto fit = [&] {
    const auto found = ocisac::fit_channel(rows, {chips, -3}, start, {2, 1, false});
    REQUIRE(found);
    return std::array{found->clock.phase, found->clock.rows_per_chip, found->clock.exposure_rows, found->noise};
  };
  const auto expected = fit();
  for (const auto& target : ocisac::simd_targets()) {
    CAPTURE(target);
    ocisac::force_simd_target(target);
    CHECK(fit() == expected);
  }
  ocisac::force_simd_target("");
}
