#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/core/version.hpp"
#include "ocisac/ocisac.h"
#include "ocisac/packets/packets.hpp"

namespace {

constexpr std::uint32_t kRows = 400, kColumns = 24;

// A tone of 900 Hz at 20 us per row: 100 + 80·cos.
template <class T>
std::vector<T> picture() {
  std::vector<T> pixels(kRows * kColumns);
  for (std::uint32_t row = 0; row < kRows; ++row)
    for (std::uint32_t column = 0; column < kColumns; ++column)
      pixels[row * kColumns + column] =
          static_cast<T>(std::lround(100 + 80 * std::cos(2 * std::numbers::pi * std::fmod(900 * 20e-6 * row, 1.0))));
  return pixels;
}

// A struct as its function initialises it.
template <class T>
T fresh(void (*init)(T*)) {
  T made;
  init(&made);
  return made;
}

void check_refused(int code, const std::string& begin) {
  CHECK(code == OCISAC_BAD_ARGUMENT);
  CHECK(std::string(ocisac_last_error()).substr(0, begin.size()) == begin);
}

ocisac_options packet_options() {
  auto options = fresh(ocisac_options_init);
  options.row_time = 20e-6;
  options.frequency = 900;
  options.want_data = 0;
  return options;
}

}  // namespace

TEST_CASE("C: frames in, results out") {
  const ocisac_options options = packet_options();
  ocisac_receiver* receiver = nullptr;
  REQUIRE(ocisac_create(&options, &receiver) == OCISAC_OK);
  auto result = fresh(ocisac_result_init);
  CHECK(ocisac_poll(receiver, &result) == OCISAC_NOTHING);
  const auto pixels = picture<std::uint16_t>();
  // The same picture, bottom row first, contains the same tone.
  for (const int direction : {1, -1}) {
    const std::uint16_t* first = direction > 0 ? pixels.data() : pixels.data() + (kRows - 1) * kColumns;
    const ocisac_frame frame{
        first, OCISAC_GRAY16, kColumns, kRows, direction * 2 * std::ptrdiff_t{kColumns}, direction > 0 ? 0 : 5};
    REQUIRE(ocisac_push(receiver, &frame) == OCISAC_OK);
    REQUIRE(ocisac_poll(receiver, &result) == OCISAC_OK);
    CHECK(result.frame == frame.number);
    CHECK(result.gain == doctest::Approx(0.8).epsilon(1e-3));
    CHECK(result.frequency == 900);
    CHECK(result.suggested_exposure == doctest::Approx(1.0 / 1800));
    CHECK(std::isnan(result.chip_rate));
    CHECK(result.bit_count == 0);
    CHECK(std::strlen(result.bits) == 0);
    CHECK(result.payload == nullptr);
    CHECK(ocisac_poll(receiver, &result) == OCISAC_NOTHING);
  }
  ocisac_destroy(receiver);
  ocisac_destroy(nullptr);
  CHECK(std::string(ocisac_version()) == ocisac::version());
}

TEST_CASE("C: frames whose numbers do not ascend are repeated, until eight in a row begin another count") {
  constexpr auto kLeast = std::numeric_limits<std::int64_t>::min(), kMost = std::numeric_limits<std::int64_t>::max();
  ocisac_options options = packet_options();
  options.want_data = 1;
  ocisac_receiver* receiver = nullptr;
  REQUIRE(ocisac_create(&options, &receiver) == OCISAC_OK);
  const auto pixels = picture<std::uint16_t>();
  const auto is_received = [&](std::int64_t number) {
    const ocisac_frame frame{pixels.data(), OCISAC_GRAY16, kColumns, kRows, 2 * std::ptrdiff_t{kColumns}, number};
    REQUIRE(ocisac_push(receiver, &frame) == OCISAC_OK);
    auto result = fresh(ocisac_result_init);
    REQUIRE(ocisac_poll(receiver, &result) == OCISAC_OK);
    CHECK(result.frame == number);
    return !std::isnan(result.gain);
  };
  CHECK(is_received(kLeast));
  CHECK(is_received(5));
  for (const std::int64_t number : {std::int64_t{5}, std::int64_t{4}, std::int64_t{-1}, kLeast})
    CHECK_FALSE(is_received(number));
  CHECK(is_received(kMost));
  CHECK_FALSE(is_received(kMost));
  for (std::int64_t number = -10; number < 0; ++number) CHECK(is_received(number) == (number >= -3));
  ocisac_destroy(receiver);
}

