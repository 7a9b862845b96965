// ocisac.h: receivers are created with any options, get frames of any size, stride and type, are polled and destroyed.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <string_view>
#include <vector>

#include "fuzz.hpp"
#include "ocisac/ocisac.h"

using namespace ocisac;

namespace {

struct Destroy {
  void operator()(ocisac_receiver* receiver) const { ocisac_destroy(receiver); }
};
using Receiver = std::unique_ptr<ocisac_receiver, Destroy>;

double any_double(FuzzedDataProvider& bytes) {
  const auto bits = bytes.ConsumeIntegral<std::uint64_t>();
  double value = 0;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

// One of `usual`, mostly.
double number(FuzzedDataProvider& bytes, std::array<double, 4> usual) {
  return bytes.ConsumeIntegral<std::uint8_t>() < 240 ? bytes.PickValueInArray(usual) : any_double(bytes);
}

ocisac_options options_of(FuzzedDataProvider& bytes) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ocisac_options options;
  ocisac_options_init(&options);
  options.row_time = number(bytes, {20e-6, 20e-6, 10e-6, 1});
  // Seldom unknown: it is searched for eight lengths then.
  options.exposure = bytes.ConsumeIntegral<std::uint8_t>() < 8 ? nan : number(bytes, {60e-6, 40e-6, 200e-6, 0});
  options.frame_time = number(bytes, {nan, 1.0 / 30, 300 * 20e-6, 0});
  options.frequency = number(bytes, {nan, 900, 25e3, 1e9});
  options.chip_rate = number(bytes, {nan, 5000, 12.5e3, 1});
  options.sense_frequency = number(bytes, {nan, nan, 300, 0});
  options.dark_level = number(bytes, {0, 0, 16, 255});
  options.white_level = number(bytes, {0, 255, 235, 16});
  options.background = number(bytes, {0, 0, 5, 1e6});
  options.duty = number(bytes, {0.5, 0.5, 0.1, 1});
  options.waveform = bytes.ConsumeIntegralInRange<std::int32_t>(0, 2);
  options.line_code = bytes.ConsumeIntegralInRange<std::int32_t>(-1, 4);
  options.block_bytes = bytes.ConsumeBool() ? 16 : bytes.ConsumeIntegral<std::uint32_t>() % 300;
  options.lengthened = bytes.ConsumeBool();
  options.want_gain = bytes.ConsumeBool();
  options.want_data = bytes.ConsumeIntegral<std::uint8_t>() < 8;  // a search for chips takes longer than all else
  if (bytes.ConsumeBool())
    for (auto* value : {&options.region.x, &options.region.y, &options.region.width, &options.region.height})
      *value = bytes.ConsumeBool() ? bytes.ConsumeIntegral<std::uint8_t>() : bytes.ConsumeIntegral<std::uint32_t>();
  options.max_lights = bytes.ConsumeIntegralInRange<std::uint32_t>(0, 3);
  options.tone_curve = bytes.ConsumeIntegralInRange<std::int32_t>(0, 3);
  options.gamma = number(bytes, {2.2, 2.2, 1, 0});
  options.scan_axis = bytes.ConsumeIntegralInRange<std::int32_t>(-1, 3);
  if (bytes.ConsumeIntegral<std::uint8_t>() == 0) options.size = bytes.ConsumeIntegral<std::uint16_t>();
  return options;
}

// A picture in memory of its own that ends where its last pixel ends.
struct Picture {
  std::vector<std::uint8_t> memory;
  ocisac_frame frame{};
};

Picture picture_of(FuzzedDataProvider& bytes) {
  Picture picture;
  ocisac_frame& frame = picture.frame;
  frame.format = bytes.ConsumeIntegral<std::uint8_t>() % 16 == 0 ? 3 : bytes.ConsumeIntegralInRange(0, 2);
  frame.width = bytes.PickValueInArray({8U, 1U, 3U, 17U});
  frame.height = bytes.PickValueInArray({40U, 1U, 60U, 0U});
  const std::size_t pixel = frame.format == OCISAC_GRAY8 ? 1 : 2, row = pixel * frame.width;
  const auto added = bytes.ConsumeIntegralInRange<std::ptrdiff_t>(-2, 9);
  frame.stride = static_cast<std::ptrdiff_t>(row) + added;
  const auto distance = std::max(row, static_cast<std::size_t>(std::abs(frame.stride)));
  picture.memory.resize(frame.height > 0 ? (frame.height - 1) * distance + row : 0);
  // Chips, a square wave, noise, or constant light.
  const auto kind = bytes.ConsumeIntegral<std::uint8_t>() % 4;
  const std::uint8_t seed = bytes.ConsumeIntegral<std::uint8_t>();
  for (std::size_t k = 0; k < picture.memory.size(); ++k) {
    const std::size_t y = k / distance, noise = (k + seed) * 2654435761U >> 8 & 15U;
    const bool bright = kind == 0 ? (0x9A6C35E1U >> (y / 4 + seed) % 32 & 1U) != 0 : kind == 1 && y / 10 % 2 != 0;
    picture.memory[k] = static_cast<std::uint8_t>(kind == 2 ? noise * seed : noise / 4 + (bright ? 180U : 30U));
  }
  for (unsigned drawn = bytes.ConsumeIntegral<std::uint8_t>() % 8; drawn > 0 && !picture.memory.empty(); --drawn) {
    const auto at = bytes.ConsumeIntegralInRange<std::size_t>(0, picture.memory.size() - 1);
    picture.memory[at] = bytes.ConsumeIntegral<std::uint8_t>();
  }
  if (bytes.ConsumeBool()) frame.stride = -frame.stride;
  const bool upwards = frame.stride < 0;
  frame.pixels = picture.memory.data() + (upwards ? picture.memory.size() - std::min(row, picture.memory.size()) : 0);
  return picture;
}

// With a stamp, mostly of usual values.
int push(ocisac_receiver* receiver, const ocisac_frame& frame, FuzzedDataProvider& bytes) {
  if (bytes.ConsumeBool()) return ocisac_push(receiver, &frame);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ocisac_stamp stamp;
  ocisac_stamp_init(&stamp);
  const auto last = static_cast<double>(frame.number);
  stamp.time = number(bytes, {nan, last / 30, 0, -1});
  stamp.exposure = number(bytes, {nan, 40e-6, 50e-6, 1e-3});
  stamp.gain = number(bytes, {nan, 1, 0.5, 8});
  if (bytes.ConsumeIntegral<std::uint8_t>() == 1) stamp.size = bytes.ConsumeIntegral<std::uint16_t>();
  return ocisac_push_stamped(receiver, &frame, &stamp);
}

void poll(ocisac_receiver* receiver) {
  ocisac_result result;
  ocisac_result_init(&result);
  const int code = ocisac_poll(receiver, &result);
  fuzz::claim(code == OCISAC_OK || code == OCISAC_NOTHING || (receiver == nullptr && code == OCISAC_BAD_ARGUMENT));
  if (code != OCISAC_OK) return;
  fuzz::claim(std::strlen(result.bits) == result.bit_count);
  fuzz::claim(std::string_view(result.bits).find_first_not_of("01") == std::string_view::npos);
  fuzz::claim(result.payload == nullptr && result.payload_bytes == 0);  // none was sent
  fuzz::claim(std::isnan(result.gain_std) || result.gain_std >= 0);
}

// A code of the header, and a message with each that is bad.
void check_code(int code) {
  fuzz::claim(code == OCISAC_OK || code == OCISAC_BAD_ARGUMENT);
  if (code == OCISAC_BAD_ARGUMENT)
    fuzz::claim(std::string_view(ocisac_last_error()).find(": got ") != std::string_view::npos);
}

// Lights and row time of a picture on its own.
void ask(const ocisac_options& options, const ocisac_frame& frame, FuzzedDataProvider& bytes) {
  std::array<ocisac_light, 2> lights;
  for (auto& light : lights) ocisac_light_init(&light);
  std::size_t found = 0;
  const int code = ocisac_detect(&options, &frame, lights.data(), lights.size(), &found);
  check_code(code);
  if (code == OCISAC_OK && found > 0) {
    const ocisac_region& box = lights[0].box;
    fuzz::claim(std::uint64_t{box.x} + box.width <= frame.width && std::uint64_t{box.y} + box.height <= frame.height);
    fuzz::claim(lights[0].probability >= 0 && lights[0].probability <= 1);
  }
  ocisac_calibration calibration;
  ocisac_calibration_init(&calibration);
  check_code(ocisac_calibrate(&options, &frame, number(bytes, {900, 900, 50, 1e4}), &calibration));
}

// The tone of a picture, with places for as many rows as it has, or others.
void fit(const ocisac_options& options, const ocisac_frame& frame, FuzzedDataProvider& bytes) {
  ocisac_tone tone;
  ocisac_tone_init(&tone);
  std::vector<double> column(64), amplitude(129), response(129);
  tone.rows = bytes.ConsumeBool() ? frame.height : bytes.ConsumeIntegralInRange<std::size_t>(0, 64);
  if (bytes.ConsumeBool()) tone.column = column.data();
  if (bytes.ConsumeBool()) tone.amplitude = amplitude.data();
  if (bytes.ConsumeBool()) tone.response = response.data();
  const int code = ocisac_find_frequency(&options, &frame, &tone);
  check_code(code);
  if (code == OCISAC_OK) fuzz::claim(tone.columns <= std::max(frame.width, frame.height) && tone.rows <= 64);
}

// Lights of a few hundred Hz, mostly; exposures of a few milliseconds, so that a request takes no minutes.
void advise(FuzzedDataProvider& bytes) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ocisac_exposure_request request;
  ocisac_exposure_request_init(&request);
  request.comm_frequency = number(bytes, {nan, 700, 50, 0});
  request.sense_frequency = number(bytes, {nan, nan, 175, 1e6});
  request.comm_weight = number(bytes, {1, 1, 0, -1});
  request.shortest = number(bytes, {nan, 0, 1e-4, 2e-3});
  request.longest = number(bytes, {nan, 2e-3, 1e-2, 0});
  request.step = number(bytes, {nan, nan, 1e-4, 0});
  request.below = number(bytes, {0.02, 0.02, 0.1, 1});
  request.near = number(bytes, {nan, nan, 5e-3, 0});
  request.min_gain = number(bytes, {nan, nan, 0.5, 1});
  std::array<ocisac_flicker, 2> lights;
  for (auto& light : lights) {
    ocisac_flicker_init(&light);
    light.frequency = number(bytes, {100, 120, 90, 0});
    light.uncertainty = number(bytes, {0, 0, 1, 200});
    light.duty = number(bytes, {nan, nan, 0.1, 1});
    light.depth = number(bytes, {1, 1, 0.01, 0});
  }
  ocisac_exposure_advice advice;
  ocisac_exposure_advice_init(&advice);
  const int code =
      ocisac_advise_exposure(&request, lights.data(), bytes.ConsumeIntegralInRange<std::size_t>(0, 2), &advice);
  check_code(code);
  if (code == OCISAC_OK) fuzz::claim(advice.exposure > 0 && std::isfinite(advice.exposure));
}

