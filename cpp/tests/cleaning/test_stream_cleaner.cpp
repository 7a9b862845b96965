#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "ocisac/cleaning/stream_cleaner.hpp"

namespace ocisac {

namespace {

constexpr std::size_t rows = 240, columns = 160;
constexpr double period = 37.3, step = 0.37;  // rows per cycle; cycles from frame to frame

Camera camera() {
  Camera result;
  result.row_time = 1e-5;
  return result;
}

// Bytes of boxes that move `moved` columns, under a tone of share 0.8 with the phase of a frame.
struct Frame {
  std::vector<std::uint8_t> stored;
  std::vector<double> clean;

  explicit Frame(std::size_t frame, std::size_t moved = 0, std::size_t scene = 0) {
    for (std::size_t n = 0; n < rows; ++n)
      for (std::size_t k = 0; k < columns; ++k) {
        const std::size_t x = k + moved;
        const double box = 60 + 25 * static_cast<double>((n / 41 + x / 23 + (n / 17 + scene) * (x / 31) + scene) % 4);
        const double light = 0.9 * std::cos(2 * std::numbers::pi *
                                            (static_cast<double>(n) / period + step * static_cast<double>(frame)));
        const double noise = static_cast<double>((n * 7919 + k * 104729 + frame * 31) % 5) / 4 - 0.5;
        clean.push_back(box);
        stored.push_back(static_cast<std::uint8_t>(std::lround(box * (1 + 0.8 * light) / 1.72 + noise)));
      }
  }
  std::vector<AnyFramesView> colours() const { return {dense_view(stored.data(), 1, rows, columns)}; }
};

struct Restored {
  std::vector<std::uint8_t> picture = std::vector<std::uint8_t>(rows * columns), marks = picture;

  explicit Restored(const StreamCleaner::Frame& found) {
    const ModelledLight& light = found.light.lights.front().lights.front();
    found.stored.restore<std::uint8_t>(
        0, 0, found.light.shares.front(), {light.light, 1.0, 8.0},
        {dense_view(picture.data(), 1, rows, columns), dense_view(marks.data(), 1, rows, columns)});
  }
};

// Relative deviation of the restored picture from the clean one, in the middle of the frame.
double error_of(const StreamCleaner::Frame& found, const Frame& frame) {
  const Restored done(found);
  double error = 0, count = 0;
  for (std::size_t n = 20; n + 20 < rows; ++n)
    for (std::size_t k = 20; k + 20 < columns; ++k) {
      if (done.marks[n * columns + k] != 0) continue;
      error += std::abs(done.picture[n * columns + k] * 1.72 / frame.clean[n * columns + k] - 1);
      count += 1;
    }
  return error / count;
}

}  // namespace

TEST_CASE("the frames of a moving picture are cleaned, and a tone's frequency stays") {
  StreamCleaner cleaner(camera());
  for (std::size_t k = 0; k < 10; ++k) {
    const Frame frame(k, 2 * k);
    const StreamCleaner::Frame found = cleaner.push(frame.colours());
    CHECK(found.light.unchanged.empty());
    CHECK(found.light.lights.front().lights.front().frequency == doctest::Approx(1 / period).epsilon(0.01));
    CHECK(error_of(found, frame) < 0.05);
  }
}

TEST_CASE("another scene, another size, and forgetting begin again, and answers are the same twice") {
  StreamCleaner cleaner(camera()), again(camera());
  const Frame first(0), other(1, 0, 2);
  for (StreamCleaner* each : {&cleaner, &again}) {
    each->push(first.colours());
    CHECK(error_of(each->push(other.colours()), other) < 0.05);
  }
  const std::vector<std::uint8_t> half(rows / 2 * columns, 50);
  CHECK_FALSE(cleaner.push({dense_view(half.data(), 1, rows / 2, columns)}).light.lights.empty());
  cleaner.forget();
  again.forget();
  const auto one = cleaner.push(first.colours()), two = again.push(first.colours());
  CHECK(one.light.shares.front().share == two.light.shares.front().share);
  CHECK(one.light.verdicts.front().gain == two.light.verdicts.front().gain);
}

TEST_CASE("black frames among others stay, and the next ones are cleaned") {
  StreamCleaner cleaner(camera());
  const std::vector<std::uint8_t> black(rows * columns);
  for (std::size_t k = 0; k < 6; ++k) {
    const bool dark = k == 0 || k == 3 || k == 4;
    const Frame frame(k);
    const auto found =
        cleaner.push(dark ? std::vector<AnyFramesView>{dense_view(black.data(), 1, rows, columns)} : frame.colours());
    CHECK(found.light.unchanged == (dark ? "no bands: all rows have the same light" : ""));
    if (!dark) CHECK(error_of(found, frame) < 0.05);
  }
}

TEST_CASE("frames and options without meaning are refused") {
  CHECK_THROWS_AS(StreamCleaner(camera(), {.model = RowModel::given, .noise = {}, .toe = {}}), std::invalid_argument);
  CHECK_THROWS_AS(StreamCleaner(camera(), {.model = RowModel::tone, .noise = 0, .toe = {}}), std::invalid_argument);
  CHECK_THROWS_AS(StreamCleaner(camera(), {.model = RowModel::tone, .noise = {}, .toe = 2}), std::invalid_argument);
  StreamCleaner cleaner(camera());
  const Frame frame(0);
  CHECK_THROWS_AS(cleaner.push({}), std::invalid_argument);
  CHECK_THROWS_AS(cleaner.push(frame.colours(), std::numeric_limits<double>::infinity()), std::invalid_argument);
  CHECK_THROWS_AS(cleaner.push({dense_view(frame.stored.data(), 1, 4, columns)}), std::invalid_argument);
  CHECK_THROWS_AS(cleaner.push({dense_view(frame.stored.data(), 2, rows / 2, columns)}), std::invalid_argument);
}

}  // namespace ocisac
