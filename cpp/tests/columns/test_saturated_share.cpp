#include <doctest/doctest.h>

#include <cstdint>
#include <limits>
#include <vector>

#include "ocisac/columns/column_combination.hpp"

namespace {

template <class T>
std::vector<double> shares(const std::vector<T>& samples, double dark_level, double white_level) {
  const auto view = ocisac::dense_view<const T>(samples.data(), 1, samples.size() / 2, 2);
  ocisac::ToneCurve curve;
  curve.dark_level = dark_level;
  curve.white_level = white_level;
  return ocisac::saturated_share(view, 0, curve);
}

using Shares = std::vector<double>;

}  // namespace

TEST_CASE("samples at or above dark + 0.98·(white − dark) are saturated") {
  const std::vector<std::uint8_t> bytes{249, 250, 0, 255};
  CHECK(shares(bytes, 0, 0) == Shares{0, 1});      // 249.9
  CHECK(shares(bytes, 0, 250) == Shares{0.5, 1});  // 245
  const std::vector<std::uint16_t> words{980, 979, 0, 0};
  CHECK(shares(words, 0, 1000) == Shares{0.5, 0});
  const std::vector<float> floats{0.97F, 0.99F, 2, 0};
  CHECK(shares(floats, 0, 0) == Shares{0, 0});  // no white level is known
  CHECK(shares(floats, 0, 1) == Shares{0.5, 0.5});
}

TEST_CASE("a saturation level beyond the samples' type is above or below all of them") {
  const std::vector<std::uint8_t> bytes{0, 136, 255, 255};
  CHECK(shares(bytes, 0, 400) == Shares{0, 0});  // 392 is 136 in a byte
  CHECK(shares(bytes, 0, 1e308) == Shares{0, 0});
  CHECK(shares(bytes, -1e303, -1e302) == Shares{1, 1});  // UndefinedBehaviorSanitizer stopped here
  CHECK(shares(bytes, -400, -300) == Shares{1, 1});
  const std::vector<float> floats{0, 1, std::numeric_limits<float>::max(), 0};
  CHECK(shares(floats, 0, 1e300) == Shares{0, 0});
  CHECK(shares(floats, -1e303, -1e302) == Shares{1, 1});
}
