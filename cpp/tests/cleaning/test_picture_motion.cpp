#include <doctest/doctest.h>

#include <cmath>
#include <stdexcept>
#include <vector>

#include "cleaning/picture_motion.hpp"

namespace ocisac {

namespace {

constexpr std::size_t rows = 60, columns = 80;

// A texture without a period in the picture, `down` and `right` pixels further than at first.
std::vector<double> texture(double down, double right) {
  std::vector<double> values;
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t k = 0; k < columns; ++k) {
      const double y = static_cast<double>(n) - down, x = static_cast<double>(k) - right;
      values.push_back(0.3 * std::sin(0.31 * x + 0.002 * x * y) + 0.3 * std::cos(0.23 * y + 0.004 * y * y));
    }
  return values;
}

}  // namespace

TEST_CASE("a displacement below a pixel is found, and the moved picture is the later one") {
  const std::vector<double> before = texture(0, 0), after = texture(1.4, -2.3);
  const PictureChange change = picture_change({rows, columns, before, {}}, {rows, columns, after, {}});
  const std::size_t middle = rows / 2 * columns + columns / 2;
  CHECK(change.down == doctest::Approx(1.4).epsilon(0.1));
  CHECK(change.right == doctest::Approx(-2.3).epsilon(0.1));
  CHECK(moved_picture(before, columns, change.down, change.right)[middle] ==
        doctest::Approx(after[middle]).epsilon(0.1));
  CHECK(change.is_new[middle] == 0);
  CHECK(change.is_new[0] == 1);  // from above the picture
}

TEST_CASE("narrow pictures stand still, and shapes must agree") {
  const std::vector<double> line(30, 1.0), other(30, 2.0);
  CHECK(picture_change({3, 10, line, {}}, {3, 10, other, {}}).down == 0);
  CHECK_THROWS_AS(picture_change({3, 10, line, {}}, {10, 3, other, {}}), std::invalid_argument);
}

}  // namespace ocisac
