#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "ocisac/cleaning/stream_cleaner.hpp"
#include "ocisac/ocisac.h"

namespace {

constexpr std::uint32_t kRows = 240, kColumns = 120;
constexpr double kRowTime = 1e-5, kPeriod = 37.3;

// Boxes under a tone with the phase of a frame; `pixels` interleaved samples for each pixel, all alike.
template <class Sample>
std::vector<Sample> picture(int frame, std::size_t pixels = 1, double scale = 1) {
  std::vector<Sample> result;
  for (std::size_t n = 0; n < kRows; ++n)
    for (std::size_t k = 0; k < kColumns; ++k) {
      const double box = 40 + 15 * static_cast<double>((n / 41 + k / 23 + (n / 17) * (k / 31)) % 4);
      const double angle = 2 * std::numbers::pi * (static_cast<double>(n) / kPeriod + 0.37 * frame);
      const double noise = static_cast<double>((n * 7919 + k * 104729) % 5) / 4 - 0.5;
      const auto value = static_cast<Sample>(std::lround(scale * (box * (1 + 0.7 * std::cos(angle)) + noise)));
      result.insert(result.end(), pixels, value);
    }
  return result;
}

struct Cleaner {
  ocisac_cleaner* made = nullptr;

  explicit Cleaner(const std::function<void(ocisac_cleaner_options&)>& change = [](auto&) {}) {
    ocisac_cleaner_options options;
    ocisac_cleaner_options_init(&options);
    options.row_time = kRowTime;
    change(options);
    code = ocisac_cleaner_create(&options, &made);
  }
  Cleaner(const Cleaner&) = delete;
  Cleaner& operator=(const Cleaner&) = delete;
  ~Cleaner() { ocisac_cleaner_destroy(made); }

  int code;
};

ocisac_plane plane_of(std::vector<std::uint8_t>& pixels) {
  return {pixels.data(), OCISAC_GRAY8, kColumns, kRows, kColumns, 1};
}

// Deviation of the rows' means, over their mean.
template <class Sample>
double swing(const std::vector<Sample>& pixels) {
  std::vector<double> rows(kRows);
  double mean = 0, square = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) rows[i * kRows / pixels.size()] += static_cast<double>(pixels[i]);
  for (const double row : rows) {
    mean += row / kRows;
    square += row * row / kRows;
  }
  return std::sqrt(square - mean * mean) / mean;
}

}  // namespace

TEST_CASE("C: a stream is cleaned in place, as by the core") {
  const Cleaner cleaner([](auto& options) { options.mean_level = 1; });
  REQUIRE(cleaner.code == OCISAC_OK);
  ocisac::Camera camera;
  camera.row_time = kRowTime;
  ocisac::StreamCleaner core(camera);
  for (int k = 0; k < 3; ++k) {
    const auto stored = picture<std::uint8_t>(k);
    auto pixels = stored;
    const ocisac_plane plane = plane_of(pixels);
    ocisac_cleaned cleaned;
    ocisac_cleaned_init(&cleaned);
    REQUIRE(ocisac_cleaner_push(cleaner.made, &plane, 1, &cleaned) == OCISAC_OK);
    CHECK(cleaned.model == OCISAC_MODEL_TONE);
    CHECK(cleaned.frequency == doctest::Approx(1 / (kPeriod * kRowTime)).epsilon(0.01));
    CHECK(std::string(cleaned.unchanged).empty());
    CHECK(swing(pixels) < 0.3 * swing(stored));
    const auto found = core.push({ocisac::dense_view(stored.data(), 1, kRows, kColumns)});
    const auto& light = found.light.lights.front().lights.front();
    auto restored = stored;
    found.stored.restore<std::uint8_t>(0, 0, found.light.shares.front(), {light.light, 1, 8},
                                       {ocisac::dense_view(restored.data(), 1, kRows, kColumns)});
    CHECK(pixels == restored);
    CHECK(cleaned.light_left == found.light.verdicts.front().light_left);
  }
}