TEST_CASE("C: bits and the payload of a packet") {
  constexpr double kChip = 5, kFrameRows = 500;  // rows
  const std::vector<std::uint8_t> payload{1, 2, 3, 255};
  const auto chips = ocisac::packet_chips(payload, {}, 9);
  ocisac_options options = packet_options();
  options.exposure = 40e-6;
  options.frame_time = kFrameRows * options.row_time;
  options.chip_rate = 1 / (kChip * options.row_time);
  options.want_gain = 0;
  options.want_data = 1;
  options.region = {0, 0, kColumns, kRows};
  ocisac_receiver* receiver = nullptr;
  REQUIRE(ocisac_create(&options, &receiver) == OCISAC_OK);
  bool got = false;
  for (std::int64_t number = 0; number < 40 && !got; ++number) {
    CAPTURE(number);
    std::vector<double> levels, light(kRows);
    const auto first = static_cast<std::size_t>(number) * 100;  // chip at the first row
    for (std::size_t k = 0; k < 90; ++k) levels.push_back(chips[(first + k) % chips.size()]);
    ocisac::expose_chips({levels, 0}, {kChip, 0, 2}, light);
    std::vector<std::uint8_t> pixels;
    for (std::size_t k = 0; k < kRows * kColumns; ++k)
      pixels.push_back(static_cast<std::uint8_t>(30 + 180 * light[k / kColumns] + static_cast<double>(k * 7 % 3)));
    const ocisac_frame frame{pixels.data(), OCISAC_GRAY8, kColumns, kRows, std::ptrdiff_t{kColumns}, number};
    REQUIRE(ocisac_push(receiver, &frame) == OCISAC_OK);
    auto result = fresh(ocisac_result_init);
    REQUIRE(ocisac_poll(receiver, &result) == OCISAC_OK);
    CHECK(result.chip_rate == doctest::Approx(options.chip_rate).epsilon(1e-3));
    CHECK(result.error_rate < 1e-6);
    CHECK(result.data_snr > 100);
    std::string sent;
    for (const double level : levels) sent += level > 0 ? '1' : '0';
    CHECK(result.bit_count >= 78);
    CHECK(sent.find(result.bits) != std::string::npos);
    CHECK(std::abs(std::remainder(result.first_bit, kChip)) < 0.1);  // chips begin at multiples of 5 rows
    CHECK(result.first_bit > -0.1);
    if (result.payload == nullptr) continue;
    CHECK(std::vector<std::uint8_t>(result.payload, result.payload + result.payload_bytes) == payload);
    CHECK(result.packet == 9);
    got = true;
  }
  CHECK(got);
  ocisac_destroy(receiver);
}

TEST_CASE("C: what has no meaning is a code and a line") {
  ocisac_receiver* receiver = nullptr;
  ocisac_options options = packet_options();
  options.row_time = 0;
  CHECK(ocisac_create(&options, &receiver) == OCISAC_BAD_ARGUMENT);
  CHECK(receiver == nullptr);
  CHECK(std::string(ocisac_last_error()).find("row_time: got 0") == 0);
  options = packet_options();
  options.line_code = 9;
  CHECK(ocisac_create(&options, &receiver) == OCISAC_BAD_ARGUMENT);
  options = packet_options();
  options.size = 0;
  CHECK(ocisac_create(&options, &receiver) == OCISAC_BAD_ARGUMENT);
  CHECK(ocisac_create(nullptr, &receiver) == OCISAC_BAD_ARGUMENT);
  CHECK(ocisac_create(&options, nullptr) == OCISAC_BAD_ARGUMENT);

  options = packet_options();
  REQUIRE(ocisac_create(&options, &receiver) == OCISAC_OK);
  const auto pixels = picture<std::uint8_t>();
  ocisac_frame frame{pixels.data(), OCISAC_GRAY8, kColumns, kRows, kColumns - 1, 0};
  check_refused(ocisac_push(receiver, &frame), "stride: got 23");
  for (const std::ptrdiff_t stride : {std::numeric_limits<std::ptrdiff_t>::min(),
                                      std::numeric_limits<std::ptrdiff_t>::max() / 4, std::ptrdiff_t{0}}) {
    frame.stride = stride;
    check_refused(ocisac_push(receiver, &frame), "stride: got " + std::to_string(stride));
  }
  frame.stride = kColumns;
  frame.format = 7;
  CHECK(ocisac_push(receiver, &frame) == OCISAC_BAD_ARGUMENT);
  CHECK(ocisac_push(receiver, nullptr) == OCISAC_BAD_ARGUMENT);
  frame.format = OCISAC_GRAY8;
  CHECK(ocisac_push(receiver, &frame) == OCISAC_OK);
  frame.height = kRows / 2;
  CHECK(ocisac_push(receiver, &frame) == OCISAC_BAD_ARGUMENT);
  CHECK(ocisac_poll(receiver, nullptr) == OCISAC_BAD_ARGUMENT);
  ocisac_destroy(receiver);

  options.region = {UINT32_MAX, UINT32_MAX, 2, 2};
  REQUIRE(ocisac_create(&options, &receiver) == OCISAC_OK);
  frame.height = kRows;
  check_refused(ocisac_push(receiver, &frame), "region: got 4294967295,4294967295,2,2");
  ocisac_destroy(receiver);
}

