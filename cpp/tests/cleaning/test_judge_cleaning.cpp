#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "cleaning/cleaned_picture.hpp"
#include "ocisac/cleaning/judge_cleaning.hpp"

namespace ocisac {

namespace {

constexpr std::size_t rows = 120, columns = 90;

// A light of depth 0.8 on all columns of a ramp of texture, tilted by `tilt` rows a column.
struct Tilted {
  std::vector<double> light = std::vector<double>(rows * columns), row_light = std::vector<double>(rows);
  std::vector<double> variance = std::vector<double>(rows * columns, 0.1), share{0.8};

  explicit Tilted(double tilt) {
    for (std::size_t n = 0; n < rows; ++n) {
      row_light[n] = of_row(static_cast<double>(n));
      for (std::size_t k = 0; k < columns; ++k) {
        const double change = of_row(static_cast<double>(n) + tilt * static_cast<double>(k)) - 1;
        light[n * columns + k] = (50 + static_cast<double>(k)) * (1 + 0.8 * change);
      }
    }
  }

  static double of_row(double row) { return 1 + std::cos(2 * std::numbers::pi * row / 15); }

  CleaningVerdict judged() const {
    return judge_cleaning({light, variance, 1, rows, columns}, row_light,
                          {{share.begin(), share.end()}, rows, columns});
  }
};

}  // namespace

TEST_CASE("a cleaned picture has no light left and no objection") {
  const CleaningVerdict verdict = Tilted(0).judged();
  CHECK(verdict.light_left < 1e-9);
  CHECK(verdict.gain > 1);
  CHECK(verdict.level > 0.9);  // all but that brighter columns have larger bands
  CHECK(objection_to(verdict).empty());
}

TEST_CASE("tilted bands are objected to") {
  const CleaningVerdict verdict = Tilted(0.8).judged();
  CHECK(verdict.level < 0.25);
  CHECK_FALSE(objection_to(verdict).empty());
}

TEST_CASE("each objection has its bound") {
  CHECK(objection_to({}) == "no bands: all rows have the same light");
  CHECK(objection_to({.light_left = 1.01, .gain = 1, .energy = 1}) == "the bands would be stronger than before");
  CHECK(objection_to({.light_left = 0.2, .gain = -0.01, .energy = 1}) ==
        "no light of the rows: they would differ as much as before");
  CHECK(objection_to({.light_left = 0.3, .gain = 1, .level = 0.2, .energy = 1}) == "bands that tilt or curve");
  CHECK(objection_to({.light_left = 0.3, .gain = 1, .energy = 1}) ==
        "rows of the picture, or of light that is not even");
  CHECK(objection_to({.light_left = 0.2, .gain = 0.01, .level = 0.2, .energy = 1}).empty());
}

TEST_CASE("the mean of verdicts is weighted by the swing, and plain without one") {
  const std::vector<CleaningVerdict> some{{.gain = 1, .energy = 3}, {.gain = 5, .energy = 1}};
  CHECK(mean_verdict(some).gain == doctest::Approx(2));
  const std::vector<CleaningVerdict> dark{{.gain = 1}, {.gain = 5}};
  CHECK(mean_verdict(dark).gain == doctest::Approx(3));
  CHECK(mean_verdict(dark).level == doctest::Approx(1));
}

TEST_CASE("misfits that hardly fit into a number are finite") {
  const std::vector<double> light{1e-150, 1e-150, 1e150, 1e150}, row_light{1, 1}, share{0};
  const std::vector<double> variance{1, 1, 1e-300, 1e200};
  const double misfit = row_misfit({light, variance, 1, 2, 2}, row_light, share, 1);
  CHECK(std::isfinite(misfit));
  CHECK(misfit > std::log(0.05 * 0.05));
}

}  // namespace ocisac
