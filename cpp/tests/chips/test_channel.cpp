#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/chips/preamble.hpp"
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

TEST_CASE("a row sees the mean of the chips over its exposure") {
  const std::array<double, 3> chips{0, 1, 0.5};
  std::vector<double> out(8);
  ocisac::expose_chips({chips, 0}, {2.0, 1.5, 1.0}, out);  // chip 0 from row 1.5, chip 1 from 3.5, chip 2 from 5.5
  const std::array<double, 8> expected{0, 0, 0, 0, 1, 1, 0.5, 0.5};
  for (std::size_t n = 0; n < 8; ++n) CHECK(out[n] == doctest::Approx(expected[n]));
  ocisac::expose_chips({chips, 1}, {2.0, 1.5, 4.0}, out);  // 2 rows later, ramps over 4 rows
  CHECK(out[5] == doctest::Approx(0.375));
}

TEST_CASE("clock, exposure and levels are found within their standard errors") {
  unsigned seed = 0;
  for (double exposure : {1.7, 9.0, 30.0, 52.0}) {
    CAPTURE(exposure);
    const auto chips = random_chips(++seed, 220);
    const ocisac::KnownChips known{chips, -10};
    const ocisac::ChipClock clock{3.7, 1.2, exposure};
    const auto rows = make_rows(known, clock, seed);
    const auto fitted = ocisac::fit_channel(rows, known, {3.705, 0.6, 1.1 * exposure});
    REQUIRE(fitted);
    CHECK(fitted->converged);
    CHECK(std::abs(fitted->clock.rows_per_chip - 3.7) < 4 * fitted->errors.rows_per_chip_std());
    CHECK(std::abs(fitted->clock.exposure_rows - exposure) < 4 * fitted->errors.exposure_rows_std());
    CHECK(std::abs(fitted->clock.phase - 1.2) < 4 * fitted->errors.phase_std(0));
    CHECK(fitted->errors.phase_std(0) > fitted->errors.phase_std(fitted->errors.chip));
    CHECK(fitted->noise == doctest::Approx(0.4).epsilon(0.15));
    CHECK(fitted->dark_at(360, 720) == doctest::Approx(10).epsilon(0.1));
    CHECK(fitted->swing_at(0, 720) == doctest::Approx(40).epsilon(0.1));
  }
}

TEST_CASE("a preamble is found, and only where it is") {
  auto chips = random_chips(9, 220);
  const auto preamble = random_chips(10, 32);
  std::ranges::copy(preamble, chips.begin() + 90);
  for (double exposure : {0.5, 4.0, 20.0}) {
    CAPTURE(exposure);
    const auto rows = make_rows({chips, -10}, {3.7, 1.2, exposure}, 11);
    const auto found = ocisac::find_preamble(rows, preamble, {.rows_per_chip = 3.72, .exposure_rows = {}});
    REQUIRE(found.size() == 1);
    CHECK(found[0].channel.clock.phase == doctest::Approx(1.2 + 80 * 3.7).epsilon(0.002));
    CHECK(found[0].explained > 0.99);
    CHECK(
        ocisac::find_preamble(rows, random_chips(12, 64), {.rows_per_chip = 3.72, .exposure_rows = exposure}).empty());
  }
}

TEST_CASE("what determines nothing gives no channel") {
  const std::vector<double> rows(100, 1.0), bright(20, 1.0);
  CHECK_FALSE(ocisac::fit_channel(rows, {bright, 0}, {4, 0, 2}));
  CHECK_FALSE(ocisac::clock_bounds({bright, 0}, {4, 0, 2}, rows, 0.1));
  CHECK(ocisac::find_preamble({}, bright, {.rows_per_chip = 4, .exposure_rows = {}}).empty());
  CHECK_THROWS_AS(ocisac::fit_channel(rows, {bright, 0}, {0, 0, 2}), std::invalid_argument);
  CHECK_THROWS_AS(ocisac::fit_channel(rows, {{}, 0}, {1, 0, 2}), std::invalid_argument);
}

TEST_CASE("estimates are pooled by their errors") {
  const std::array<double, 4> values{1.0, 2.0, 50.0, NAN}, errors{1.0, 0.5, INFINITY, 1.0};
  const auto pooled = ocisac::pool_estimates(values, errors);
  CHECK(pooled.count == 2);
  CHECK(pooled.value == doctest::Approx(1.8));
  CHECK(pooled.std == doctest::Approx(1 / std::sqrt(5.0)));
}

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
