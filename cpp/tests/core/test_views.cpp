#include <doctest/doctest.h>

#include <cstdint>
#include <limits>
#include <stdexcept>
#include <variant>
#include <vector>

#include "ocisac/core/views.hpp"

using ocisac::Region;

TEST_CASE("a region that wraps is not inside") {
  constexpr std::size_t kHuge = std::numeric_limits<std::size_t>::max();
  CHECK(ocisac::is_inside({0, 0, 40, 30}, 40, 30));
  CHECK(ocisac::is_inside({39, 29, 1, 1}, 40, 30));
  for (const Region& outside :
       {Region{1, 0, 40, 30}, Region{0, 1, 40, 30}, Region{0, 0, 0, 30}, Region{0, 0, 40, 0}, Region{kHuge, 0, 2, 2},
        Region{0, kHuge, 2, 2}, Region{2, 2, kHuge, 2}, Region{2, 2, 2, kHuge}, Region{kHuge, kHuge, kHuge, kHuge}})
    CHECK(!ocisac::is_inside(outside, 40, 30));
  CHECK_THROWS_WITH_AS(ocisac::require_inside("region", {kHuge, 0, 2, 2}, 40, 30),
                       "region: got 18446744073709551615,0,2,2, allowed: inside the picture of 40x30",
                       std::invalid_argument);
}

TEST_CASE("every step-th frame is the stored one, in either direction") {
  const std::vector<std::uint8_t> numbers{0, 1, 2, 3, 4, 5, 6, 7};  // one pixel a frame
  for (const bool backwards : {false, true}) {
    const ocisac::FramesView<const std::uint8_t> view{
        numbers.data() + (backwards ? 7 : 0), 8, 1, 1, backwards ? -1 : 1, 1, 1};
    for (std::size_t first = 0; first < 8; ++first)
      for (std::size_t step = 1; step < 10; ++step) {
        const auto part = std::get<ocisac::FramesView<const std::uint8_t>>(ocisac::every_frame(view, first, step));
        CHECK(part.frames == (7 - first) / step + 1);
        for (std::size_t k = 0; k < part.frames; ++k) CHECK(part(k, 0, 0) == view(first + k * step, 0, 0));
      }
  }
}
