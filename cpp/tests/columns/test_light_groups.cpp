// Lights side by side on the same rows, as groups of columns.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "ocisac/columns/column_combination.hpp"

namespace {

constexpr std::size_t kRows = 720, kColumns = 640, kFirstRow = 240, kLastRow = 480, kPitch = 100, kWidth = 16;

// Lamps of kWidth columns, random chips of 3 rows, all on the same rows; 40 chips each, so that two are often alike.
std::vector<std::uint8_t> lamps_beside(std::size_t lamps, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 3);
  std::vector<double> light(kRows * kColumns, 20.0);
  for (std::size_t lamp = 0; lamp < lamps; ++lamp) {
    double level = 0;
    for (std::size_t row = kFirstRow; row < kLastRow; ++row) {
      if (row % 3 == 0) level = static_cast<double>(random() & 1U);
      const std::size_t begin = 20 + lamp * kPitch;
      for (std::size_t column = begin; column < begin + kWidth; ++column) light[row * kColumns + column] += 120 * level;
    }
  }
  std::vector<std::uint8_t> pixels(light.size());
  std::ranges::transform(light, pixels.begin(), [&](double value) {
    return static_cast<std::uint8_t>(std::lround(std::clamp(value + noise(random), 0.0, 255.0)));
  });
  return pixels;
}

std::vector<ocisac::LightGroup> groups_of(const std::vector<std::uint8_t>& pixels) {
  return ocisac::light_groups(ocisac::dense_view<const std::uint8_t>(pixels.data(), 1, kRows, kColumns), 0, {});
}

// Lamps whose columns a group has; a lamp's columns share blocks with those about it.
std::size_t lamps_of(const ocisac::LightGroup& group, std::size_t lamps) {
  std::size_t count = 0;
  for (std::size_t lamp = 0; lamp < lamps; ++lamp) {
    const auto* const columns = group.columns.data() + 20 + lamp * kPitch;
    count += std::any_of(columns, columns + kWidth, [](auto used) { return used != 0; });
  }
  return count;
}

}  // namespace

TEST_CASE("lamps on the same rows are groups of their own though their chips are alike by chance") {
  for (unsigned seed = 0; seed < 20; ++seed) {
    CAPTURE(seed);
    const auto groups = groups_of(lamps_beside(6, seed));
    CHECK(groups.size() == 6);
    for (const auto& group : groups) CHECK(lamps_of(group, 6) == 1);
  }
}

TEST_CASE("one lamp is no group") {
  for (unsigned seed = 0; seed < 20; ++seed) {
    CAPTURE(seed);
    CHECK(groups_of(lamps_beside(1, seed)).empty());
  }
}
