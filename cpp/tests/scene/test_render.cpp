#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "ocisac/scene/render.hpp"

using ocisac::dense_view;
using ocisac::render_parts;
using ocisac::SceneBase;
using ocisac::ScenePart;

namespace {

constexpr std::size_t rows = 70;
constexpr std::size_t columns = 33;

// Two overlapping parts: one of runs, one with gains and a table of three phases.
struct Parts {
  std::vector<float> signal, table, gains;
  std::vector<std::uint16_t> phase;
  std::vector<std::uint32_t> spans;
  ScenePart flat, patterned;

  Parts() {
    for (std::size_t y = 0; y < 60; ++y) {
      signal.push_back(static_cast<float>(y));
      spans.insert(spans.end(), {static_cast<std::uint32_t>(y % 5), static_cast<std::uint32_t>(10 + y % 3)});
    }
    for (std::size_t i = 0; i < std::size_t{20} * 3; ++i) table.push_back(static_cast<float>(i % 7));
    for (std::size_t i = 0; i < std::size_t{20} * 9; ++i) {
      gains.push_back(static_cast<float>(i % 4));
      phase.push_back(static_cast<std::uint16_t>(i % 3));
    }
    flat = {{4, 10, 12, 60}, 2.0F, nullptr, spans.data(), 1, nullptr, signal.data()};
    patterned = {{0, 50, 9, 20}, 1.0F, gains.data(), nullptr, 3, phase.data(), table.data()};
  }

  float expected(std::size_t y, std::size_t x, float base) const {
    float value = base;
    if (y >= 10 && x >= 4 + spans[2 * (y - 10)] && x < 4 + spans[2 * (y - 10) + 1]) value += 2 * signal[y - 10];
    if (y >= 50 && x < 9) {
      const std::size_t i = (y - 50) * 9 + x;
      value += gains[i] * table[(y - 50) * 3 + phase[i]];
    }
    return value;
  }
};

template <class T>
std::vector<T> rendered(const std::vector<ScenePart>& parts, const SceneBase& base, float white, int threads) {
  std::vector<T> frame(rows * columns, T{99});
  render_parts<T>(parts, base, white, threads, dense_view(frame.data(), 1, rows, columns));
  return frame;
}

}  // namespace

TEST_CASE("parts add up on a level and on an image, whatever the threads") {
  const Parts made;
  const std::vector<ScenePart> parts{made.flat, made.patterned};
  const std::vector<float> image(rows * columns, 3.25F);
  const auto on_level = rendered<float>(parts, {3.25F, nullptr}, 0, 1);
  const auto on_image = rendered<float>(parts, {0, image.data()}, 0, 1);
  for (std::size_t i = 0; i < on_level.size(); ++i) {
    REQUIRE(on_level[i] == made.expected(i / columns, i % columns, 3.25F));
    REQUIRE(on_image[i] == on_level[i]);
  }
  CHECK(rendered<float>(parts, {3.25F, nullptr}, 0, 3) == on_level);
}

TEST_CASE("whole numbers are rounded and clipped at white") {
  const Parts made;
  const auto bytes = rendered<std::uint8_t>({made.flat}, {0.5F, nullptr}, 100, 1);
  CHECK(bytes[0] == 1);                   // 0.5
  CHECK(bytes[10 * columns + 4] == 1);    // 0.5 + 2·0
  CHECK(bytes[11 * columns + 5] == 3);    // 0.5 + 2·1
  CHECK(bytes[69 * columns + 9] == 100);  // 0.5 + 2·59 is above white
  CHECK(rendered<std::uint16_t>({made.flat}, {-5, nullptr}, 1000, 1)[0] == 0);
}

TEST_CASE("parts that leave the frame or their table are refused") {
  const Parts made;
  CHECK_NOTHROW(check(made.patterned, rows, columns));
  CHECK_THROWS_AS(check(made.flat, 69, columns), std::invalid_argument);
  CHECK_THROWS_AS(check(made.flat, rows, 15), std::invalid_argument);
  ScenePart part = made.patterned;
  part.phases = 2;
  CHECK_THROWS_AS(check(part, rows, columns), std::invalid_argument);
  part = made.flat;
  part.region.width = 11;
  CHECK_THROWS_AS(check(part, rows, columns), std::invalid_argument);
}
