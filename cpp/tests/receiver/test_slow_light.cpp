// Lights that rise and fall slowly: their chips detected, their time constants estimated.
#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <random>
#include <utility>
#include <vector>

#include "ocisac/receiver/frame_reading.hpp"

namespace {

struct SlowLight {
  std::vector<double> chips, signal;
  ocisac::ChannelEstimate channel;  // as it is
};

// Manchester code of random bits, 5.63 rows a chip, an exposure of five chips, noise of 0.4 % of the swing.
SlowLight slow_light(double rise, double fall) {
  SlowLight light;
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.4);
  for (int bit = 0; bit < 220; ++bit) {
    light.chips.push_back(static_cast<double>(random() & 1U));
    light.chips.push_back(1 - light.chips.back());
  }
  ocisac::ChipClock clock{5.63, -100.3, 28.0};
  clock.rise = rise;
  clock.fall = fall;
  light.signal.resize(1080);
  ocisac::expose_chips({light.chips, 0}, clock, light.signal);
  for (double& value : light.signal) value = 20 + 100 * value + noise(random);
  light.channel.clock = clock;
  light.channel.dark = {20};
  light.channel.swing = {100};
  light.channel.noise = 1.5;
  light.channel.rows = {0, 1080};
  return light;
}

int wrong_chips(const ocisac::FrameReading& reading, const SlowLight& light) {
  const auto first = std::lround((reading.channel.clock.phase - light.channel.clock.phase) / 5.63) + reading.first;
  int wrong = 0;
  for (std::size_t k = 3; k + 3 < reading.llr.size(); ++k)
    wrong += (reading.llr[k] > 0) != (light.chips[static_cast<std::size_t>(first) + k] > 0.5);
  return wrong;
}

}  // namespace

TEST_CASE("chips of a light with known rise and fall are detected, and what is left is noise") {
  for (const auto& [rise, fall] : {std::pair{0.3, 0.3}, std::pair{0.7, 0.7}, std::pair{0.5, 0.05}}) {
    const SlowLight light = slow_light(rise, fall);
    const auto reading = ocisac::read_frame(light.signal, light.channel, true);
    REQUIRE(reading);
    CHECK(wrong_chips(*reading, light) == 0);
    CHECK(reading->relative_noise < 0.0043);  // the light before the frame, which is unknown, leaves nothing
    CHECK(reading->correlation < 0.1);
  }
}

TEST_CASE("a slow light taken for an abrupt one is a misfit; its rise and fall are found") {
  const SlowLight light = slow_light(0.5, 0.5);
  ocisac::ChannelEstimate abrupt = light.channel;
  abrupt.clock.rise = abrupt.clock.fall = 0;
  abrupt.clock.phase += 0.4 * 5.63;
  const auto reading = ocisac::read_frame(light.signal, abrupt, true);
  REQUIRE(reading);
  CHECK(reading->trust < ocisac::Trust::fits);
  const auto shaped = ocisac::refine_shape(light.signal, *reading, true);
  REQUIRE(shaped);
  CHECK(shaped->trust == ocisac::Trust::fits);
  CHECK(shaped->channel.clock.rise == doctest::Approx(0.5).epsilon(0.15));
  CHECK(shaped->channel.clock.fall == doctest::Approx(0.5).epsilon(0.15));
  CHECK(wrong_chips(*shaped, light) == 0);
}

TEST_CASE("a slow light is found blind in sharpened rows, and its shape from the chips there") {
  for (const auto& [rise, fall] : {std::pair{0.75, 0.75}, std::pair{1.0, 1.0}, std::pair{0.5, 0.05}}) {
    const SlowLight light = slow_light(rise, fall);
    const ocisac::FrameSearch blind{.rows_per_chip = 5.63, .exposure_rows = 28.0, .preamble = {}};
    auto found = ocisac::search_frame(ocisac::sharpened(light.signal, 5.63), blind);
    REQUIRE(found);
    found->channel.clock.rise = found->channel.clock.fall = 1;
    const auto shaped = ocisac::refine_shape(light.signal, *found, true);
    REQUIRE(shaped);
    CHECK(shaped->trust == ocisac::Trust::fits);
    CHECK(shaped->channel.clock.rise == doctest::Approx(rise).epsilon(0.03));
    CHECK(std::abs(shaped->channel.clock.fall - fall) < 0.02);
    CHECK(wrong_chips(*shaped, light) == 0);
  }
}
