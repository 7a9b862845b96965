#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

#include "ocisac/tones/projection.hpp"

namespace {

std::mt19937 random_source(7);

template <class T>
T random_sample() {
  if constexpr (std::is_integral_v<T>) return static_cast<T>(random_source() >> (32 - 8 * sizeof(T)));
  return static_cast<T>(std::normal_distribution<double>(100, 30)(random_source));
}

std::vector<double> random_weights(std::size_t count) {
  std::vector<double> weights(count);
  for (double& w : weights) w = std::normal_distribution<double>()(random_source);
  return weights;
}

// Every other output symmetric about the middle, the others antisymmetric.
std::vector<double> symmetric_weights(std::size_t outputs, std::size_t groups) {
  auto weights = random_weights(outputs * groups);
  for (std::size_t o = 0; o < outputs; ++o)
    for (std::size_t g = 0; g < groups / 2; ++g)
      weights[(o + 1) * groups - 1 - g] = (o % 2 == 0 ? 1 : -1) * weights[o * groups + g];
  return weights;
}

// Largest deviation of the kernel from the plain loop, over the largest magnitude of the output.
double deviation(const ocisac::Projection& got, const ocisac::Projection& want) {
  double worst = 0;
  double largest = 1e-300;
  for (const double v : want.sums) largest = std::max(largest, std::abs(v));
  for (std::size_t i = 0; i < want.sums.size(); ++i)
    worst = std::max(worst, std::abs(got.sums[i] - want.sums[i]) / largest);
  for (std::size_t i = 0; i < want.squares.size(); ++i)
    worst = std::max(worst, std::abs(got.squares[i] / want.squares[i] - 1));
  for (std::size_t i = 0; i < want.totals.size(); ++i)
    worst = std::max(worst, std::abs(got.totals[i] - want.totals[i]) / (1 + std::abs(want.totals[i])));
  CHECK(got.maximum == want.maximum);
  return worst;
}

// A frame inside a larger allocation whose margins hold NaN (or 255), at an offset that no vector is aligned to. An
// even number of columns: rows are a whole number of vectors apart.
template <class T>
void check_against_plain_loop(std::size_t rows, std::size_t columns, std::size_t outputs, int row_group, int limbs,
                              std::size_t column_step, bool upside_down, bool symmetric = false) {
  const std::size_t margin = 3;
  const std::size_t needed = columns * column_step + 2 * margin;
  const std::size_t width = columns % 2 == 0 ? (needed + 63) / 64 * 64 : needed;
  const T filler = std::is_integral_v<T> ? std::numeric_limits<T>::max() : std::numeric_limits<T>::quiet_NaN();
  std::vector<T> memory(rows * width + 1, filler);
  ocisac::FramesView<T> view{memory.data() + 1 + margin,
                             1,
                             rows,
                             columns,
                             0,
                             static_cast<std::ptrdiff_t>(width),
                             static_cast<std::ptrdiff_t>(column_step)};
  for (std::size_t r = 0; r < rows; ++r)
    for (std::size_t c = 0; c < columns; ++c) view(0, r, c) = random_sample<T>();
  if (upside_down) {
    view.data = view.at(0, rows - 1, 0);
    view.row_stride = -view.row_stride;
  }
  const std::size_t groups = rows / static_cast<std::size_t>(row_group);
  const ocisac::RowWeights weights(symmetric ? symmetric_weights(outputs, groups) : random_weights(outputs * groups),
                                   outputs, rows, row_group, limbs);
  if (groups > 4) CHECK(weights.folded_pairs().empty() == !(symmetric && groups % 2 == 0));
  const auto frames = ocisac::as_const(view);
  const auto got = ocisac::project(frames, 0, 0, columns, weights);
  CHECK(deviation(got, ocisac::project_plainly(frames, 0, 0, columns, weights)) < 1e-12);
  if (columns < 4) return;
  const auto part = ocisac::project(frames, 0, 3, columns - 3, weights);  // bit by bit the same columns
  for (std::size_t o = 0; o < outputs; ++o)
    for (std::size_t c = 3; c < columns; ++c)
      REQUIRE(part.sums[o * (columns - 3) + c - 3] == got.sums[o * columns + c]);
}

}  // namespace

