#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "ocisac/receiver/live_receiver.hpp"

namespace {

constexpr std::size_t kRows = 480, kColumns = 160, kWidth = 30;
constexpr double kRowTime = 2e-5;

// A light of 800 Hz, 60 DN of swing on 80, between columns `left` and `left` + kWidth of a dim, noisy picture.
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

ocisac::Camera camera() { return {.row_time = kRowTime, .exposure = 1e-5, .frame_time = {}, .tone_curve = {}}; }

}  // namespace

TEST_CASE("a light is found once, its gain told in every frame") {
  std::mt19937 random(3);
  ocisac::LiveOptions options;
  options.data = false;
  options.background = 20;
  ocisac::LiveReceiver receiver(camera(), options);
  for (int frame = 0; frame < 5; ++frame) {
    const auto picture = tone_picture(70, 0.0331 * frame, random);
    const auto& result = receiver.push(view_of(picture), frame);
    CHECK(result.searched == (frame == 0));
    CHECK(result.region.x <= 70);
    CHECK(result.region.x + result.region.width >= 70 + kWidth);
    CHECK(result.region.width <= 80);
    CHECK(result.region.height >= kRows - 32);
    REQUIRE(result.gain);
    CHECK(!result.received);
    CHECK(result.gain->frequency == doctest::Approx(800).epsilon(2e-3));
    CHECK(result.gain->gain == doctest::Approx(60.0 / 80).epsilon(0.02));  // depth of the swing
    REQUIRE(result.suggestion);
    CHECK(result.suggestion->exposure == doctest::Approx(1.0 / 1600).epsilon(2e-3));
  }
}

TEST_CASE("the columns go along with a light that moves") {
  std::mt19937 random(5);
  const ocisac::Camera still = camera();
  ocisac::ColumnFollower follower(still.tone_curve);
  auto picture = tone_picture(20, 0, random);
  follower.start(view_of(picture), 10, 50);
  for (std::size_t step = 0; step <= 90; ++step) {
    picture = tone_picture(20 + step, 0.0331 * static_cast<double>(step), random);
    const auto signal = follower.combine(view_of(picture), true);
    const auto [least, most] = std::ranges::minmax(signal);
    CAPTURE(step);
    CHECK(most - least > 100);  // of 120
    CHECK(most - least < 126);
  }
  CHECK(follower.first() > 90);
  CHECK(follower.first() + follower.count() <= kColumns);
  double sum = 0;
  for (const double weight : follower.weights()) sum += weight;
  CHECK(sum == doctest::Approx(1));
}

TEST_CASE("a light that went is searched again, ever more seldom, until it is back") {
  std::mt19937 random(7);
  ocisac::LiveOptions options;
  options.data = false;
  options.frequency = 800;
  ocisac::LiveReceiver receiver(camera(), options);
  std::vector<int> searches;
  for (int frame = 0; frame < 60; ++frame) {
    const bool on = frame < 3 || frame > 40;
    const auto picture = tone_picture(frame < 3 ? 10 : 110, 0.0331 * frame, random, on);
    const auto& result = receiver.push(view_of(picture), frame);
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
  ocisac::LiveOptions options;
  options.data = false;
  options.region = ocisac::Region{65, 10, 40, 400};
  ocisac::LiveReceiver receiver(camera(), options);
  const auto picture = tone_picture(70, 0, random);
  CHECK(receiver.push(view_of(picture), 0).region == *options.region);
  options.region->width = kColumns;
  ocisac::LiveReceiver beyond(camera(), options);
  CHECK_THROWS_AS(beyond.push(view_of(picture), 0), std::invalid_argument);
  for (const ocisac::Region& wraps : {ocisac::Region{SIZE_MAX, 0, 2, 400}, ocisac::Region{65, SIZE_MAX, 40, 2}}) {
    options.region = wraps;
    ocisac::LiveReceiver wrapped(camera(), options);
    CHECK_THROWS_AS(wrapped.push(view_of(picture), 0), std::invalid_argument);
  }
  options.frequency = -1;
  CHECK_THROWS_AS(ocisac::LiveReceiver(camera(), options), std::invalid_argument);
}