TEST_CASE("C: a program that knows less of the structs gets what it knows") {
  ocisac_options options = packet_options();
  options.size = offsetof(ocisac_options, region);
  options.region = {99, 99, 99, 99};  // beyond the given size: ignored
  ocisac_receiver* receiver = nullptr;
  REQUIRE(ocisac_create(&options, &receiver) == OCISAC_OK);
  const auto pixels = picture<std::uint8_t>();
  const ocisac_frame frame{pixels.data(), OCISAC_GRAY8, kColumns, kRows, kColumns, 0};
  REQUIRE(ocisac_push(receiver, &frame) == OCISAC_OK);
  auto result = fresh(ocisac_result_init);
  result.size = offsetof(ocisac_result, bits);
  result.bits = "untouched";
  REQUIRE(ocisac_poll(receiver, &result) == OCISAC_OK);
  CHECK(result.gain == doctest::Approx(0.8).epsilon(0.01));
  CHECK(std::string(result.bits) == "untouched");
  ocisac_destroy(receiver);
}

TEST_CASE("C: a frame's stamp is checked, and not stated by default") {
  const ocisac_options options = packet_options();
  ocisac_receiver* receiver = nullptr;
  REQUIRE(ocisac_create(&options, &receiver) == OCISAC_OK);
  const auto pixels = picture<std::uint16_t>();
  const ocisac_frame frame{pixels.data(), OCISAC_GRAY16, kColumns, kRows, 2 * std::ptrdiff_t{kColumns}, 0};
  auto stamp = fresh(ocisac_stamp_init);
  CHECK(std::isnan(stamp.time));
  CHECK(ocisac_push_stamped(receiver, &frame, nullptr) == OCISAC_BAD_ARGUMENT);
  stamp.exposure = -1;
  check_refused(ocisac_push_stamped(receiver, &frame, &stamp), "exposure: got -1");
  stamp.exposure = 1e-4;
  stamp.time = 12.5;
  CHECK(ocisac_push_stamped(receiver, &frame, &stamp) == OCISAC_OK);
  ocisac_destroy(receiver);
}

namespace {

constexpr std::uint32_t kWidth = 200, kHeight = 400;

// Two lamps side by side on dark ground, of 900 and 1700 Hz at 20 us per row, with a little noise.
std::vector<std::uint8_t> two_lamps() {
  std::vector<std::uint8_t> pixels(std::size_t{kWidth} * kHeight);
  for (std::uint32_t row = 0; row < kHeight; ++row)
    for (std::uint32_t column = 0; column < kWidth; ++column) {
      const auto noise = static_cast<double>((row * 977U + column * 131U) * 2654435761U >> 24 & 7U);
      const bool lit = row >= 40 && row < 360 && (column % 100) >= 20 && (column % 100) < 80;
      const double frequency = column < 100 ? 900 : 1700;
      const double light = 110 + 80 * std::cos(2 * std::numbers::pi * std::fmod(frequency * 20e-6 * row, 1.0));
      pixels[row * std::size_t{kWidth} + column] = static_cast<std::uint8_t>(std::lround((lit ? light : 10) + noise));
    }
  return pixels;
}

}  // namespace

