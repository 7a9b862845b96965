#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "ocisac/core/require.hpp"
#include "ocisac/core/version.hpp"
#include "ocisac/ocisac.h"
#include "ocisac/receiver/receiver.hpp"

struct ocisac_receiver {
  ocisac::Receiver receiver;
  double row_time;
  std::vector<ocisac::Region> regions;  // the given one, or empty
  ocisac::LightFrame latest{};
  bool polled = true;
  std::optional<std::array<std::int64_t, 3>> kind{};  // width, height and format of the first frame
};

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

thread_local std::array<char, 256> last_error{};

void remember(const char* message) {
  const std::size_t length = std::min(std::strlen(message), last_error.size() - 1);
  std::copy_n(message, length, last_error.begin());
  last_error[length] = '\0';
}

// Runs the body and converts exceptions to error codes.
template <class Body>
int guarded(Body body) noexcept {
  try {
    return body();
  } catch (const std::invalid_argument& problem) {
    remember(problem.what());
    return OCISAC_BAD_ARGUMENT;
  } catch (const std::bad_alloc&) {
    remember("out of memory");
    return OCISAC_NO_MEMORY;
  } catch (const std::exception& problem) {
    remember(problem.what());
    return OCISAC_FAILED;
  }
}

// The fields known to the calling program; defaults for the others.
template <class Struct>
Struct completed(const Struct* given, Struct defaults, const char* name) {
  ocisac::require(given != nullptr, name, "NULL", "a struct");
  ocisac::require(given->size >= sizeof(std::size_t) && given->size <= 4096, name, given->size,
                  "the size that its _init function fills in");
  std::memcpy(&defaults, given, std::min(given->size, sizeof(Struct)));
  return defaults;
}

std::optional<double> known(double value) { return std::isnan(value) ? std::nullopt : std::optional(value); }

ocisac::Camera camera_of(const ocisac_options& options) {
  ocisac::Camera camera{options.row_time, known(options.exposure), known(options.frame_time), {}};
  camera.tone_curve.dark_level = options.dark_level;
  camera.tone_curve.white_level = options.white_level;
  return camera;
}

const char* line_code_name(std::int32_t code) {
  constexpr std::array<const char*, 4> names{"none", "manchester", "4b6b", "8b10b"};
  ocisac::require(code >= 0 && code < static_cast<std::int32_t>(names.size()), "line_code", code, "0 to 3");
  return names[static_cast<std::size_t>(code)];
}

// Options that receive the strongest light only.
ocisac::ReceiverOptions receiver_options(const ocisac_options& options) {
  ocisac::ReceiverOptions result{.light = {}, .regions = {}, .max_sources = 1};
  ocisac::require(options.waveform == OCISAC_TONE || options.waveform == OCISAC_SQUARE, "waveform", options.waveform,
                  "OCISAC_TONE or OCISAC_SQUARE");
  const auto shape = options.waveform == OCISAC_SQUARE ? ocisac::WaveformShape::square : ocisac::WaveformShape::tone;
  if (options.want_gain != 0) result.light.gain = {known(options.frequency), shape, options.duty, options.background};
  ocisac::ChipOptions data{known(options.chip_rate)};
  data.format.line_code = ocisac::LineCode::named(line_code_name(options.line_code));
  data.format.block_bytes = options.block_bytes;
  if (options.lengthened != 0) data.format.preamble = ocisac::Preamble::lengthened;
  result.light.data = options.want_data != 0 ? std::optional(data) : std::nullopt;
  result.light.sense_frequency = known(options.sense_frequency);
  const ocisac_region& region = options.region;
  if (region.width > 0) result.regions = {{region.x, region.y, region.width, region.height}};
  return result;
}

template <class T>
ocisac::AnyFramesView view_of(const ocisac_frame& frame) {
  constexpr auto bytes = static_cast<std::ptrdiff_t>(sizeof(T));
  const auto row = bytes * static_cast<std::ptrdiff_t>(frame.width);
  ocisac::require(frame.stride % bytes == 0 && (frame.stride >= row || frame.stride <= -row), "stride", frame.stride,
                  "whole pixels, at least a row of them");
  return ocisac::FramesView<const T>{
      static_cast<const T*>(frame.pixels), 1, frame.height, frame.width, 0, frame.stride / bytes, 1};
}

ocisac::AnyFramesView any_view_of(const ocisac_frame& frame) {
  ocisac::require(frame.pixels != nullptr && frame.width > 0 && frame.height > 0, "frame", "no pixels",
                  "at least one pixel");
  ocisac::require(frame.format == OCISAC_GRAY8 || frame.format == OCISAC_GRAY16, "format", frame.format,
                  "OCISAC_GRAY8 or OCISAC_GRAY16");
  return frame.format == OCISAC_GRAY8 ? view_of<std::uint8_t>(frame) : view_of<std::uint16_t>(frame);
}

ocisac_result empty_result() {
  ocisac_result result{};
  result.size = sizeof result;
  for (double* value : {&result.frequency, &result.gain, &result.gain_std, &result.gain_snr, &result.chip_rate,
                        &result.data_snr, &result.error_rate, &result.suggested_exposure})
    *value = kNaN;
  result.bits = "";
  return result;
}

