#include <doctest/doctest.h>

#include <cmath>
#include <random>
#include <stdexcept>

#include "ocisac/chips/clock_tracker.hpp"

namespace {

// A light of 3.7 rows per chip, frames 1501.3 rows apart, measured with an error of `phase_std` rows at the middle
// chip.
struct Light {
  double rows_per_chip = 3.7, frame_rows = 1501.3, start = 1.1;
  std::mt19937 random{1};

  [[nodiscard]] double chip_time(double chip) const { return start + chip * rows_per_chip; }

  ocisac::ChipClock measure(std::int64_t frame, double phase_std, double rate_std, ocisac::ClockErrors& errors) {
    std::normal_distribution<double> normal(0, 1);
    const double begin = static_cast<double>(frame) * frame_rows;
    const double first = std::ceil((begin - start) / rows_per_chip);
    constexpr double kMiddle = 140;
    const double period = rows_per_chip + rate_std * normal(random);
    const double middle = chip_time(first + kMiddle) - begin + phase_std * normal(random);
    errors = {140, {phase_std * phase_std, 0, 0, 0, rate_std * rate_std, 0, 0, 0, 0.04}};
    return {period, middle - kMiddle * period, 20 + 0.2 * normal(random)};
  }
};

}  // namespace

TEST_CASE("a clock that drifts is followed") {
  Light light;
  ocisac::ClockTracker tracker({.frame_rows = 1501.3, .drift = 2e-6});
  ocisac::ClockErrors errors;
  double offset = 0;                                    // rows added by the drift so far
  for (std::int64_t frame = 0; frame < 200; ++frame) {  // 50 ppm at the end
    auto clock = light.measure(frame, 0.02, 3e-4, errors);
    const double drift = 50e-6 * static_cast<double>(frame) / 200;
    offset += drift * light.frame_rows;
    clock.phase += offset;
    clock.rows_per_chip *= 1 + drift;
    CHECK(tracker.update(frame, clock, errors));
  }
  CHECK(tracker.predict(200)->clock.rows_per_chip == doctest::Approx(3.7 * (1 + 50e-6)).epsilon(1e-5));
}

TEST_CASE("a jump of the clock begins anew, and time does not go back") {
  Light light;
  ocisac::ClockTracker tracker({.frame_rows = 1501.3});
  ocisac::ClockErrors errors;
  for (std::int64_t frame = 0; frame < 5; ++frame)
    tracker.update(frame, light.measure(frame, 0.02, 1e-4, errors), errors);
  auto clock = light.measure(6, 0.02, 1e-4, errors);
  clock.phase += 1.5;
  CHECK_FALSE(tracker.update(6, clock, errors));
  const auto restarted = tracker.predict(6);
  CHECK(restarted->clock.phase - static_cast<double>(restarted->chip) * restarted->clock.rows_per_chip ==
        doctest::Approx(clock.phase));
  CHECK_THROWS_AS(tracker.update(6, clock, errors), std::invalid_argument);
  CHECK_THROWS_AS(static_cast<void>(tracker.predict(5)), std::invalid_argument);
  tracker.reset();
  CHECK_FALSE(tracker.predict(9));
  CHECK_THROWS_AS(ocisac::ClockTracker({.frame_rows = 0}), std::invalid_argument);
}

TEST_CASE("starts that jitter by a tenth of a chip lose no count, and the prediction counts them in") {
  Light light;
  ocisac::ClockTracker tracker({.frame_rows = 1501.3});
  ocisac::ClockErrors errors;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> jitter(-0.1, 0.1);  // chips
  for (std::int64_t frame = 0; frame < 40; ++frame) {
    auto clock = light.measure(frame, 0.002, 1e-5, errors);
    clock.phase += jitter(random) * clock.rows_per_chip;
    CHECK(tracker.update(frame, clock, errors));
  }
  const auto predicted = tracker.predict(40);
  REQUIRE(predicted);
  const double chips = predicted->errors.phase_std(0) / predicted->clock.rows_per_chip;
  CHECK(chips > 0.03);
  CHECK(chips < 0.15);
}

TEST_CASE("starts that jitter by half a chip are learned after one jump, and fade where they are steady again") {
  Light light;
  ocisac::ClockTracker tracker({.frame_rows = 1501.3});
  ocisac::ClockErrors errors;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> jitter(-0.4, 0.4);  // chips
  const auto scatter = [&](std::int64_t frame) {
    const auto predicted = tracker.predict(static_cast<double>(frame));
    return predicted->errors.phase_std(0) / predicted->clock.rows_per_chip;
  };
  int jumps = 0;
  for (std::int64_t frame = 0; frame < 40; ++frame) {
    auto clock = light.measure(frame, 0.002, 1e-5, errors);
    clock.phase += jitter(random) * clock.rows_per_chip;
    jumps += !tracker.update(static_cast<double>(frame), clock, errors);
  }
  CHECK(jumps <= 1);
  CHECK(scatter(40) > 0.15);
  CHECK(scatter(40) < 0.6);
  for (std::int64_t frame = 40; frame < 100; ++frame)
    tracker.update(static_cast<double>(frame), light.measure(frame, 0.002, 1e-5, errors), errors);
  CHECK(scatter(100) < 0.1);
}

TEST_CASE("frames by time stamps are fractional") {
  Light light;
  ocisac::ClockTracker tracker({.frame_rows = 1501.3});
  ocisac::ClockErrors errors;
  for (const double frame : {0.0, 1.25, 2.1, 3.7, 4.0, 5.9}) {
    auto clock = light.measure(0, 0.002, 1e-5, errors);
    clock.phase -= 1501.3 * frame;
    const double chips = std::ceil(-clock.phase / 3.7);
    clock.phase += 3.7 * chips;
    CHECK(tracker.update(frame, clock, errors));
  }
}
