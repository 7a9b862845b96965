#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "chips/chip_period.hpp"

TEST_CASE("bits have the smallest period that repeats throughout") {
  const auto repeated = [](std::vector<std::uint8_t> bits, std::size_t count) {
    for (std::size_t k = 0; bits.size() < count; ++k) bits.push_back(bits[k]);
    return bits;
  };
  CHECK(ocisac::chip_period(repeated({1, 0}, 24)) == 2);
  CHECK(ocisac::chip_period(repeated({1, 0, 0}, 30)) == 3);
  CHECK(ocisac::chip_period(repeated({1, 1, 0, 0}, 30)) == 4);
  CHECK(!ocisac::chip_period(repeated({1, 0, 1, 1, 0}, 30)));
  CHECK(!ocisac::chip_period(repeated({1, 0}, 23)));
  auto broken = repeated({1, 0}, 40);
  broken[20] = 0;
  CHECK(!ocisac::chip_period(broken));
}

TEST_CASE("periodic chips show the same rows with the shortest exposure") {
  constexpr std::size_t kRows = 200;
  struct Case {
    std::vector<double> period;
    double exposure, shortest;  // chips
  };
  for (const Case& one : {Case{{1, 0}, 7.7, 0.3}, Case{{1, 0}, 1.4, 0.6}, Case{{1, 0}, 2.5, 0.5},
                          Case{{1, 0, 0}, 7.2, 1.2}, Case{{1, 1, 0, 1}, 5.1, 1.1}}) {
    CAPTURE(one.exposure);
    const auto& [period, exposure, shortest] = one;
    std::vector<double> chips;
    std::vector<std::uint8_t> bits;
    for (std::size_t k = 0; k < 96; ++k) {
      chips.push_back(period[k % period.size()]);
      if (k < 48) bits.push_back(chips.back() > 0);
    }
    ocisac::ChannelEstimate channel;
    channel.clock = {5, -100, 5 * exposure};
    channel.dark = {10, 3};
    channel.swing = {50, -4, 1};
    const auto shorter = ocisac::with_shortest_exposure(channel, bits);
    REQUIRE(shorter);
    CHECK(shorter->clock.exposure_rows == doctest::Approx(5 * shortest));
    std::vector<double> was(kRows), is(kRows);
    ocisac::expose_chips({chips, 0}, channel.clock, was);
    ocisac::expose_chips({chips, 0}, shorter->clock, is);
    for (std::size_t n = 0; n < kRows; ++n) {
      const auto row = static_cast<double>(n);
      CHECK(shorter->dark_at(row, kRows) + shorter->swing_at(row, kRows) * is[n] ==
            doctest::Approx(channel.dark_at(row, kRows) + channel.swing_at(row, kRows) * was[n]));
    }
    CHECK(!ocisac::with_shortest_exposure(*shorter, bits));
  }
}
