#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <set>
#include <stdexcept>
#include <vector>

#include "lights/light_regions.hpp"
#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/receiver.hpp"

namespace {

constexpr std::size_t kRows = 900, kColumns = 96;
constexpr double kRowsPerChip = 5.3, kExposure = 8.1, kFrameRows = 1251.3;

const ocisac::PacketFormat kFormat{.block_bytes = 4};

// Box of a light in noisy pictures of level 20.
struct Lamp {
  ocisac::Region box;
  std::vector<std::uint8_t> chips;
  double start;  // chip at the first row of frame 0

  void shine(int frame, std::vector<double>& picture) const {
    const double at = start + frame * kFrameRows / kRowsPerChip;
    const auto first = static_cast<std::size_t>(at) - 8;
    std::vector<double> levels, rows(kRows);
    for (std::size_t k = 0; k < 200; ++k) levels.push_back(chips[(first + k) % chips.size()]);
    ocisac::expose_chips({levels, 0}, {kRowsPerChip, (static_cast<double>(first) - at) * kRowsPerChip, kExposure},
                         rows);
    for (std::size_t y = box.y; y < box.y + box.height; ++y)
      for (std::size_t x = box.x; x < box.x + box.width; ++x) picture[y * kColumns + x] += 90 * rows[y];
  }
};

std::vector<double> picture_of(const std::vector<Lamp>& lamps, int frame, std::mt19937& random) {
  std::normal_distribution<double> noise(20, 3);
  std::vector<double> picture(kRows * kColumns);
  for (double& pixel : picture) pixel = noise(random);
  for (const Lamp& lamp : lamps) lamp.shine(frame, picture);
  return picture;
}

std::vector<Lamp> lamps_in(const std::vector<ocisac::Region>& boxes) {
  std::vector<Lamp> lamps;
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const std::vector<std::uint8_t> payload{1, 2, 3, static_cast<std::uint8_t>(k)};
    lamps.push_back({boxes[k], ocisac::packet_chips(payload, kFormat, static_cast<unsigned>(k)), 345.6 + 1234.5 * k});
  }
  return lamps;
}

const ocisac::Camera kCamera{
    .row_time = 1e-5, .exposure = kExposure * 1e-5, .frame_time = kFrameRows * 1e-5, .tone_curve = {}};

ocisac::ReceiverOptions given_options(std::vector<ocisac::Region> regions = {}) {
  ocisac::ReceiverOptions options;
  options.light.data = {1e5 / kRowsPerChip, kFormat};
  options.regions = std::move(regions);
  return options;
}

// Payload bytes by light, assigned by the box that contains the source's centre.
std::map<std::size_t, std::set<std::uint8_t>> receive(const std::vector<Lamp>& lamps, ocisac::Receiver& receiver,
                                                      int frames) {
  std::mt19937 random(7);
  std::map<std::size_t, std::set<std::uint8_t>> got;
  for (int frame = 0; frame < frames; ++frame) {
    const auto picture = picture_of(lamps, frame, random);
    const ocisac::AnyFramesView view = ocisac::dense_view<const double>(picture.data(), 1, kRows, kColumns);
    for (const auto& result : receiver.push({&view, 1})) {
      if (!result.received->stretch || !result.received->stretch->payload) continue;
      for (std::size_t k = 0; k < lamps.size(); ++k) {
        const ocisac::Region& box = lamps[k].box;
        const std::size_t x = result.region.x + result.region.width / 2, y = result.region.y + result.region.height / 2;
        if (x >= box.x && x < box.x + box.width && y >= box.y && y < box.y + box.height)
          got[k].insert(result.received->stretch->payload->bytes.back());
      }
    }
  }
  return got;
}

}  // namespace

TEST_CASE("lights beside and above each other are streams of their own") {
  const std::vector<std::vector<ocisac::Region>> pictures{{{4, 30, 40, 840}, {52, 0, 40, 900}},
                                                          {{10, 20, 60, 400}, {16, 470, 60, 410}},
                                                          {{5, 0, 40, 430}, {50, 460, 40, 440}}};
  for (const auto& boxes : pictures) {
    const auto lamps = lamps_in(boxes);
    ocisac::Receiver receiver(kCamera, given_options());
    const auto got = receive(lamps, receiver, 60);
    for (std::size_t k = 0; k < lamps.size(); ++k) {
      CAPTURE(k);
      REQUIRE(got.contains(k));
      CHECK(got.at(k) == std::set<std::uint8_t>{static_cast<std::uint8_t>(k)});
    }
  }
}