ocisac_result result_of(const ocisac::LightFrame& frame, double row_time) {
  ocisac_result result = empty_result();
  result.frame = frame.frame;
  const auto narrow = [](std::size_t value) { return static_cast<std::uint32_t>(value); };
  result.region = {narrow(frame.region.x), narrow(frame.region.y), narrow(frame.region.width),
                   narrow(frame.region.height)};
  result.searched = frame.searched ? 1 : 0;
  if (frame.gain) {
    result.gain_flags = frame.gain->flags;
    result.frequency = frame.gain->frequency;
    result.gain = frame.gain->gain;
    result.gain_std = frame.gain->gain_std;
    result.gain_snr = frame.gain->snr;
  }
  if (frame.received) {
    result.data_flags = frame.received->flags;
    result.chip_rate = 1 / (frame.received->rows_per_chip * row_time);
    result.data_snr = frame.received->snr;
    result.error_rate = frame.received->error_rate;
    result.bits = frame.received->bits.c_str();
    result.bit_count = frame.received->bits.size();
    if (frame.received->stretch && frame.received->stretch->payload) {
      const ocisac::Payload& payload = *frame.received->stretch->payload;
      result.payload = payload.bytes.data();
      result.payload_bytes = payload.bytes.size();
      result.packet = payload.number;
    }
  }
  if (frame.suggestion) result.suggested_exposure = frame.suggestion->exposure;
  return result;
}

ocisac_stamp default_stamp() { return {sizeof(ocisac_stamp), kNaN, kNaN, kNaN}; }

ocisac_options default_options() {
  ocisac_options options{};
  options.size = sizeof options;
  for (double* value :
       {&options.exposure, &options.frame_time, &options.frequency, &options.chip_rate, &options.sense_frequency})
    *value = kNaN;
  options.duty = 0.5;
  options.line_code = OCISAC_MANCHESTER;
  options.block_bytes = 16;
  options.want_gain = options.want_data = 1;
  return options;
}

}  // namespace

extern "C" {

void ocisac_options_init(ocisac_options* options) {
  if (options != nullptr) *options = default_options();
}

void ocisac_stamp_init(ocisac_stamp* stamp) {
  if (stamp != nullptr) *stamp = default_stamp();
}

void ocisac_result_init(ocisac_result* result) {
  if (result != nullptr) *result = empty_result();
}

int ocisac_create(const ocisac_options* options, ocisac_receiver** receiver) {
  return guarded([&] {
    ocisac::require(receiver != nullptr, "receiver", "NULL", "a place for it");
    *receiver = nullptr;
    const ocisac_options all = completed(options, default_options(), "options");
    const auto wanted = receiver_options(all);
    *receiver = new ocisac_receiver{ocisac::Receiver(camera_of(all), wanted), all.row_time, wanted.regions};
    return static_cast<int>(OCISAC_OK);
  });
}

int ocisac_push(ocisac_receiver* receiver, const ocisac_frame* frame) {
  ocisac_stamp stamp;
  ocisac_stamp_init(&stamp);
  return ocisac_push_stamped(receiver, frame, &stamp);
}

int ocisac_push_stamped(ocisac_receiver* receiver, const ocisac_frame* frame, const ocisac_stamp* stamp) {
  return guarded([&] {
    ocisac::require(receiver != nullptr && frame != nullptr, "receiver or frame", "NULL", "both");
    receiver->polled = true;
    const auto view = any_view_of(*frame);
    const std::array<std::int64_t, 3> kind{frame->width, frame->height, frame->format};
    ocisac::require(receiver->kind.value_or(kind) == kind, "frame",
                    std::to_string(frame->width) + "x" + std::to_string(frame->height),
                    "one picture as large as the first, of its type");
    for (const auto& region : receiver->regions) ocisac::require_inside("region", region, frame->width, frame->height);
    const ocisac_stamp all = completed(stamp, default_stamp(), "stamp");
    receiver->kind = kind;
    const ocisac::FrameStamp stated{frame->number, known(all.time), known(all.exposure), known(all.gain)};
    receiver->latest = std::move(receiver->receiver.push({&view, 1}, stated).front());
    receiver->polled = false;
    return static_cast<int>(OCISAC_OK);
  });
}

int ocisac_poll(ocisac_receiver* receiver, ocisac_result* result) {
  return guarded([&] {
    ocisac::require(receiver != nullptr && result != nullptr, "receiver or result", "NULL", "both");
    ocisac::require(result->size >= sizeof(std::size_t) && result->size <= 4096, "result", result->size,
                    "the size that ocisac_result_init fills in");
    if (receiver->polled) return static_cast<int>(OCISAC_NOTHING);
    const std::size_t size = std::min(result->size, sizeof(ocisac_result));
    ocisac_result full = result_of(receiver->latest, receiver->row_time);
    full.size = result->size;
    std::memcpy(result, &full, size);
    receiver->polled = true;
    return static_cast<int>(OCISAC_OK);
  });
}

void ocisac_destroy(ocisac_receiver* receiver) { delete receiver; }

const char* ocisac_last_error(void) { return last_error.data(); }

const char* ocisac_version(void) { return ocisac::version(); }

}  // extern "C"
