#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "ocisac/columns/column_combination.hpp"
#include "ocisac/receiver/receiver.hpp"

namespace {

constexpr std::size_t kRows = 480, kColumns = 160, kWidth = 30;
constexpr double kRowTime = 2e-5;

// A light of 800 Hz, swing 60 DN about 80, from column `left` to `left` + kWidth of a dim, noisy picture.
std::vector<std::uint8_t> tone_picture(std::size_t left, double start, std::mt19937& random, bool on = true) {
  std::normal_distribution<double> noise(20, 1);
  std::vector<std::uint8_t> picture(kRows * kColumns);
  for (std::size_t row = 0; row < kRows; ++row) {
    const double time = start + static_cast<double>(row) * kRowTime;
    const double light = on ? 80 + 60 * std::cos(2 * std::numbers::pi * std::fmod(800 * time, 1.0)) : 0;
    for (std::size_t column = 0; column < kColumns; ++column)
      picture[row * kColumns + column] = static_cast<std::uint8_t>(
          std::lround(std::max(0.0, noise(random) + (column >= left && column < left + kWidth ? light : 0))));
  }
  return picture;
}

ocisac::AnyFramesView view_of(const std::vector<std::uint8_t>& picture) {
  return ocisac::dense_view(picture.data(), 1, kRows, kColumns);
}

ocisac::ReceiverOptions gain_only() {
  ocisac::ReceiverOptions options;
  options.light.data.reset();
  options.light.gain.emplace();
  return options;
}

ocisac::Camera camera() { return {.row_time = kRowTime, .exposure = 1e-5, .frame_time = {}, .tone_curve = {}}; }

}  // namespace

TEST_CASE("a light is found once, its gain told in every frame") {
  std::mt19937 random(3);
  auto options = gain_only();
  options.light.gain->background = 20;
  ocisac::Receiver receiver(camera(), options);
  for (int frame = 0; frame < 5; ++frame) {
    const auto picture = tone_picture(70, 0.0331 * frame, random);
    const auto view = view_of(picture);
    const auto result = receiver.push({&view, 1}, frame).front();
    CHECK(result.searched == (frame == 0));
    CHECK(result.region.x <= 70);
    CHECK(result.region.x + result.region.width >= 70 + kWidth);
    CHECK(result.region.width <= 80);
    CHECK(result.region.height >= kRows - 32);
    REQUIRE(result.gain);
    CHECK(!result.received);
    CHECK(result.gain->frequency == doctest::Approx(800).epsilon(2e-3));
    CHECK(result.gain->gain == doctest::Approx(60.0 / 80).epsilon(0.02));  // modulation depth
    REQUIRE(result.suggestion);
    CHECK(result.suggestion->exposure == doctest::Approx(1.0 / 1600).epsilon(2e-3));
  }
}

TEST_CASE("the columns go along with a light that moves") {
  std::mt19937 random(5);
  ocisac::ColumnFollower follower({});
  std::size_t first = 10;
  constexpr std::size_t kCount = 50;
  for (std::size_t step = 0; step <= 90; ++step) {
    const auto picture = tone_picture(20 + step, 0.0331 * static_cast<double>(step), random);
    const auto column = follower.combine(ocisac::part_of(view_of(picture), {first, 0, kCount, kRows}));
    const auto [least, most] = std::ranges::minmax(column.signal);
    CAPTURE(step);
    CHECK(most - least > 100);  // of 120
    CHECK(most - least < 126);
    double sum = 0, moment = 0;
    for (std::size_t k = 0; k < kCount; ++k) sum += column.weights[k], moment += column.weights[k] * k;
    CHECK(sum == doctest::Approx(1));
    const auto off = static_cast<std::ptrdiff_t>(0.5 * (moment / sum - 24.5));
    first = std::min(first + static_cast<std::size_t>(std::max<std::ptrdiff_t>(off, 0)), kColumns - kCount);
    follower.move(std::max<std::ptrdiff_t>(off, 0));
  }
  CHECK(first > 90);
}

