#include <doctest/doctest.h>

#include <algorithm>
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

namespace {

// Bytes of boxes without a period under a tone of 1.2 cycles.
struct SlowFrame {
  std::vector<std::uint8_t> stored;
  std::vector<double> clean;

  explicit SlowFrame(int number) {
    for (std::size_t n = 0; n < rows; ++n)
      for (std::size_t k = 0; k < columns; ++k) {
        const double angle = 2 * std::numbers::pi * (1.2 * static_cast<double>(n) / rows + 0.3 * number);
        const auto noise = static_cast<double>((n * 7919 + k * 104729 + static_cast<std::size_t>(number) * 31) % 5);
        const auto place = static_cast<std::uint32_t>(n / 29 * 100 + k / 8);
        clean.push_back(60 + 10 * static_cast<double>((place * 2654435761U >> 13U) % 6));
        stored.push_back(static_cast<std::uint8_t>(
            std::lround(clean.back() * (1 + 0.15 * std::cos(angle)) / 1.3 + noise / 4 - 0.5)));
      }
  }

  // Root of the mean square of a picture's deviation from the clean one, after the best gain.
  double error_of(const std::vector<std::uint8_t>& picture) const {
    double both = 0, own = 0, all = 0;
    for (std::size_t i = 0; i < clean.size(); ++i) {
      both += picture[i] * clean[i];
      own += static_cast<double>(picture[i]) * picture[i];
      all += clean[i] * clean[i];
    }
    return std::sqrt(std::max(0.0, all - both * both / own) / static_cast<double>(clean.size()));
  }

  // After cleaning, over that before; 1 for a frame that is left.
  double error_left(const StreamCleaner::Frame& found) const {
    if (!found.light.unchanged.empty()) return 1;
    return error_of(Restored(found).picture) / error_of(stored);
  }
};

}  // namespace

TEST_CASE("time stamps tell the missing frames, in which the phase of a slow tone advances") {
  StreamCleaner stamped(camera()), counted(camera());
  double left = 0, left_counted = 0;
  for (const int number : {0, 1, 2, 3, 4, 6, 7, 10, 11, 13}) {
    const SlowFrame frame(number);
    const std::vector<AnyFramesView> colours{dense_view(frame.stored.data(), 1, rows, columns)};
    const double own = frame.error_left(stamped.push(colours, 5 + number / 30.0));
    const double other = frame.error_left(counted.push(colours));
    if (number < 6) continue;
    CHECK(own < 0.5);
    left += own;
    left_counted += other;
  }
  CHECK(left < 0.6 * left_counted);
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
