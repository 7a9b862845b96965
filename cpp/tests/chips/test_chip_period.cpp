#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "chips/chip_period.hpp"

namespace {

using Bits = std::vector<std::uint8_t>;

Bits repeated(Bits bits, std::size_t count) {
  for (std::size_t k = 0; bits.size() < count; ++k) bits.push_back(bits[k]);
  return bits;
}

std::size_t period_of(const Bits& bits) {
  const auto period = ocisac::chip_period(bits);
  return period ? period->size() : 0;
}

}  // namespace

TEST_CASE("bits have the smallest period that repeats throughout") {
  CHECK(period_of({}) == 0);
  CHECK(period_of(Bits(24, 1)) == 1);
  CHECK(period_of(repeated({1, 0}, 24)) == 2);
  CHECK(period_of(repeated({1, 0, 0}, 30)) == 3);
  CHECK(period_of(repeated({1, 1, 0, 0}, 30)) == 4);
  auto broken = repeated({1, 0}, 40);
  broken[20] = 0;
  CHECK(period_of(broken) == 0);
}

TEST_CASE("lamps dimmed at any duty are periodic, from as many bits as chance does not explain") {
  for (std::size_t period = 2; period < 40; ++period)
    for (std::size_t bright = 1; bright < period; ++bright) {
      Bits bits(period);
      for (std::size_t k = 0; k < bright; ++k) bits[(k + bright) % period] = 1;
      CHECK(period_of(repeated(bits, 3 * period + 6)) == period);
      CHECK(period_of(repeated(bits, period + 6)) == 0);
    }
}

TEST_CASE("data that repeat have more than one rise in a period") {
  CHECK(period_of(repeated({1, 0, 1, 1, 0}, 200)) == 0);
  CHECK(period_of(repeated({0, 1, 1, 0, 1, 0, 0, 1, 0, 1, 0, 1, 1, 0, 1, 0, 0, 1, 1, 0}, 200)) == 0);
}

TEST_CASE("dark chips beyond a lamp that fades do not hide its period") {
  auto bits = repeated({1, 0, 0}, 40);
  bits.insert(bits.begin(), 7, 0);
  bits.insert(bits.end(), 5, 0);
  CHECK(period_of(bits) == 3);
}

TEST_CASE("a lamp that comes and goes along the rows is periodic, pulses with data are not") {
  auto bits = repeated({0, 1}, 74);
  for (std::size_t k = 41; k < 51; ++k) bits[k] = 0;
  for (std::size_t k = 0; k < 11; ++k) bits[k] = bits[73 - k] = 0;
  CHECK(period_of(bits) == 0);
  CHECK(ocisac::are_periodic(bits));
  bits[20] = 1;
  CHECK(!ocisac::are_periodic(bits));
  Bits few(110);
  few[20] = few[22] = few[60] = few[80] = 1;
  CHECK(!ocisac::are_periodic(few));
  std::mt19937 random(4);
  int pulses = 0;
  for (int draw = 0; draw < 1000; ++draw) {
    Bits data(2 * (8 + random() % 40));
    for (std::size_t k = 0; k < data.size(); k += 2) data[k] = random() & 1U;
    pulses += ocisac::are_periodic(data);
  }
  CHECK(pulses < 20);
}

TEST_CASE("random bits have no period") {
  std::mt19937 random(3);
  std::bernoulli_distribution even;
  std::size_t periodic = 0;
  for (int draw = 0; draw < 20000; ++draw) {
    Bits bits(24);
    for (auto& bit : bits) bit = even(random);
    periodic += period_of(bits) > 0;
  }
  CHECK(periodic <= 5);
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