TEST_CASE("weights that follow are those that are found anew") {
  std::mt19937 random(6);
  ocisac::ColumnFollower follower({});
  for (int frame = 0; frame < 4; ++frame) {
    const auto picture = tone_picture(20, 0.0331 * frame, random);
    const auto part = ocisac::part_of(view_of(picture), {0, 0, 70, kRows});
    const auto followed = follower.combine(part), combined = ocisac::combine_columns(part, 0, {});
    CHECK(followed.quality == doctest::Approx(combined.quality).epsilon(0.02));
    CHECK(followed.noise == doctest::Approx(combined.noise).epsilon(0.02));
    for (std::size_t row = 0; row < kRows; ++row) CHECK(std::abs(followed.signal[row] - combined.signal[row]) < 1);
  }
}

TEST_CASE("a light that moves along the columns from row to row is followed upright") {
  std::mt19937 random(8);
  for (const double turn : {0.0, 2e-4}) {  // columns per row and frame, by which the lamp turns
    ocisac::ColumnFollower follower({});
    for (int frame = 0; frame < 30; ++frame) {
      const double slope = -0.1 + turn * frame;
      const auto upright = tone_picture(65, 0.0331 * frame, random);
      std::vector<std::uint8_t> tilted(upright.size());
      for (std::size_t row = 0; row < kRows; ++row)
        for (std::size_t column = 0; column < kColumns; ++column) {
          const long from = static_cast<long>(column) - std::lround(slope * (static_cast<double>(row) - kRows / 2.0));
          tilted[row * kColumns + column] =
              upright[row * kColumns + static_cast<std::size_t>(std::clamp(from, 0L, 159L))];
        }
      const auto followed = follower.combine(view_of(tilted));
      const auto expected = ocisac::combine_columns(view_of(upright), 0, {});
      CAPTURE(frame);
      CHECK(followed.slope == doctest::Approx(slope).epsilon(0.05));
      double squares = 0;
      for (std::size_t row = 0; row < kRows; ++row) squares += std::pow(followed.signal[row] - expected.signal[row], 2);
      CHECK(std::sqrt(squares / kRows) < 2);  // of a swing of 120
      CHECK(std::abs(std::accumulate(followed.weights.begin(), followed.weights.end(), -1.0)) < 1e-9);
    }
    follower.forget();
    CHECK(follower.combine(view_of(tone_picture(65, 0, random))).slope == 0);
  }
}

TEST_CASE("a light that went is searched again, ever more seldom, until it is back") {
  std::mt19937 random(7);
  auto options = gain_only();
  options.light.gain->frequency = 800;
  ocisac::Receiver receiver(camera(), options);
  std::vector<int> searches;
  for (int frame = 0; frame < 60; ++frame) {
    const bool on = frame < 3 || frame > 40;
    const auto picture = tone_picture(frame < 3 ? 10 : 110, 0.0331 * frame, random, on);
    const auto view = view_of(picture);
    const auto result = receiver.push({&view, 1}, frame).front();
    if (result.searched) searches.push_back(frame);
    if (frame == 59) {
      CHECK(result.region.x > 80);
      CHECK(result.gain->gain > 0.3);
    }
  }
  REQUIRE(searches.size() >= 3);
  CHECK(searches.size() <= 5);
  CHECK(searches[0] == 0);
  CHECK(searches[1] == 11);
  for (std::size_t k = 2; k < searches.size(); ++k) CHECK(searches[k] - searches[k - 1] >= 8);
}

TEST_CASE("a region that is told is neither searched nor left") {
  std::mt19937 random(9);
  auto options = gain_only();
  options.regions = {{65, 10, 40, 400}};
  ocisac::Receiver receiver(camera(), options);
  const auto picture = tone_picture(70, 0, random);
  const auto view = view_of(picture);
  CHECK(receiver.push({&view, 1}, 0).front().region == options.regions[0]);
  options.regions[0].width = kColumns;
  ocisac::Receiver beyond(camera(), options);
  CHECK_THROWS_AS(beyond.push({&view, 1}, 0), std::invalid_argument);
  for (const ocisac::Region& wraps : {ocisac::Region{SIZE_MAX, 0, 2, 400}, ocisac::Region{65, SIZE_MAX, 40, 2}}) {
    options.regions = {wraps};
    ocisac::Receiver wrapped(camera(), options);
    CHECK_THROWS_AS(wrapped.push({&view, 1}, 0), std::invalid_argument);
  }
  options.light.gain->frequency = -1;
  CHECK_THROWS_AS(ocisac::Receiver(camera(), options), std::invalid_argument);
}
