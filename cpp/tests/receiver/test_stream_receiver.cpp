#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <ctime>
#include <random>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/receiver.hpp"

namespace {

constexpr double kRowsPerChip = 5.6, kFrameRows = 1500.4, kExposure = 16.8;
constexpr std::size_t kRows = 1080;

// Rows of a frame of a light that repeats `chips`, 2 % noise.
std::vector<double> frame_of(const std::vector<std::uint8_t>& chips, int frame, std::mt19937& random) {
  const double start = 777.7 + frame * kFrameRows / kRowsPerChip;  // chip at the first row
  const auto first = static_cast<std::size_t>(start) - 8;
  std::vector<double> levels;
  for (std::size_t k = 0; k < 220; ++k) levels.push_back(chips[(first + k) % chips.size()]);
  std::vector<double> rows(kRows);
  ocisac::expose_chips({levels, 0}, {kRowsPerChip, (static_cast<double>(first) - start) * kRowsPerChip, kExposure},
                       rows);
  std::normal_distribution<double> noise(0, 0.02);
  for (double& row : rows) row = 20 + 100 * (row + noise(random));
  return rows;
}

}  // namespace

TEST_CASE("frames of darkness and of noise teach no profile, tell no chips and cost no search") {
  std::mt19937 random(2);
  const auto chips = ocisac::packet_chips(std::vector<std::uint8_t>{1, 2, 3}, {}, 7);
  const ocisac::Camera camera{
      .row_time = 1e-5, .exposure = kExposure * 1e-5, .frame_time = kFrameRows * 1e-5, .tone_curve = {}};
  ocisac::ReceiverOptions options;
  options.light.data->chip_rate = 1e5 / kRowsPerChip;
  options.whole_picture = true;
  for (const double deviation : {0.0, 2.0, 60.0}) {  // DN
    CAPTURE(deviation);
    ocisac::Receiver receiver(camera, options);
    std::normal_distribution<double> noise(20, deviation > 0 ? deviation : 1);
    const std::clock_t begun = std::clock();
    double with_light = 0;
    for (int frame = 0; frame < 52; ++frame) {
      const bool dark = frame % 26 >= 14;
      auto rows = frame_of(chips, frame, random);
      if (dark) std::ranges::generate(rows, [&] { return deviation > 0 ? noise(random) : 20.0; });
      const ocisac::AnyFramesView view = ocisac::dense_view<const double>(rows.data(), 1, kRows, 1);
      const auto result = *receiver.push({&view, 1}, frame).front().received;
      CAPTURE(frame);
      CHECK(result.outcome == (dark ? ocisac::FrameOutcome::no_signal : ocisac::FrameOutcome::received));
      CHECK(result.bits.empty() == dark);
      if (frame == 13) with_light = static_cast<double>(std::clock() - begun);
    }
    // The first search included. Learning a profile from them took 90 to 820 times as long as all frames of light.
    CHECK(static_cast<double>(std::clock() - begun) < 30 * with_light);
  }
}

TEST_CASE("a square wave is received with the shortest of the exposures that explain it") {
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 2);
  std::vector<double> chips, rows(720);
  for (std::size_t k = 0; k < 120; ++k) chips.push_back(static_cast<double>(k % 2));
  for (const double exposure : {1.0, 2.8, 8.4}) {
    CAPTURE(exposure);
    ocisac::expose_chips({chips, 0}, {9.3, -40.3, exposure}, rows);
    for (double& row : rows) row = 40 + 150 * row + noise(random);
    ocisac::ReceiverOptions options;
    options.light.data->chip_rate = 1 / 9.3;
    options.whole_picture = true;
    ocisac::Receiver receiver({.row_time = 1, .exposure = {}, .frame_time = {}, .tone_curve = {}}, options);
    const ocisac::AnyFramesView view = ocisac::dense_view<const double>(rows.data(), 1, rows.size(), 1);
    const auto result = *receiver.push({&view, 1}).front().received;
    CHECK(result.outcome == ocisac::FrameOutcome::received);
    CHECK(result.exposure == doctest::Approx(exposure).epsilon(0.1));
    CHECK((result.flags & ocisac::flag::periodic) != 0);
  }
}