TEST_CASE("every SIMD target agrees with the plain loop at awkward sizes") {
  const auto targets = ocisac::simd_targets();
  REQUIRE(!targets.empty());
  for (const auto& target : targets) {
    CAPTURE(target);
    ocisac::force_simd_target(target);
    CHECK(ocisac::simd_target() == target);  // the code that ran says so itself
    for (const std::size_t columns : {1u, 2u, 7u, 15u, 16u, 17u, 31u, 33u, 64u, 70u, 131u, 156u})
      for (const std::size_t rows : {8u, 9u, 17u, 33u, 97u})
        for (const int row_group : {1, 2, 4, 8}) {
          CAPTURE(rows);
          CAPTURE(columns);
          CAPTURE(row_group);
          const std::size_t outputs = 1 + columns % 5;
          check_against_plain_loop<std::uint8_t>(rows, columns, outputs, row_group, 1 + static_cast<int>(rows % 3), 1,
                                                 rows % 2 == 1);
          check_against_plain_loop<std::uint8_t>(rows + 1, columns, outputs, row_group, 1 + static_cast<int>(rows % 3),
                                                 1, rows % 2 == 1, true);
          check_against_plain_loop<std::uint16_t>(rows, columns, outputs, row_group, 1, 1, rows % 2 == 1);
          check_against_plain_loop<float>(rows, columns, outputs, row_group, 1, 1 + rows % 2, false);
          check_against_plain_loop<double>(rows, columns, outputs, row_group, 1, 1 + rows % 2, rows % 2 == 1);
        }
    check_against_plain_loop<std::uint8_t>(5003, 40, 4, 1, 3, 2, false);
    check_against_plain_loop<std::uint8_t>(5003, 40, 4, 4, 1, 1, true);
    check_against_plain_loop<std::uint8_t>(5004, 40, 4, 1, 2, 1, false, true);
    check_against_plain_loop<std::uint8_t>(5008, 40, 3, 8, 2, 2, true, true);
  }
  ocisac::force_simd_target("");
}

TEST_CASE("the brightest frame does not overflow") {
  for (const int row_group : {1, 2, 4, 8}) {
    const std::size_t rows = 4096;
    std::vector<std::uint8_t> pixels(rows * 20, 255);
    const std::size_t groups = rows / static_cast<std::size_t>(row_group);
    const std::vector<double> ones(groups, 1.0);
    const ocisac::RowWeights weights(ones, 1, rows, row_group, 1);
    CHECK(!weights.folded_pairs().empty());
    const auto frames = ocisac::as_const(ocisac::dense_view(pixels.data(), 1, rows, 20));
    const auto result = ocisac::project(frames, 0, 0, 20, weights);
    for (const double sum : result.sums) CHECK(sum == doctest::Approx(255.0 * rows).epsilon(1e-14));
    for (const double total : result.totals) CHECK(total == 255.0 * rows);
    for (const double square : result.squares)
      CHECK(square == doctest::Approx(255.0 * 255.0 * rows * row_group).epsilon(1e-14));
  }
}

TEST_CASE("few rows leave room for larger weights, and none for overflow") {
  for (const std::size_t rows : {40u, 257u, 1080u, 2047u, 2048u, 2049u})
    for (const int row_group : {1, 4})
      for (const int limbs : {1, 2, 3}) {
        CAPTURE(rows);
        CAPTURE(limbs);
        const std::size_t groups = rows / static_cast<std::size_t>(row_group);
        std::vector<double> values(2 * groups, 1.0);  // output 0; output 1: any limb may be as large as it can
        for (std::size_t g = 1; g < groups; ++g) values[groups + g] = 1.0 / 3 + 1e-4 * static_cast<double>(g % 7);
        const ocisac::RowWeights weights(values, 2, rows, row_group, limbs);
        std::vector<std::uint8_t> pixels(rows * 40, 255);
        const auto frames = ocisac::as_const(ocisac::dense_view(pixels.data(), 1, rows, 40));
        CHECK(deviation(ocisac::project(frames, 0, 0, 40, weights),
                        ocisac::project_plainly(frames, 0, 0, 40, weights)) < 1e-12);
        double worst = 0;
        const auto used = weights.byte_weights();
        for (std::size_t i = 0; i < values.size(); ++i) worst = std::max(worst, std::abs(used[i] - values[i]));
        if (limbs == 1) CHECK(worst < 0.6 / (rows == 40 ? 32767 : rows == 257 ? 8191 * 2 : 4095));
      }
}

TEST_CASE("limbs hold what they promise") {
  const auto weights = random_weights(500);
  double largest = 0;
  for (const double w : weights) largest = std::max(largest, std::abs(w));
  const double promised[] = {1.3e-4, 2e-8, 2e-12};
  for (int limbs = 1; limbs <= 3; ++limbs) {
    const ocisac::RowWeights rounded(weights, 1, 500, 1, limbs);
    const auto used = rounded.byte_weights();
    for (std::size_t i = 0; i < 500; ++i) CHECK(std::abs(used[i] - weights[i]) < promised[limbs - 1] * largest);
  }
}

TEST_CASE("unknown targets are refused by name") {
  CHECK_THROWS_WITH_AS(ocisac::force_simd_target("MMX"), doctest::Contains("target: got MMX, allowed: "),
                       std::invalid_argument);
}
