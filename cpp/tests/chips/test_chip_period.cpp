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
