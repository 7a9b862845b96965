#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "cleaning/merged_blocks.hpp"
#include "ocisac/cleaning/restore_picture.hpp"
#include "ocisac/cleaning/stored_scene.hpp"

namespace ocisac {

namespace {

constexpr double inf = std::numeric_limits<double>::infinity();

// Light equals the stored value; 250 and above are saturated.
StoredTable tables_of_bytes() {
  StoredTable table{std::vector<double>(256), std::vector<double>(256, 1), std::vector<double>(255)};
  std::iota(table.light.begin(), table.light.end(), 0.0);
  for (std::size_t k = 250; k < 256; ++k) table.variance[k] = inf;
  std::iota(table.bounds.begin(), table.bounds.end(), 0.5);
  return table;
}

struct Restored {
  std::vector<std::uint8_t> picture, marks;
  std::vector<float> share;
};

Restored restored(const std::vector<std::uint8_t>& stored, const BlockShares& shares, std::span<const double> light) {
  const std::size_t size = stored.size(), rows = light.size(), columns = size / rows;
  Restored result{std::vector<std::uint8_t>(size), std::vector<std::uint8_t>(size), std::vector<float>(size)};
  restore_picture<std::uint8_t>(
      dense_view(stored.data(), 1, rows, columns), shares, {light, 1, 8}, tables_of_bytes(),
      {dense_view(result.picture.data(), 1, rows, columns), dense_view(result.marks.data(), 1, rows, columns),
       dense_view(result.share.data(), 1, rows, columns)});
  return result;
}

}  // namespace

TEST_CASE("columns are averaged without saturated pixels") {
  const std::vector<std::uint8_t> stored{10, 20, 255, 30, 255, 255, 0, 2, 4, 6, 8, 10};
  const Blocks merged = merge_columns<std::uint8_t>(dense_view(stored.data(), 1, 2, 6), 4, tables_of_bytes());
  CHECK(merged.light == std::vector<double>{20, 0, 3, 9});
  CHECK(merged.variance == std::vector<double>{1.0 / 3, inf, 0.25, 0.5});
}

TEST_CASE("a pixel of known share is restored, a saturated one stays, a dark one is marked") {
  const std::vector<std::uint8_t> stored{100, 255, 100, 10, 10, 10};
  const std::vector<double> share{1, 1, 0.5, 1, 1, 0.5}, rows{2, 0.1};
  const Restored done = restored(stored, {share, 1, 1}, rows);
  CHECK(done.picture == std::vector<std::uint8_t>{50, 255, 67, 80, 80, 18});
  CHECK(done.marks == std::vector<std::uint8_t>{0, 1, 0, 2, 2, 0});
}

TEST_CASE("highlights that would burn stay below saturated pixels") {
  const std::vector<std::uint8_t> stored{200, 249, 250};
  const std::vector<double> share{1, 1, 1}, rows{0.5};
  const Restored done = restored(stored, {share, 1, 1}, rows);
  CHECK(done.picture == std::vector<std::uint8_t>{249, 249, 250});
}

TEST_CASE("one share for all pixels restores as shares by pixel do") {
  std::vector<std::uint8_t> stored(3 * 300);
  for (std::size_t i = 0; i < stored.size(); ++i) stored[i] = static_cast<std::uint8_t>(i * 7 % 256);
  const std::vector<double> rows{1.4, 0.1, 0.7};
  std::vector<double> nearly(stored.size(), 0.8);
  nearly.front() = 0.8 + 1e-12;
  const Restored one = restored(stored, {{0.8}, 3, 300}, rows), each = restored(stored, {nearly, 1, 1}, rows);
  CHECK(one.picture == each.picture);
  CHECK(one.marks == each.marks);
  CHECK(one.share == each.share);
}

TEST_CASE(
    "a restored value is that whose bounds contain its light, where they lie far apart and where many are close") {
  StoredTable table;  // as of a curved tone curve with 4096 values
  for (std::size_t k = 0; k < 4096; ++k) {
    const auto light = [](double value) { return value * value * value * 1e-9; };
    table.light.push_back(light(static_cast<double>(k)));
    table.variance.push_back(k < 4000 ? 1 : inf);
    if (k > 0) table.bounds.push_back(light(static_cast<double>(k) - 0.5));
  }
  std::vector<std::uint16_t> stored(8 * 4096), picture(stored.size());
  for (std::size_t i = 0; i < stored.size(); ++i) stored[i] = static_cast<std::uint16_t>(i % 4096);
  std::vector<double> share(stored.size()), rows{1.9, 0.05, 0.7, 1.2, 0.999, 1.001, 1, 0.4};
  for (std::size_t i = 0; i < share.size(); ++i) share[i] = static_cast<double>(i * 37 % 101) / 101;
  restore_picture<std::uint16_t>(dense_view(std::as_const(stored).data(), 1, 8, 4096), {share, 1, 1}, {rows, 1.1, 8},
                                 table, {dense_view(picture.data(), 1, 8, 4096)});
  for (std::size_t i = 0; i < stored.size(); ++i) {
    const double gain = std::min((1 + share[i] * 0.1) / (1 + share[i] * (rows[i / 4096] - 1)), 8.0);
    const auto after = std::ranges::upper_bound(table.bounds, table.light[stored[i]] * gain) - table.bounds.begin();
    CHECK(picture[i] == (stored[i] < 4000 ? std::min<std::ptrdiff_t>(after, 3999) : stored[i]));
  }
}

TEST_CASE("shares of blocks are interpolated between their centres") {
  const std::vector<std::uint8_t> stored(8, 100);
  const std::vector<double> share{0, 1}, rows{1};
  const Restored done = restored(stored, {share, 1, 4}, rows);
  CHECK(done.share == std::vector<float>{0, 0, 0.125F, 0.375F, 0.625F, 0.875F, 1, 1});
}

TEST_CASE("stored values beyond the table are rejected") {
  const StoredTable table{{0, 1}, {1, 1}, {0.5}};
  const std::vector<std::uint8_t> stored{2};
  CHECK_THROWS_AS(merge_columns<std::uint8_t>(dense_view(stored.data(), 1, 1, 1), 1, table), std::invalid_argument);
}

TEST_CASE("the slope of the light above a toe is its derivative") {
  for (const double toe : {0.0, 0.01, 0.5})
    for (const double stored : {0.5, 20.0, 200.0}) {
      const double change = lifted_light(stored * (1 + 1e-6), toe, 255) - lifted_light(stored, toe, 255);
      CHECK(slope_of_lifted(stored, toe, 255) == doctest::Approx(change / (1e-6 * stored)).epsilon(1e-4));
    }
}

}  // namespace ocisac