TEST_CASE("C: several lights, one result each") {
  ocisac_options options = packet_options();
  options.frequency = std::nan("");
  options.max_lights = 0;
  ocisac_receiver* receiver = nullptr;
  check_refused(ocisac_create(&options, &receiver), "max_lights: got 0");
  options.max_lights = 4;
  REQUIRE(ocisac_create(&options, &receiver) == OCISAC_OK);
  const auto pixels = two_lamps();
  ocisac_frame frame{pixels.data(), OCISAC_GRAY8, kWidth, kHeight, kWidth, 0};
  std::vector<double> frequencies;
  for (frame.number = 0; frame.number < 6; ++frame.number) {  // three frames must agree on several lights
    REQUIRE(ocisac_push(receiver, &frame) == OCISAC_OK);
    frequencies.clear();
    auto result = fresh(ocisac_result_init);
    while (ocisac_poll(receiver, &result) == OCISAC_OK) {
      CHECK(result.frame == frame.number);
      frequencies.push_back(result.frequency);
    }
  }
  std::sort(frequencies.begin(), frequencies.end());
  REQUIRE(frequencies.size() == 2);
  CHECK(frequencies[0] == doctest::Approx(900).epsilon(0.01));
  CHECK(frequencies[1] == doctest::Approx(1700).epsilon(0.01));
  ocisac_destroy(receiver);
}

TEST_CASE("C: lights of one picture") {
  const ocisac_options options = packet_options();
  const auto pixels = two_lamps();
  const ocisac_frame frame{pixels.data(), OCISAC_GRAY8, kWidth, kHeight, kWidth, 0};
  std::vector<ocisac_light> lights(3);
  for (auto& light : lights) ocisac_light_init(&light);
  std::size_t found = 99;
  REQUIRE(ocisac_detect(&options, &frame, lights.data(), lights.size(), &found) == OCISAC_OK);
  REQUIRE(found == 2);
  std::sort(lights.begin(), lights.begin() + 2, [](const auto& a, const auto& b) { return a.box.x < b.box.x; });
  CHECK(lights[0].frequency == doctest::Approx(900).epsilon(0.01));
  CHECK(lights[1].frequency == doctest::Approx(1700).epsilon(0.01));
  CHECK(lights[0].probability > 0.9);
  CHECK(lights[0].box.x < 30);
  CHECK(lights[0].box.x + lights[0].box.width > 70);
  CHECK(lights[2].probability == 0);  // not written

  CHECK(ocisac_detect(&options, &frame, lights.data(), 1, &found) == OCISAC_OK);
  CHECK(found == 2);
  CHECK(ocisac_detect(&options, &frame, nullptr, 0, &found) == OCISAC_OK);
  CHECK(found == 2);
  CHECK(ocisac_detect(&options, &frame, nullptr, 1, &found) == OCISAC_BAD_ARGUMENT);
  CHECK(ocisac_detect(nullptr, &frame, lights.data(), 1, &found) == OCISAC_BAD_ARGUMENT);
  lights[0].size = 0;
  check_refused(ocisac_detect(&options, &frame, lights.data(), 1, &found), "lights: got 0");
}

TEST_CASE("C: rows in any direction, luma between chroma: the same light, in stored pixels") {
  ocisac_options options = packet_options();
  const auto down = two_lamps();
  const auto lit_box = [&](const ocisac_frame& frame) {
    auto light = fresh(ocisac_light_init);
    std::size_t found = 0;
    REQUIRE(ocisac_detect(&options, &frame, &light, 1, &found) == OCISAC_OK);
    REQUIRE(found == 2);
    return light;
  };
  const ocisac_light upright = lit_box({down.data(), OCISAC_GRAY8, kWidth, kHeight, kWidth, 0});

  std::vector<std::uint8_t> across(down.size()), yuyv(2 * down.size(), 128);
  for (std::size_t row = 0; row < kHeight; ++row)
    for (std::size_t column = 0; column < kWidth; ++column) {
      across[column * kHeight + (kHeight - 1 - row)] = down[row * kWidth + column];
      yuyv[2 * (row * kWidth + column)] = down[row * kWidth + column];
    }
  const ocisac_light luma = lit_box({yuyv.data(), OCISAC_YUYV, kWidth, kHeight, 2 * kWidth, 0});
  CHECK(luma.frequency == upright.frequency);
  CHECK(luma.box.x == upright.box.x);

  options.scan_axis = OCISAC_LEFT;
  const ocisac_frame turned{across.data(), OCISAC_GRAY8, kHeight, kWidth, kHeight, 0};
  const ocisac_light left = lit_box(turned);
  CHECK(left.frequency == upright.frequency);
  CHECK(left.box.y == upright.box.x);
  CHECK(left.box.x == kHeight - upright.box.y - upright.box.height);

  options.region = left.box;
  options.frequency = std::nan("");
  ocisac_receiver* receiver = nullptr;
  REQUIRE(ocisac_create(&options, &receiver) == OCISAC_OK);
  REQUIRE(ocisac_push(receiver, &turned) == OCISAC_OK);
  auto result = fresh(ocisac_result_init);
  REQUIRE(ocisac_poll(receiver, &result) == OCISAC_OK);
  CHECK(result.frequency == doctest::Approx(left.frequency).epsilon(0.01));
  CHECK(result.region.x == left.box.x);
  CHECK(result.region.height == left.box.height);
  ocisac_destroy(receiver);
  options.scan_axis = 4;
  check_refused(ocisac_create(&options, &receiver), "scan_axis: got 4, allowed: 0 to 3");
}