void encode(const ocisac_options& options, FuzzedDataProvider& bytes) {
  const auto payload = bytes.ConsumeBytes<std::uint8_t>(bytes.ConsumeIntegral<std::uint8_t>());
  std::array<char, 100> chips{};
  std::size_t count = 0;
  const int code =
      ocisac_packet_chips(&options, payload.data(), payload.size(), bytes.ConsumeIntegralInRange<std::uint32_t>(0, 256),
                          chips.data(), chips.size(), &count);
  check_code(code);
  fuzz::claim((code == OCISAC_OK) == (count > 0));
}

// A cleaner of one or two frames in memory of their own.
void clean(FuzzedDataProvider& bytes) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ocisac_cleaner_options options;
  ocisac_cleaner_options_init(&options);
  options.row_time = number(bytes, {20e-6, 20e-6, 10e-6, 1});
  options.frame_time = number(bytes, {nan, nan, 1.0 / 30, 0});
  options.noise = number(bytes, {nan, nan, 1, 0});
  options.toe = number(bytes, {nan, 0, 0.1, 2});
  options.max_gain = number(bytes, {8, 8, 2, 1});
  options.dark_level = number(bytes, {0, 0, 16, 255});
  options.white_level = number(bytes, {0, 255, 235, 16});
  options.gamma = number(bytes, {2.2, 2.2, 1, 0});
  options.tone_curve = bytes.ConsumeIntegralInRange<std::int32_t>(0, 3);
  options.scan_axis = bytes.ConsumeIntegralInRange<std::int32_t>(-1, 3);
  options.model = bytes.ConsumeIntegralInRange<std::int32_t>(0, 4);
  options.mean_level = bytes.ConsumeBool();
  ocisac_cleaner* made = nullptr;
  const int code = ocisac_cleaner_create(&options, &made);
  check_code(code);
  fuzz::claim((made != nullptr) == (code == OCISAC_OK));
  const std::unique_ptr<ocisac_cleaner, void (*)(ocisac_cleaner*)> cleaner(made, ocisac_cleaner_destroy);
  for (int frame = 0; frame < 2; ++frame) {
    Picture picture = picture_of(bytes);
    const auto pixel = static_cast<std::ptrdiff_t>(picture.frame.format == OCISAC_GRAY8 ? 1 : 2);
    const ocisac_plane plane{const_cast<void*>(picture.frame.pixels),
                             picture.frame.format,
                             picture.frame.width,
                             picture.frame.height,
                             picture.frame.stride,
                             pixel};
    ocisac_cleaned cleaned;
    ocisac_cleaned_init(&cleaned);
    const int pushed = ocisac_cleaner_push(cleaner.get(), &plane, 1, &cleaned);
    check_code(pushed);
    if (pushed == OCISAC_OK) fuzz::claim(cleaned.unchanged != nullptr && cleaned.light_left >= 0);
  }
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzedDataProvider bytes(data, size);
  std::array<Receiver, 2> receivers;
  for (int calls = 0; calls < 6 && bytes.remaining_bytes() > 0; ++calls) {
    auto& receiver = receivers[bytes.ConsumeBool() ? 1 : 0];
    if (!receiver || bytes.ConsumeIntegral<std::uint8_t>() < 16) {
      const ocisac_options options = options_of(bytes);
      ocisac_receiver* made = nullptr;
      const int code = ocisac_create(&options, &made);
      check_code(code);
      fuzz::claim((made != nullptr) == (code == OCISAC_OK));
      receiver.reset(made);
      continue;
    }
    Picture picture = picture_of(bytes);
    if (bytes.ConsumeIntegral<std::uint8_t>() < 8) ask(options_of(bytes), picture.frame, bytes);
    if (bytes.ConsumeIntegral<std::uint8_t>() < 8) fit(options_of(bytes), picture.frame, bytes);
    if (bytes.ConsumeIntegral<std::uint8_t>() < 8) advise(bytes);
    if (bytes.ConsumeIntegral<std::uint8_t>() < 8) encode(options_of(bytes), bytes);
    if (bytes.ConsumeIntegral<std::uint8_t>() < 8) clean(bytes);
    picture.frame.number = bytes.ConsumeBool() ? calls : bytes.ConsumeIntegral<std::int64_t>();
    check_code(push(receiver.get(), picture.frame, bytes));
    picture = {};  // freed before the result is read
    if (bytes.ConsumeBool()) poll(receiver.get());
  }
  return 0;
}
