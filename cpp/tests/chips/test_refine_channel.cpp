#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "ocisac/chips/detect_chips.hpp"
#include "ocisac/chips/preamble.hpp"
#include "ocisac/chips/refine_channel.hpp"

namespace {

constexpr std::size_t kRows = 1080;
const ocisac::DetectChips kDetect = ocisac::level_detector("mlse");

// Random chips with a preamble, through an exposure, under light that falls by `fall` along the frame.
struct Column {
  std::vector<double> chips, preamble, rows;
  ocisac::ChipClock clock{};
  std::ptrdiff_t first = -10, start = 0;

  Column(unsigned seed, double rows_per_chip, double exposure_chips, double noise_share, double fall = 0) {
    std::mt19937 random(seed);
    const double off = static_cast<double>(random() % 2001) / 1000 - 1;
    clock.rows_per_chip = rows_per_chip * (1 + 0.01 * off);
    clock.phase = clock.rows_per_chip * static_cast<double>(random() % 1000) / 1000;
    clock.exposure_rows = exposure_chips * clock.rows_per_chip;
    const auto count = static_cast<std::size_t>(static_cast<double>(kRows) / clock.rows_per_chip) + 20;
    for (std::size_t k = 0; k < count; ++k) chips.push_back(random() % 2);
    const std::size_t at = 20 + random() % (count - 80);
    start = first + static_cast<std::ptrdiff_t>(at);
    preamble.assign(chips.begin() + static_cast<std::ptrdiff_t>(at),
                    chips.begin() + static_cast<std::ptrdiff_t>(at) + 32);
    rows.resize(kRows);
    ocisac::expose_chips({chips, first}, clock, rows);
    std::normal_distribution<double> noise(0, 1);
    for (std::size_t n = 0; n < kRows; ++n)
      rows[n] = 50 + 100 * (rows[n] + noise_share * noise(random)) *
                         (1 - fall * static_cast<double>(n) / static_cast<double>(kRows));
  }

  // Errors among the chips that lie whole in the frame; `shift` is added to the indices of detected chips.
  [[nodiscard]] std::size_t errors(const ocisac::RefinedChannel& found, std::ptrdiff_t shift) const {
    const auto edge = static_cast<std::ptrdiff_t>(std::ceil(clock.exposure_rows / clock.rows_per_chip));
    const auto last = static_cast<std::ptrdiff_t>(static_cast<double>(kRows) / clock.rows_per_chip) - edge - 1;
    std::size_t wrong = 0;
    for (std::ptrdiff_t chip = edge; chip < last; ++chip) {
      const std::ptrdiff_t at = chip - shift - found.first;
      const bool inside = at >= 0 && at < static_cast<std::ptrdiff_t>(found.chips.size());
      wrong += !inside || found.chips[static_cast<std::size_t>(at)] != chips[static_cast<std::size_t>(chip - first)];
    }
    return wrong;
  }
};

}  // namespace

TEST_CASE("a light that falls to a third along the frame is followed") {
  for (double exposure : {0.7, 4.0}) {
    const Column column(3, 4.0, exposure, 0.02, 0.66);
    const auto match = ocisac::find_preamble(column.rows, column.preamble, {.rows_per_chip = 4.0, .exposure_rows = {}});
    REQUIRE(match.size() == 1);
    const auto found = ocisac::refine_channel(column.rows, match[0].channel, kDetect);
    REQUIRE(found);
    CHECK(column.errors(*found, column.start) == 0);
    CHECK(found->channel.swing_at(0, kRows) == doctest::Approx(100).epsilon(0.05));
    CHECK(found->channel.swing_at(kRows - 1, kRows) == doctest::Approx(34).epsilon(0.05));
  }
}

TEST_CASE("without a preamble, from a nominal rate") {
  for (double exposure : {0.5, 1.0, 3.0})
    for (double rows_per_chip : {2.3, 5.1}) {
      const Column column(7, rows_per_chip, exposure, 0.03);
      const auto found = ocisac::find_channel(
          column.rows, {.rows_per_chip = rows_per_chip, .exposure_rows = column.clock.exposure_rows}, kDetect);
      CAPTURE(exposure);
      CAPTURE(rows_per_chip);
      REQUIRE(found);
      const auto& clock = found->channel.clock;
      const double middle = 0.5 * static_cast<double>(kRows);
      const auto shift = std::lround((middle - column.clock.phase) / column.clock.rows_per_chip -
                                     (middle - clock.phase) / clock.rows_per_chip);
      CHECK(column.errors(*found, shift) == 0);
      CHECK(clock.rows_per_chip == doctest::Approx(column.clock.rows_per_chip).epsilon(1e-3));
      CHECK(clock.exposure_rows == doctest::Approx(column.clock.exposure_rows).epsilon(0.03));
    }
}

TEST_CASE("one chip per row, exposure one row, unknown phase") {
  for (unsigned seed = 0; seed < 6; ++seed) {
    CAPTURE(seed);
    const Column column(seed, 1.0, 1.0, 0.02);
    const auto found =
        ocisac::find_channel(column.rows, {.rows_per_chip = 1.0, .exposure_rows = column.clock.exposure_rows}, kDetect,
                             {.exposure_known = true});
    REQUIRE(found);
    const auto& clock = found->channel.clock;
    const auto shift = std::lround((540 - column.clock.phase) / column.clock.rows_per_chip -
                                   (540 - clock.phase) / clock.rows_per_chip);
    CHECK(column.errors(*found, shift) <= 1);
  }
}

TEST_CASE("steady light has no channel") {
  const std::vector<double> steady(kRows, 7.0);
  CHECK_FALSE(ocisac::find_channel(steady, {.rows_per_chip = 4.0, .exposure_rows = 8.0}, kDetect));
  CHECK_FALSE(ocisac::find_channel(std::span(steady).first(1), {.rows_per_chip = 4.0, .exposure_rows = 8.0}, kDetect));
}

TEST_CASE("noise that follows the light leaves the frame even, a clock lost in a part does not") {
  for (unsigned seed = 0; seed < 6; ++seed) {
    Column column(seed, 4.0, 3.0, 0.0);
    std::mt19937 random(seed);
    std::normal_distribution<double> noise(0, 1);
    for (std::size_t n = 0; n < kRows; ++n)
      column.rows[n] += (0.5 + 2.5 * static_cast<double>(n) / static_cast<double>(kRows)) * noise(random);
    const auto matches =
        ocisac::find_preamble(column.rows, column.preamble, {.rows_per_chip = 4.0, .exposure_rows = {}});
    REQUIRE(!matches.empty());
    const auto found = ocisac::refine_channel(column.rows, matches.front().channel, kDetect);
    REQUIRE(found);
    CHECK(column.errors(*found, column.start) == 0);
    CHECK(found->even);

    // The last third comes from another light of the same kind.
    const Column other(seed + 100, 4.0, 3.0, 0.01);
    std::copy(other.rows.begin() + 720, other.rows.end(), column.rows.begin() + 720);
    const auto lost = ocisac::refine_channel(column.rows, matches.front().channel, kDetect);
    CHECK((!lost || !lost->even));
  }
}