TEST_CASE("C: a stamp's time reaches the core") {
  const Cleaner cleaner;
  ocisac::Camera camera;
  camera.row_time = kRowTime;
  ocisac::StreamCleaner core(camera);
  ocisac_stamp stamp;
  ocisac_stamp_init(&stamp);
  for (const int number : {0, 1, 2, 4, 5}) {
    std::vector<std::uint8_t> stored;
    for (std::size_t i = 0; i < std::size_t{kRows} * kColumns; ++i) {
      const std::size_t n = i / kColumns, k = i % kColumns;
      const double angle = 2 * std::numbers::pi * (1.2 * static_cast<double>(n) / kRows + 0.3 * number);
      const double box = 60 + 30 * static_cast<double>((n / 41 + k / 23 + (n / 17) * (k / 31)) % 4);
      stored.push_back(static_cast<std::uint8_t>(std::lround(box * (1 + 0.3 * std::cos(angle)))));
    }
    auto pixels = stored;
    const ocisac_plane plane = plane_of(pixels);
    stamp.time = number / 30.0;
    ocisac_cleaned cleaned;
    ocisac_cleaned_init(&cleaned);
    REQUIRE(ocisac_cleaner_push_stamped(cleaner.made, &plane, 1, &stamp, &cleaned) == OCISAC_OK);
    const ocisac::AnyFramesView view = ocisac::dense_view(std::as_const(stored).data(), 1, kRows, kColumns);
    const auto found = core.push({view}, stamp.time);
    CHECK(cleaned.slow_bands == found.light.verdicts.front().slow_bands);
    CHECK(cleaned.light_left == found.light.verdicts.front().light_left);
    CHECK(std::string(cleaned.unchanged) == found.light.unchanged);
  }
  stamp.time = std::numeric_limits<double>::infinity();
  auto pixels = picture<std::uint8_t>(0);
  const ocisac_plane plane = plane_of(pixels);
  CHECK(ocisac_cleaner_push_stamped(cleaner.made, &plane, 1, &stamp, nullptr) == OCISAC_BAD_ARGUMENT);
  CHECK(ocisac_cleaner_push_stamped(cleaner.made, &plane, 1, nullptr, nullptr) == OCISAC_BAD_ARGUMENT);
}

TEST_CASE("C: colours beside each other, sixteen bits, and rows from below are cleaned") {
  auto colours = picture<std::uint8_t>(0, 3);
  const auto stored = colours;
  std::vector<ocisac_plane> planes;
  for (std::size_t k = 0; k < 3; ++k) planes.push_back({&colours[k], OCISAC_GRAY8, kColumns, kRows, 3 * kColumns, 3});
  const Cleaner cleaner, upwards([](auto&options) { options.scan_axis = OCISAC_UP; });
  REQUIRE(ocisac_cleaner_push(cleaner.made, planes.data(), planes.size(), nullptr) == OCISAC_OK);
  CHECK(swing(colours) < 0.3 * swing(stored));
  CHECK(colours[0] == colours[2]);
  auto words = picture<std::uint16_t>(0, 1, 200);
  const double before = swing(words);
  // The last row first, whose light is the first row's.
  const ocisac_plane plane{
      &words[(kRows - 1) * kColumns], OCISAC_GRAY16, kColumns, kRows, -2 * std::ptrdiff_t{kColumns}, 2};
  REQUIRE(ocisac_cleaner_push(upwards.made, &plane, 1, nullptr) == OCISAC_OK);
  CHECK(swing(words) < 0.3 * before);
}

TEST_CASE("C: a frame without bands stays, with a reason") {
  const Cleaner cleaner;
  std::vector<std::uint8_t> pixels;
  for (std::size_t i = 0; i < std::size_t{kRows} * kColumns; ++i)
    pixels.push_back(static_cast<std::uint8_t>(60 + (i * 2654435761U >> 13 & 63U)));
  const auto stored = pixels;
  const ocisac_plane plane = plane_of(pixels);
  ocisac_cleaned cleaned;
  ocisac_cleaned_init(&cleaned);
  REQUIRE(ocisac_cleaner_push(cleaner.made, &plane, 1, &cleaned) == OCISAC_OK);
  CHECK(pixels == stored);
  CHECK_FALSE(std::string(cleaned.unchanged).empty());

  std::fill(pixels.begin(), pixels.end(), std::uint8_t{0});
  for (int frame = 0; frame < 2; ++frame) {
    REQUIRE(ocisac_cleaner_push(cleaner.made, &plane, 1, &cleaned) == OCISAC_OK);
    CHECK(std::ranges::all_of(pixels, [](std::uint8_t pixel) { return pixel == 0; }));
    CHECK(std::string(cleaned.unchanged) == "no bands: all rows have the same light");
  }
}

