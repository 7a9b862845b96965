#include <doctest/doctest.h>

#include <limits>
#include <stdexcept>

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
