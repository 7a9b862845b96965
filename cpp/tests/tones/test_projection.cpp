#include <doctest/doctest.h>

#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

#include "../kernels/plain_projection.hpp"
#include "ocisac/tones/projection.hpp"

namespace {

std::mt19937 random_source(7);

std::vector<double> random_weights(std::size_t count) {
  std::vector<double> weights(count);
  for (double& w : weights) w = std::normal_distribution<double>()(random_source);
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

}  // namespace

TEST_CASE("the brightest frame does not overflow") {
  for (const int row_group : {1, 2, 4, 8}) {
    const std::size_t rows = 4096;
    std::vector<std::uint8_t> pixels(rows * 20, 255);
    const std::size_t groups = rows / static_cast<std::size_t>(row_group);
    const std::vector<double> ones(groups, 1.0);
    const ocisac::RowWeights weights(ones, 1, rows, row_group, 1);
    CHECK(weights.folds());
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
        std::vector<double> values(2 * groups, 1.0);  // output 0; output 1: every limb at its maximum
        for (std::size_t g = 1; g < groups; ++g) values[groups + g] = 1.0 / 3 + 1e-4 * static_cast<double>(g % 7);
        const ocisac::RowWeights weights(values, 2, rows, row_group, limbs);
        std::vector<std::uint8_t> pixels(rows * 40, 255);
        const auto frames = ocisac::as_const(ocisac::dense_view(pixels.data(), 1, rows, 40));
        CHECK(deviation(ocisac::project(frames, 0, 0, 40, weights), project_plainly(frames, 0, 0, 40, weights)) <
              1e-12);
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

TEST_CASE("weights that are symmetric but for rounding fold exactly, others do not") {
  std::vector<double> weights(3 * 100);
  for (std::size_t g = 0; g < 100; ++g) {
    const double u = (static_cast<double>(g) - 49.5) / 100;
    weights[g] = std::sin(20 * u);
    weights[100 + g] = std::cos(20 * u) * (1 + (g % 2 == 0 ? 1e-15 : 0));
    weights[200 + g] = u;
  }
  const ocisac::RowWeights folded(weights, 3, 100, 1, 1);
  REQUIRE(folded.folds());
  CHECK(folded.even_outputs() == 1);
  CHECK(folded.output_order()[0] == 1);
  const auto used = folded.weights();
  for (std::size_t g = 0; g < 100; ++g) {
    CHECK(used[g] == -used[99 - g]);
    CHECK(used[100 + g] == used[199 - g]);
    CHECK(std::abs(used[100 + g] - weights[100 + g]) < 1e-14);
  }
  weights[7] += 1e-9;
  CHECK(!ocisac::RowWeights(weights, 3, 100, 1, 1).folds());
}

TEST_CASE("unknown targets are refused by name") {
  CHECK_THROWS_WITH_AS(ocisac::force_simd_target("MMX"), doctest::Contains("target: got MMX, allowed: "),
                       std::invalid_argument);
}