TEST_CASE("C: options of a cleaner are checked, with the name of the bad one") {
  const std::vector<std::pair<std::string, std::function<void(ocisac_cleaner_options&)>>> bad{
      {"row_time", [](auto& options) { options.row_time = 0; }},
      {"frame_time", [](auto& options) { options.frame_time = -1; }},
      {"noise", [](auto& options) { options.noise = 0; }},
      {"toe", [](auto& options) { options.toe = 2; }},
      {"max_gain", [](auto& options) { options.max_gain = 1; }},
      {"gamma", [](auto& options) { options.tone_curve = OCISAC_GAMMA, options.gamma = 0; }},
      {"tone_curve", [](auto& options) { options.tone_curve = 3; }},
      {"scan_axis", [](auto& options) { options.scan_axis = -1; }},
      {"model", [](auto& options) { options.model = 4; }},
      {"options", [](auto& options) { options.size = 3; }},
  };
  for (const auto& each : bad) {  // no structured binding: the message's lambda cannot capture one
    const std::string& name = each.first;
    const Cleaner cleaner(each.second);
    CAPTURE(name);
    CHECK(cleaner.code == OCISAC_BAD_ARGUMENT);
    CHECK(cleaner.made == nullptr);
    CHECK(std::string(ocisac_last_error()).rfind(name, 0) == 0);
  }
  CHECK(ocisac_cleaner_create(nullptr, nullptr) == OCISAC_BAD_ARGUMENT);
}

TEST_CASE("C: planes of a cleaner are checked, and the pixels stay") {
  const Cleaner cleaner;
  auto pixels = picture<std::uint8_t>(0);
  const auto stored = pixels;
  const std::vector<std::pair<std::string, std::function<void(ocisac_plane&)>>> bad{
      {"planes", [](auto& plane) { plane.pixels = nullptr; }},
      {"planes", [](auto& plane) { plane.width = 0; }},
      {"format", [](auto& plane) { plane.format = OCISAC_YUYV; }},
      {"stride", [](auto& plane) { plane.stride = kColumns - 1; }},
      {"pixel_stride", [](auto& plane) { plane.pixel_stride = 0; }},
      {"pixel_stride",  // times its width: 2^64, which is 0
       [](auto& plane) { plane.width = 9, plane.pixel_stride = std::ptrdiff_t{1} << 61; }},
      {"pixel_stride", [](auto& plane) { plane.pixel_stride = std::numeric_limits<std::ptrdiff_t>::min(); }},
      {"stride", [](auto& plane) { plane.stride = std::numeric_limits<std::ptrdiff_t>::min(); }},
      {"stride", [](auto& plane) { plane.stride = std::numeric_limits<std::ptrdiff_t>::max() / 4; }},
      {"frames", [](auto& plane) { plane.height = 7; }},
  };
  for (const auto& each : bad) {
    const std::string& name = each.first;
    ocisac_plane plane = plane_of(pixels);
    each.second(plane);
    CAPTURE(name);
    CHECK(ocisac_cleaner_push(cleaner.made, &plane, 1, nullptr) == OCISAC_BAD_ARGUMENT);
    CHECK(std::string(ocisac_last_error()).rfind(name, 0) == 0);
  }
  const ocisac_plane good = plane_of(pixels);
  ocisac_cleaned cleaned;
  cleaned.size = 1;
  CHECK(ocisac_cleaner_push(cleaner.made, &good, 1, &cleaned) == OCISAC_BAD_ARGUMENT);
  CHECK(ocisac_cleaner_push(cleaner.made, &good, 0, nullptr) == OCISAC_BAD_ARGUMENT);
  CHECK(ocisac_cleaner_push(nullptr, &good, 1, nullptr) == OCISAC_BAD_ARGUMENT);
  CHECK(ocisac_cleaner_forget(nullptr) == OCISAC_BAD_ARGUMENT);
  ocisac_cleaner_destroy(nullptr);
  CHECK(pixels == stored);
  CHECK(ocisac_cleaner_push(cleaner.made, &good, 1, nullptr) == OCISAC_OK);
  CHECK(ocisac_cleaner_forget(cleaner.made) == OCISAC_OK);
}