TEST_CASE("C: the row time from a lamp of known frequency") {
  auto options = fresh(ocisac_options_init);  // without a row time
  const auto pixels = picture<std::uint8_t>();
  const ocisac_frame frame{pixels.data(), OCISAC_GRAY8, kColumns, kRows, kColumns, 0};
  auto calibration = fresh(ocisac_calibration_init);
  REQUIRE(ocisac_calibrate(&options, &frame, 900, &calibration) == OCISAC_OK);
  CHECK(calibration.row_time == doctest::Approx(20e-6).epsilon(1e-4));
  CHECK(calibration.row_time_std > 0);
  CHECK(calibration.row_time_std < 2e-9);
  check_refused(ocisac_calibrate(&options, &frame, -1, &calibration), "frequency: got -1");
  options.tone_curve = 3;
  check_refused(ocisac_calibrate(&options, &frame, 900, &calibration), "tone_curve: got 3");
  CHECK(std::string(ocisac_flag_name(1)) == "saturated");
  CHECK(ocisac_flag_name(3) == nullptr);
}

TEST_CASE("C: the tone of a picture and its spectrum") {
  ocisac_options options = packet_options();
  options.frequency = std::nan("");
  options.exposure = 200e-6;
  const auto pixels = picture<std::uint8_t>();
  const ocisac_frame frame{pixels.data(), OCISAC_GRAY8, kColumns, kRows, kColumns, 0};
  auto tone = fresh(ocisac_tone_init);
  REQUIRE(ocisac_find_frequency(&options, &frame, &tone) == OCISAC_OK);
  CHECK(tone.frequency == doctest::Approx(900).epsilon(1e-3));
  CHECK(tone.gain == doctest::Approx(0.8).epsilon(1e-3));
  CHECK(tone.columns == kColumns);
  const double cycles = 900 * 200e-6 * std::numbers::pi;
  CHECK(tone.theory == doctest::Approx(std::sin(cycles) / cycles).epsilon(1e-4));
  REQUIRE(tone.rows == kRows);

  std::vector<double> column(kRows), amplitude(2 * kRows + 1), response(2 * kRows + 1);
  tone.column = column.data();
  tone.amplitude = amplitude.data();
  tone.response = response.data();
  REQUIRE(ocisac_find_frequency(&options, &frame, &tone) == OCISAC_OK);
  CHECK(column[0] == 180);
  const auto peak = std::max_element(amplitude.begin(), amplitude.end()) - amplitude.begin();
  CHECK(static_cast<double>(peak) * tone.step == doctest::Approx(900).epsilon(0.01));
  CHECK(amplitude[static_cast<std::size_t>(peak)] == doctest::Approx(0.8).epsilon(0.01));
  CHECK(response[static_cast<std::size_t>(peak)] == doctest::Approx(tone.theory).epsilon(0.01));

  const ocisac_tone found = tone;
  options.frequency = 900;  // a given one; in a part of the columns
  options.region = {3, 0, 5, kRows};
  REQUIRE(ocisac_find_frequency(&options, &frame, &tone) == OCISAC_OK);
  CHECK(tone.frequency == 900);
  CHECK(std::isnan(tone.frequency_std));
  CHECK(tone.columns == 5);
  CHECK(tone.gain == doctest::Approx(found.gain).epsilon(1e-3));
  options.region.height = 7;
  CHECK(ocisac_find_frequency(&options, &frame, &tone) == OCISAC_BAD_ARGUMENT);
  CHECK(std::string(ocisac_last_error()) == "rows: got 400, allowed: 7");
  CHECK(ocisac_find_frequency(&options, &frame, nullptr) == OCISAC_BAD_ARGUMENT);
  for (const double row_time : {0.0, std::numeric_limits<double>::quiet_NaN()}) {
    options.row_time = row_time;
    check_refused(ocisac_find_frequency(&options, &frame, &tone), "row_time: got ");
  }
}