TEST_CASE("a lamp that appears is received from the search after 60 frames on") {
  const auto lamps = lamps_in({{4, 30, 40, 840}, {52, 0, 40, 900}});
  ocisac::Receiver receiver(kCamera, given_options());
  std::mt19937 random(9);
  int first = -1;
  for (int frame = 0; frame < 70 && first < 0; ++frame) {
    const auto picture = picture_of({lamps.begin(), lamps.begin() + (frame < 20 ? 1 : 2)}, frame, random);
    const ocisac::AnyFramesView view = ocisac::dense_view<const double>(picture.data(), 1, kRows, kColumns);
    for (const auto& light : receiver.push({&view, 1}))
      if (light.region.x >= 45 && light.received->outcome == ocisac::FrameOutcome::received) first = frame;
  }
  CHECK(first >= 62);  // three frames agree,
  CHECK(first < 72);   // of twelve
}

TEST_CASE("a texture that resembles more lights than are allowed has none") {
  constexpr std::size_t kTile = 40, kTall = 1080, kWide = 640;
  std::mt19937 random(1);
  std::normal_distribution<double> brightness(70, 12), noise(0, 2);
  std::vector<double> tiles(kTall * kWide / (kTile * kTile));
  for (double& tile : tiles) tile = brightness(random);
  std::vector<std::uint8_t> picture(kTall * kWide);
  for (std::size_t row = 0; row < kTall; ++row)
    for (std::size_t column = 0; column < kWide; ++column)
      picture[row * kWide + column] = static_cast<std::uint8_t>(
          std::clamp(tiles[row / kTile * (kWide / kTile) + column / kTile] + noise(random), 0.0, 255.0));
  const auto view = ocisac::dense_view<const std::uint8_t>(picture.data(), 1, kTall, kWide);
  const std::size_t resembled = ocisac::light_regions(view, {}, 1000).size();
  CHECK(resembled > 8);
  CHECK(ocisac::light_regions(view, {}, resembled).size() == resembled);
  CHECK(ocisac::light_regions(view, {}, resembled - 1).empty());
  CHECK(ocisac::light_regions(view, {}, 8).empty());
}

TEST_CASE("regions that are given are read, those outside refused") {
  const auto lamps = lamps_in({{10, 0, 60, 440}, {10, 440, 60, 460}});  // they touch
  ocisac::Receiver receiver(kCamera, given_options({lamps[0].box, lamps[1].box}));
  const auto got = receive(lamps, receiver, 60);
  CHECK(got.size() == 2);
  ocisac::Receiver outside(kCamera, given_options({{90, 0, 10, 10}}));
  const std::vector<double> picture(kRows * kColumns, 1.0);
  const ocisac::AnyFramesView view = ocisac::dense_view<const double>(picture.data(), 1, kRows, kColumns);
  CHECK_THROWS_WITH_AS(outside.push({&view, 1}), "regions: got 90,0,10,10, allowed: inside the picture of 96x900",
                       std::invalid_argument);
}

TEST_CASE("one light keeps the whole frame, and a picture without any says so") {
  std::mt19937 random(3);
  ocisac::Receiver receiver(kCamera, given_options());
  const auto lamps = lamps_in({{0, 0, 96, 900}});
  for (int frame = 0; frame < 4; ++frame) {
    const auto picture = picture_of(lamps, frame, random);
    const ocisac::AnyFramesView view = ocisac::dense_view<const double>(picture.data(), 1, kRows, kColumns);
    const auto results = receiver.push({&view, 1});
    REQUIRE(results.size() == 1);
    CHECK(results[0].region == ocisac::Region{0, 0, 96, 900});
    CHECK(results[0].received->outcome == ocisac::FrameOutcome::received);
  }
  ocisac::Receiver dark(kCamera, given_options());
  for (int frame = 0; frame < 5; ++frame) {
    const auto picture = picture_of({}, frame, random);
    const ocisac::AnyFramesView view = ocisac::dense_view<const double>(picture.data(), 1, kRows, kColumns);
    for (const auto& result : dark.push({&view, 1})) {
      CHECK(result.received->outcome != ocisac::FrameOutcome::received);
      CHECK(std::isnan(result.received->snr));
    }
  }
}
