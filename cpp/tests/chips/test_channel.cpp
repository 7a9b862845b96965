#include <doctest/doctest.h>

#include <array>
#include <cmath>
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

TEST_CASE("two exposures in turns are those of two even clocks, and fitted together") {
  const auto chips = random_chips(7, 170);
  const ocisac::KnownChips known{chips, -9};
  ocisac::ChipClock clock{5.63, 20.2, 27.0};
  clock.shorter = 0.3;
  clock.later = -21.4;
  clock.long_row = 3;
  const ocisac::ChipClock longer{5.63, 20.2, 27.0}, shorter{5.63, 20.2 + 21.4, 0.3 * 27.0};
  std::vector<double> rows(720), of_longer(720), of_shorter(720);
  ocisac::expose_chips(known, clock, rows);
  ocisac::expose_chips(known, longer, of_longer);
  ocisac::expose_chips(known, shorter, of_shorter);
  for (std::size_t n = 0; n < rows.size(); ++n)
    CHECK(rows[n] == doctest::Approx((n + 1) % 4 < 2 ? of_longer[n] : of_shorter[n]).epsilon(1e-9));
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 0.4);
  for (std::size_t n = 0; n < rows.size(); ++n)
    rows[n] = 10 + 40 * rows[n] + noise(random) / clock.share_at(static_cast<std::ptrdiff_t>(n));
  ocisac::ChipClock start = clock;
  start.phase += 0.7;
  start.exposure_rows = 25;
  const auto found = ocisac::fit_channel(rows, known, start, {1, 0, false});
  REQUIRE(found);
  CHECK(found->noise == doctest::Approx(0.4).epsilon(0.1));
  CHECK(std::abs(found->clock.exposure_rows - 27) < 4 * found->errors.exposure_rows_std());
  CHECK(std::abs(found->clock.rows_per_chip - 5.63) < 4 * found->errors.rows_per_chip_std());
  CHECK(found->errors.exposure_rows_std() < 0.1);
}