TEST_CASE("C: the best exposure, alone and without bands of other lights") {
  auto request = fresh(ocisac_exposure_request_init);
  auto advice = fresh(ocisac_exposure_advice_init);
  CHECK(ocisac_advise_exposure(&request, nullptr, 0, &advice) == OCISAC_BAD_ARGUMENT);
  request.comm_frequency = 700;
  REQUIRE(ocisac_advise_exposure(&request, nullptr, 0, &advice) == OCISAC_OK);
  CHECK(advice.exposure == doctest::Approx(1.0 / 1400));
  CHECK(advice.gain == doctest::Approx(2 / std::numbers::pi));
  request.sense_frequency = 175;
  REQUIRE(ocisac_advise_exposure(&request, nullptr, 0, &advice) == OCISAC_OK);
  CHECK(advice.objective > 1 / (175 * std::numbers::pi));
  CHECK(std::isnan(advice.modulation));
  request.comm_weight = 5e-324, request.sense_weight = 0;
  check_refused(ocisac_advise_exposure(&request, nullptr, 0, &advice), "weights: got 5e-324");

  std::vector<ocisac_flicker> lights(2);
  for (auto& light : lights) ocisac_flicker_init(&light);
  lights[0].frequency = 100;
  lights[1].frequency = 120;
  ocisac_exposure_request_init(&request);
  REQUIRE(ocisac_advise_exposure(&request, lights.data(), 2, &advice) == OCISAC_OK);
  CHECK(advice.exposure == doctest::Approx(49.00374e-3).epsilon(1e-6));
  CHECK(advice.holds == 1);
  CHECK(advice.modulation <= 0.02);
  request.longest = 0.03;
  CHECK(ocisac_advise_exposure(&request, lights.data(), 2, &advice) == OCISAC_BAD_ARGUMENT);  // shortest: unknown
  request.shortest = 1e-3;
  REQUIRE(ocisac_advise_exposure(&request, lights.data(), 2, &advice) == OCISAC_OK);
  CHECK(advice.holds == 0);
  request.min_gain = 0.5;
  check_refused(ocisac_advise_exposure(&request, lights.data(), 2, &advice), "f_comm: got None");
  lights[0].size = 0;
  CHECK(ocisac_advise_exposure(&request, lights.data(), 2, &advice) == OCISAC_BAD_ARGUMENT);
  CHECK(ocisac_advise_exposure(&request, nullptr, 2, &advice) == OCISAC_BAD_ARGUMENT);
}

TEST_CASE("C: chips of a packet") {
  ocisac_options options = packet_options();
  options.block_bytes = 8;
  const std::vector<std::uint8_t> payload{'l', 'a', 'm', 'p'};
  ocisac::PacketFormat format;
  format.block_bytes = 8;
  std::string expected;
  for (const auto chip : ocisac::packet_chips(payload, format, 3)) expected += chip != 0 ? '1' : '0';
  std::size_t count = 0;
  REQUIRE(ocisac_packet_chips(&options, payload.data(), payload.size(), 3, nullptr, 0, &count) == OCISAC_OK);
  REQUIRE(count == expected.size());
  std::string chips(count, ' ');
  REQUIRE(ocisac_packet_chips(&options, payload.data(), payload.size(), 3, chips.data(), count, &count) == OCISAC_OK);
  CHECK(chips == expected);
  check_refused(ocisac_packet_chips(&options, payload.data(), 0, 3, nullptr, 0, &count), "payload: got 0 bytes");
  CHECK(ocisac_packet_chips(&options, payload.data(), 4, 256, nullptr, 0, &count) == OCISAC_BAD_ARGUMENT);
}
