#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "device/c_common.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/core/scan_axis.hpp"
#include "ocisac/core/version.hpp"
#include "ocisac/exposure/flicker.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "ocisac/lights/calibrate.hpp"
#include "ocisac/lights/detect_sources.hpp"
#include "ocisac/ocisac.h"
#include "ocisac/receiver/receiver.hpp"
#include "ocisac/tones/tone_spectrum.hpp"

struct ocisac_receiver {
  ocisac::ReceiverOptions options;  // without regions, which depend on the size of the picture
  ocisac::Camera camera;
  ocisac::ScanAxis axis;
  std::optional<ocisac::Region> region;        // the given one, stored pixels
  std::optional<ocisac::Receiver> receiver{};  // from the first frame on
  std::array<std::int64_t, 3> kind{};          // width, height and format of the first frame
  std::vector<ocisac::LightFrame> latest{};    // of the last frame
  std::size_t polled = 0;                      // of them
};

namespace {

thread_local std::array<char, 256> last_error{};

}  // namespace

void ocisac::c::remember(const char* message) {
  const std::size_t length = std::min(std::strlen(message), last_error.size() - 1);
  std::copy_n(message, length, last_error.begin());
  last_error[length] = '\0';
}

namespace {

using namespace ocisac::c;

ocisac::Camera camera_of(const ocisac_options& options) {
  return {options.row_time, known(options.exposure), known(options.frame_time), tone_curve_of(options)};
}

const char* line_code_name(std::int32_t code) {
  return chosen("line_code", code, std::array{"none", "manchester", "4b6b", "8b10b"});
}

ocisac::WaveformShape waveform_of(const ocisac_options& options) {
  ocisac::require(options.waveform == OCISAC_TONE || options.waveform == OCISAC_SQUARE, "waveform", options.waveform,
                  "OCISAC_TONE or OCISAC_SQUARE");
  return options.waveform == OCISAC_SQUARE ? ocisac::WaveformShape::square : ocisac::WaveformShape::tone;
}

ocisac::PacketFormat packet_format(const ocisac_options& options) {
  ocisac::PacketFormat format;
  format.line_code = ocisac::LineCode::named(line_code_name(options.line_code));
  format.block_bytes = options.block_bytes;
  if (options.lengthened != 0) format.preamble = ocisac::Preamble::lengthened;
  return format;
}

ocisac::ReceiverOptions receiver_options(const ocisac_options& options) {
  ocisac::require(options.max_lights > 0, "max_lights", 0, "1 or above");
  ocisac::ReceiverOptions result{.light = {}, .regions = {}, .max_sources = options.max_lights};
  const auto shape = waveform_of(options);
  if (options.want_gain != 0) result.light.gain = {known(options.frequency), shape, options.duty, options.background};
  const ocisac::ChipOptions data{known(options.chip_rate), packet_format(options)};
  result.light.data = options.want_data != 0 ? std::optional(data) : std::nullopt;
  result.light.sense_frequency = known(options.sense_frequency);
  return result;
}

std::optional<ocisac::Region> given_region(const ocisac_options& options) {
  const ocisac_region& region = options.region;
  if (region.width == 0) return std::nullopt;
  return ocisac::Region{region.x, region.y, region.width, region.height};
}

template <class T>
ocisac::AnyFramesView view_of(const ocisac_frame& frame, std::ptrdiff_t pixel_stride = 1) {
  constexpr auto bytes = static_cast<std::ptrdiff_t>(sizeof(T));
  ocisac::require(frame.stride % bytes == 0, "stride", frame.stride, "whole pixels");
  require_rows(frame.stride, sizeof(T) * static_cast<std::size_t>(pixel_stride) * frame.width, frame.height);
  return ocisac::FramesView<const T>{
      static_cast<const T*>(frame.pixels), 1, frame.height, frame.width, 0, frame.stride / bytes, pixel_stride};
}

// The stored picture.
ocisac::AnyFramesView any_view_of(const ocisac_frame& frame) {
  ocisac::require(frame.pixels != nullptr && frame.width > 0 && frame.height > 0, "frame", "no pixels",
                  "at least one pixel");
  switch (frame.format) {
    case OCISAC_GRAY8: return view_of<std::uint8_t>(frame);
    case OCISAC_GRAY16: return view_of<std::uint16_t>(frame);
    case OCISAC_YUYV: return view_of<std::uint8_t>(frame, 2);
    default: ocisac::refuse("format", std::to_string(frame.format), "OCISAC_GRAY8, OCISAC_GRAY16 or OCISAC_YUYV");
  }
}

// The receiver of pictures of this size.
void start(ocisac_receiver& receiver, const ocisac_frame& frame, const std::array<std::int64_t, 3>& kind) {
  ocisac::ReceiverOptions options = receiver.options;
  if (receiver.region) {
    ocisac::require_inside("region", *receiver.region, frame.width, frame.height);
    options.regions = {ocisac::to_time_order(*receiver.region, receiver.axis, frame.width, frame.height)};
  }
  receiver.receiver.emplace(receiver.camera, options);
  receiver.kind = kind;
}

ocisac_result empty_result() {
  ocisac_result result{};
  result.size = sizeof result;
  for (double* value : {&result.frequency, &result.gain, &result.gain_std, &result.gain_snr, &result.chip_rate,
                        &result.data_snr, &result.error_rate, &result.suggested_exposure, &result.frequency_std,
                        &result.rows_per_chip, &result.exposure, &result.packet_share, &result.first_bit})
    *value = kNaN;
  result.bits = "";
  return result;
}

ocisac_region region_of(const ocisac::Region& region) {
  const auto narrow = [](std::size_t value) { return static_cast<std::uint32_t>(value); };
  return {narrow(region.x), narrow(region.y), narrow(region.width), narrow(region.height)};
}

// `row_time`: s; `region`: of the light, stored pixels.
ocisac_result result_of(const ocisac::LightFrame& frame, double row_time, const ocisac::Region& region) {
  ocisac_result result = empty_result();
  result.frame = frame.frame;
  result.source = static_cast<std::uint32_t>(frame.source);
  result.region = region_of(region);
  result.searched = frame.searched ? 1 : 0;
  if (frame.gain) {
    result.gain_flags = frame.gain->flags;
    result.frequency = frame.gain->frequency;
    result.frequency_std = frame.gain->frequency_std;
    result.gain = frame.gain->gain;
    result.gain_std = frame.gain->gain_std;
    result.gain_snr = frame.gain->snr;
  }
  if (frame.received) {
    result.data_flags = frame.received->flags;
    result.rows_per_chip = frame.received->rows_per_chip;
    result.chip_rate = 1 / (frame.received->rows_per_chip * row_time);
    result.first_bit = frame.received->phase;
    result.exposure = frame.received->exposure;
    result.data_snr = frame.received->snr;
    result.error_rate = frame.received->error_rate;
    result.bits = frame.received->bits.c_str();
    result.bit_count = frame.received->bits.size();
    if (frame.received->stretch) result.packet_share = frame.received->stretch->share;
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
  options.max_lights = 1;
  options.gamma = ocisac::ToneCurve{}.gamma;
  return options;
}

ocisac_light empty_light() {
  ocisac_light light{};
  light.size = sizeof light;
  light.reflection_of = -1;
  return light;
}

// `box`: stored pixels.
ocisac_light light_of(const ocisac::LightSource& source, const ocisac::Region& box) {
  ocisac_light light = empty_light();
  light.box = region_of(box);
  light.probability = source.probability;
  light.frequency = source.frequency;
  light.frequency_std = source.frequency_std;
  light.gain = source.gain;
  light.gain_std = source.gain_std;
  light.snr = source.snr;
  light.phase = source.phase;
  light.carries_data = source.carries_data ? 1 : 0;
  if (source.reflection_of) light.reflection_of = static_cast<std::int32_t>(*source.reflection_of);
  light.flags = source.flags;
  return light;
}

ocisac_tone empty_tone() {
  return {
      sizeof(ocisac_tone), nullptr, nullptr, nullptr, 0, kNaN, kNaN, kNaN, kNaN, kNaN, kNaN, kNaN, kNaN, kNaN, 0, 0};
}

// `all`: with the caller's places for arrays. `exposure`: s.
ocisac_tone tone_of(const ocisac::ToneSpectrum& found, ocisac_tone all, double row_time, double exposure) {
  const std::size_t rows = found.column.size();
  const bool wanted = all.column != nullptr || all.amplitude != nullptr || all.response != nullptr;
  ocisac::require(!wanted || all.rows == rows, "rows", all.rows, std::to_string(rows));
  all.rows = rows;
  all.step = 1 / (4 * static_cast<double>(rows) * row_time);
  if (all.column != nullptr) std::ranges::copy(found.column, all.column);
  if (all.amplitude != nullptr) std::ranges::copy(found.amplitude, all.amplitude);
  const auto response = [&](double frequency) { return std::abs(ocisac::sinc(frequency * exposure)); };
  for (std::size_t k = 0; all.response != nullptr && k < found.amplitude.size(); ++k)
    all.response[k] = response(static_cast<double>(k) * all.step);
  all.frequency = found.frequency;
  all.frequency_std = found.frequency_std;
  all.gain = found.gain;
  all.gain_std = found.gain_std;
  all.phase = found.phase;
  all.mean = found.mean;
  all.snr = found.snr;
  all.theory = response(found.frequency);
  all.columns = static_cast<std::uint32_t>(found.columns);
  all.flags = found.flags;
  return all;
}

ocisac_flicker default_flicker() { return {sizeof(ocisac_flicker), kNaN, 0, kNaN, 1}; }

ocisac_exposure_request default_request() {
  return {sizeof(ocisac_exposure_request),    kNaN, kNaN, 1, 1, kNaN, kNaN, kNaN,
          ocisac::FlickerFreeRequest{}.below, kNaN, kNaN};
}

ocisac_exposure_advice empty_advice() { return {sizeof(ocisac_exposure_advice), kNaN, kNaN, kNaN, kNaN, 0}; }

std::vector<ocisac::FlickeringLight> lights_of(const ocisac_flicker* lights, std::size_t count) {
  ocisac::require(lights != nullptr || count == 0, "lights", "NULL", "`count` lights");
  const std::size_t stride = count > 0 ? lights->size : 0;
  const auto* place = reinterpret_cast<const std::byte*>(lights);
  std::vector<ocisac::FlickeringLight> result;
  for (; result.size() < count; place += stride) {
    const ocisac_flicker light = completed(reinterpret_cast<const ocisac_flicker*>(place), default_flicker(), "lights");
    result.push_back({light.frequency, light.uncertainty, known(light.duty), light.depth});
  }
  return result;
}

std::optional<ocisac::Interval> bounds_of(const ocisac_exposure_request& request) {
  if (std::isnan(request.shortest) && std::isnan(request.longest)) return std::nullopt;
  return ocisac::Interval{request.shortest, request.longest};
}

// Communication and sensing alone.
ocisac_exposure_advice best_advice(const ocisac_exposure_request& request) {
  ocisac::require(std::isnan(request.near) && std::isnan(request.min_gain), "near or min_gain", "a number",
                  "NaN without lights to avoid");
  std::vector<double> frequencies, weights;
  for (const auto& [frequency, weight] : {std::pair(request.comm_frequency, request.comm_weight),
                                          std::pair(request.sense_frequency, request.sense_weight)})
    if (!std::isnan(frequency)) {
      frequencies.push_back(frequency);
      weights.push_back(weight);
    }
  ocisac::require(!frequencies.empty(), "request", "neither frequencies nor lights", "either");
  const auto best = ocisac::best_exposure_exact(frequencies, weights, {bounds_of(request), known(request.step)});
  ocisac_exposure_advice advice = empty_advice();
  advice.exposure = best.exposure;
  advice.objective = best.objective;
  advice.gain = std::abs(ocisac::sinc(request.comm_frequency * best.exposure));
  advice.holds = 1;
  return advice;
}

ocisac_exposure_advice advice_without_bands(const ocisac_exposure_request& request,
                                            const std::vector<ocisac::FlickeringLight>& lights) {
  ocisac::FlickerFreeRequest wanted{.below = request.below,
                                    .near = known(request.near),
                                    .step = known(request.step),
                                    .f_comm = known(request.comm_frequency),
                                    .f_sense = known(request.sense_frequency),
                                    .min_gain = known(request.min_gain),
                                    .comm_weight = request.comm_weight,
                                    .sense_weight = request.sense_weight};
  if (const auto bounds = bounds_of(request)) wanted.bounds = *bounds;
  const auto found = ocisac::flicker_free_exposure(lights, wanted);
  return {sizeof(ocisac_exposure_advice),
          found.exposure,
          found.objective,
          found.gain,
          found.modulation,
          found.holds ? 1 : 0};
}

}  // namespace

extern "C" {

void ocisac_options_init(ocisac_options* options) { fill(options, default_options()); }
void ocisac_stamp_init(ocisac_stamp* stamp) { fill(stamp, default_stamp()); }
void ocisac_result_init(ocisac_result* result) { fill(result, empty_result()); }
void ocisac_light_init(ocisac_light* light) { fill(light, empty_light()); }
void ocisac_calibration_init(ocisac_calibration* calibration) {
  fill(calibration, {sizeof(ocisac_calibration), kNaN, kNaN, 0});
}
void ocisac_tone_init(ocisac_tone* tone) { fill(tone, empty_tone()); }
void ocisac_flicker_init(ocisac_flicker* light) { fill(light, default_flicker()); }
void ocisac_exposure_request_init(ocisac_exposure_request* request) { fill(request, default_request()); }
void ocisac_exposure_advice_init(ocisac_exposure_advice* advice) { fill(advice, empty_advice()); }

int ocisac_create(const ocisac_options* options, ocisac_receiver** receiver) {
  return guarded([&] {
    ocisac::require(receiver != nullptr, "receiver", "NULL", "a place for it");
    *receiver = nullptr;
    const ocisac_options all = completed(options, default_options(), "options");
    const ocisac::Receiver checked(camera_of(all), receiver_options(all));
    *receiver = new ocisac_receiver{receiver_options(all), camera_of(all), scan_axis_of(all), given_region(all)};
  });
}

int ocisac_push(ocisac_receiver* receiver, const ocisac_frame* frame) {
  const ocisac_stamp stamp = default_stamp();
  return ocisac_push_stamped(receiver, frame, &stamp);
}

int ocisac_push_stamped(ocisac_receiver* receiver, const ocisac_frame* frame, const ocisac_stamp* stamp) {
  return guarded([&] {
    ocisac::require(receiver != nullptr && frame != nullptr, "receiver or frame", "NULL", "both");
    receiver->latest.clear();
    receiver->polled = 0;
    const auto view = any_view_of(*frame);
    const std::array<std::int64_t, 3> kind{frame->width, frame->height, frame->format};
    ocisac::require(!receiver->receiver || receiver->kind == kind, "frame",
                    std::to_string(frame->width) + "x" + std::to_string(frame->height),
                    "one picture as large as the first, of its type");
    const ocisac_stamp all = completed(stamp, default_stamp(), "stamp");
    if (!receiver->receiver) start(*receiver, *frame, kind);
    const ocisac::FrameStamp stated{frame->number, known(all.time), known(all.exposure), known(all.gain)};
    const auto in_time = ocisac::in_time_order(view, receiver->axis);
    receiver->latest = receiver->receiver->push({&in_time, 1}, stated);
  });
}

int ocisac_poll(ocisac_receiver* receiver, ocisac_result* result) {
  return guarded([&] {
    ocisac::require(receiver != nullptr && result != nullptr, "receiver or result", "NULL", "both");
    if (receiver->polled == receiver->latest.size()) return static_cast<int>(OCISAC_NOTHING);
    const ocisac::LightFrame& light = receiver->latest[receiver->polled];
    const auto [width, height, format] = receiver->kind;
    const auto region = ocisac::to_stored(light.region, receiver->axis, static_cast<std::size_t>(width),
                                          static_cast<std::size_t>(height));
    answer(result, result_of(light, receiver->camera.row_time, region), "result");
    ++receiver->polled;
    return static_cast<int>(OCISAC_OK);
  });
}

int ocisac_detect(const ocisac_options* options, const ocisac_frame* frame, ocisac_light* lights, size_t capacity,
                  size_t* found) {
  return guarded([&] {
    ocisac::require(frame != nullptr && found != nullptr, "frame or found", "NULL", "both");
    ocisac::require(lights != nullptr || capacity == 0, "lights", "NULL", "places for `capacity` lights");
    *found = 0;
    const ocisac_options all = completed(options, default_options(), "options");
    const ocisac::ScanAxis axis = scan_axis_of(all);
    const auto sources = ocisac::detect_sources(ocisac::in_time_order(any_view_of(*frame), axis), camera_of(all));
    const std::size_t stride = capacity > 0 ? lights->size : 0;
    auto* place = reinterpret_cast<std::byte*>(lights);
    for (std::size_t k = 0; k < std::min(capacity, sources.size()); ++k, place += stride)
      answer(reinterpret_cast<ocisac_light*>(place),
             light_of(sources[k], ocisac::to_stored(sources[k].box, axis, frame->width, frame->height)), "lights");
    *found = sources.size();
  });
}

int ocisac_calibrate(const ocisac_options* options, const ocisac_frame* frame, double frequency,
                     ocisac_calibration* calibration) {
  return guarded([&] {
    ocisac::require(frame != nullptr && calibration != nullptr, "frame or calibration", "NULL", "both");
    ocisac::require_positive("frequency", frequency);
    const ocisac_options all = completed(options, default_options(), "options");
    const auto view = ocisac::in_time_order(any_view_of(*frame), scan_axis_of(all));
    ocisac::FrequencySearch search;
    search.saturation = ocisac::saturation_level(view, tone_curve_of(all));
    const ocisac::Calibration found = ocisac::calibrate(view, frequency, search);
    answer(calibration, {sizeof(ocisac_calibration), found.row_time, found.row_time_std, found.found.flags},
           "calibration");
  });
}

int ocisac_find_frequency(const ocisac_options* options, const ocisac_frame* frame, ocisac_tone* tone) {
  return guarded([&] {
    ocisac::require(frame != nullptr && tone != nullptr, "frame or tone", "NULL", "both");
    const ocisac_options all = completed(options, default_options(), "options");
    const ocisac_tone places = completed(tone, empty_tone(), "tone");
    const ocisac::ScanAxis axis = scan_axis_of(all);
    auto view = ocisac::in_time_order(any_view_of(*frame), axis);
    if (const auto region = given_region(all)) {
      ocisac::require_inside("region", *region, frame->width, frame->height);
      view = part_of(view, ocisac::to_time_order(*region, axis, frame->width, frame->height));
    }
    const auto found =
        ocisac::tone_spectrum(view, camera_of(all), known(all.frequency),
                              {ocisac::GainMethod::fit, waveform_of(all), all.duty, {&all.background, 1}});
    answer(tone, tone_of(found, places, all.row_time, all.exposure), "tone");
  });
}

int ocisac_advise_exposure(const ocisac_exposure_request* request, const ocisac_flicker* lights, size_t count,
                           ocisac_exposure_advice* advice) {
  return guarded([&] {
    ocisac::require(advice != nullptr, "advice", "NULL", "a struct");
    const ocisac_exposure_request all = completed(request, default_request(), "request");
    const auto avoided = lights_of(lights, count);
    answer(advice, avoided.empty() ? best_advice(all) : advice_without_bands(all, avoided), "advice");
  });
}

int ocisac_packet_chips(const ocisac_options* options, const uint8_t* payload, size_t payload_bytes, uint32_t number,
                        char* chips, size_t capacity, size_t* count) {
  return guarded([&] {
    ocisac::require(payload != nullptr && count != nullptr, "payload or count", "NULL", "both");
    ocisac::require(chips != nullptr || capacity == 0, "chips", "NULL", "places for `capacity` chips");
    *count = 0;
    const ocisac_options all = completed(options, default_options(), "options");
    const auto sent = ocisac::packet_chips({payload, payload_bytes}, packet_format(all), number);
    for (std::size_t k = 0; k < std::min(capacity, sent.size()); ++k) chips[k] = sent[k] != 0 ? '1' : '0';
    *count = sent.size();
  });
}

const char* ocisac_flag_name(uint32_t bit) { return ocisac::flag_name(bit); }

void ocisac_destroy(ocisac_receiver* receiver) { delete receiver; }

const char* ocisac_last_error(void) { return last_error.data(); }

const char* ocisac_version(void) { return ocisac::version(); }

}  // extern "C"
