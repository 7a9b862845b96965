#include "scenarios.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <new>
#include <numbers>
#include <stdexcept>

#include "ocisac/cleaning/light_share.hpp"
#include "ocisac/exposure/best_exposure.hpp"
#include "ocisac/light/integrate_exposure.hpp"
#include "ocisac/light/waveform.hpp"
#include "ocisac/lights/calibrate.hpp"
#include "ocisac/lights/detect_sources.hpp"
#include "ocisac/ocisac.h"
#include "ocisac/packets/fsk.hpp"
#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/receive.hpp"
#include "ocisac/receiver/receiver.hpp"
#include "ocisac/scene/render.hpp"
#include "ocisac/tones/equalize.hpp"
#include "ocisac/tones/find_frequency.hpp"
#include "ocisac/tones/tone_gain.hpp"
#include "ocisac/tones/varying_tone.hpp"

namespace ocisac::faults {

namespace {

constexpr std::size_t kRows = 160, kColumns = 8;
constexpr double kRowTime = 20e-6;
const Camera kCamera{.row_time = kRowTime, .exposure = 2 * kRowTime, .frame_time = {}, .tone_curve = {}};

template <class Value>
void append(std::string& answer, const Value& value) {
  answer.append(reinterpret_cast<const char*>(&value), sizeof value);
}

template <class Value>
std::string bytes_of(const std::vector<Value>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value)};
}

std::vector<std::uint8_t> picture_of(const std::vector<double>& rows) {
  std::vector<std::uint8_t> pixels;
  for (const double row : rows)
    for (std::size_t x = 0; x < kColumns; ++x)
      pixels.push_back(static_cast<std::uint8_t>(20 + 180 * row + static_cast<double>((pixels.size() * 7) % 5)));
  return pixels;
}

const std::vector<std::uint8_t>& tone_picture() {
  static const auto pixels = [] {
    std::vector<double> rows;
    for (std::size_t n = 0; n < kRows; ++n)
      rows.push_back(0.5 + 0.4 * std::cos(2 * std::numbers::pi * 1510 * kRowTime * static_cast<double>(n)));
    return picture_of(rows);
  }();
  return pixels;
}

// Frame `number` of a light that repeats a packet, 4 rows a chip.
std::vector<std::uint8_t> data_picture(std::size_t number) {
  const std::array<std::uint8_t, 2> payload{4, 2};
  static const auto chips = packet_chips(payload, {}, 7);
  std::vector<double> rows;
  for (std::size_t n = 0; n < kRows; ++n) rows.push_back(chips[(number * kRows + n) / 4 % chips.size()]);
  return picture_of(rows);
}

template <class T>
AnyFramesView view_of(const std::vector<T>& pixels) {
  return dense_view<const T>(pixels.data(), 1, kRows, kColumns);
}

AnyFramesView tone_view() { return view_of(tone_picture()); }

std::string gain(const ToneGainOptions& options) {
  const std::array tones{1510.0, 400.0};
  return bytes_of(tone_gain(tone_view(), kCamera, tones, options).gain);
}

std::string varying_gain() { return bytes_of(varying_tone_gain(tone_view(), kCamera, 1510).gain); }

std::string frequency() {
  std::string answer;
  append(answer, find_frequency(tone_view(), {}).frequency);
  append(answer, calibrate(tone_view(), 1510, {}).row_time);
  return answer;
}

std::string equalised(EqualizerMethod method) {
  std::vector<double> out(kRows * kColumns);
  EqualizerSettings settings;
  settings.method = method;
  equalize(tone_view(), kCamera, settings, dense_view(out.data(), 1, kRows, kColumns));
  return bytes_of(out);
}

std::string exposures() {
  const std::array frequencies{500.0, 350.0, 120.0}, weights{1.0, 1.0, 0.5};
  std::string answer;
  append(answer, best_exposure_exact(frequencies, weights, {}).exposure);
  std::array<double, 1> exposure{}, objective{};
  best_exposures(frequencies, weights, ExposureMethod::search, {}, 101, exposure, objective);
  append(answer, exposure[0]);
  return answer;
}

std::string integrated() {
  const Waveform light = (Tone{500} + Waveform(SquareWave{300})) * Waveform(Chips{{0, 1, 1, 0}, 1e4, 0, true});
  const std::vector<std::int64_t> rows{0, 1, 5, 9};
  std::vector<double> out(rows.size());
  integrate_exposure(light, kCamera, rows, 0, 0, out);
  return bytes_of(out);
}

std::string packets() {
  const std::vector<std::uint8_t> payload{3, 1, 4, 1, 5};
  PacketAssembler assembler({});
  std::vector<double> llr;
  for (const auto chip : packet_chips(payload, {}, 9)) llr.push_back(chip != 0 ? 9 : -9);
  const auto report = assembler.push(0, llr);
  return report.payload ? bytes_of(report.payload->bytes) : "none";
}

std::string received_bits() {
  const auto pixels = data_picture(0);
  const auto view = view_of(pixels);
  return receive({&view, 1}, kCamera, {.chip_rate = 12.5e3}).front().bits;
}

std::string lights() {
  std::string answer;
  for (const auto& light : detect_sources(tone_view(), kCamera)) append(answer, light.frequency);
  return answer;
}

std::string cleaned() {
  std::vector<double> light, variance(kRows * kColumns, 1.0), rows;
  for (const auto pixel : tone_picture()) light.push_back(pixel);
  for (std::size_t n = 0; n < kRows; ++n) rows.push_back(light[n * kColumns] / 110);
  return bytes_of(light_share({light, variance, 1, kRows, kColumns}, rows));
}

std::string rendered() {
  std::vector<float> table(kRows, 3.0F), frame(kRows * kColumns);
  const ScenePart part{{1, 0, 5, kRows}, 2.0F, nullptr, nullptr, 1, nullptr, table.data()};
  render_parts<float>({&part, 1}, {}, 0, 1, dense_view(frame.data(), 1, kRows, kColumns));
  return bytes_of(frame);
}

std::string stream() {
  ReceiverOptions options;
  options.light.data->chip_rate = 12.5e3;
  Receiver receiver(kCamera, options);
  std::string answer;
  for (std::size_t number = 0; number < 2; ++number) {
    const auto pixels = data_picture(number);
    const auto view = view_of(pixels);
    for (const auto& light : receiver.push({&view, 1}, static_cast<std::int64_t>(number)))
      if (light.received) answer += light.received->bits;
  }
  return answer;
}

// One demodulator for all threads.
std::string symbol() {
  static const FskDemodulator demodulator(kCamera, std::array{1510.0, 3000.0}, kRows);
  std::vector<double> rows;
  for (std::size_t n = 0; n < kRows; ++n) rows.push_back(tone_picture()[n * kColumns]);
  return bytes_of(demodulator.demodulate(rows).log_likelihoods);
}

void check_code(int code) {
  if (code == OCISAC_NO_MEMORY) throw std::bad_alloc();
  if (code != OCISAC_OK) throw std::runtime_error(ocisac_last_error());
}

struct Destroy {
  void operator()(ocisac_receiver* receiver) const { ocisac_destroy(receiver); }
};

// A receiver that failed is used again: it must take the next frame.
std::string c_interface() {
  ocisac_options options;
  ocisac_options_init(&options);
  options.row_time = kRowTime;
  options.exposure = 2 * kRowTime;  // one that is searched takes 15 times the allocations
  options.chip_rate = 12.5e3;
  options.frequency = 1000;
  options.region = {0, 0, kColumns, kRows};
  ocisac_receiver* made = nullptr;
  const int code = ocisac_create(&options, &made);
  const std::unique_ptr<ocisac_receiver, Destroy> receiver(made);
  if ((made == nullptr) != (code != OCISAC_OK)) throw std::logic_error("a code and a receiver, or neither");
  check_code(code);
  const auto pixels = data_picture(0);
  int pushed = OCISAC_OK;
  for (std::int64_t number = 0; number < 2; ++number) {
    const ocisac_frame frame{pixels.data(), OCISAC_GRAY8, kColumns, kRows, kColumns, number};
    if (pushed != OCISAC_OK && ocisac_push(receiver.get(), &frame) != OCISAC_OK)
      throw std::logic_error("not usable after a failure");
    if (pushed == OCISAC_OK) pushed = ocisac_push(receiver.get(), &frame);
  }
  check_code(pushed);
  ocisac_result result;
  ocisac_result_init(&result);
  check_code(ocisac_poll(receiver.get(), &result));
  return result.bits;
}

struct DestroyCleaner {
  void operator()(ocisac_cleaner* cleaner) const { ocisac_cleaner_destroy(cleaner); }
};

// A cleaner that failed leaves the pixels, and takes the next frame.
std::string c_cleaner() {
  ocisac_cleaner_options options;
  ocisac_cleaner_options_init(&options);
  options.row_time = kRowTime;
  options.model = OCISAC_MODEL_ROWS;  // others take more allocations
  ocisac_cleaner* made = nullptr;
  const int code = ocisac_cleaner_create(&options, &made);
  const std::unique_ptr<ocisac_cleaner, DestroyCleaner> cleaner(made);
  if ((made == nullptr) != (code != OCISAC_OK)) throw std::logic_error("a code and a cleaner, or neither");
  check_code(code);
  std::vector<std::uint8_t> pixels = tone_picture();
  const ocisac_plane plane{pixels.data(), OCISAC_GRAY8, kColumns, kRows, kColumns, 1};
  const int pushed = ocisac_cleaner_push(cleaner.get(), &plane, 1, nullptr);
  if (pushed != OCISAC_OK && pixels != tone_picture()) throw std::logic_error("pixels changed by a failure");
  check_code(pushed);
  return bytes_of(pixels);
}

// The calls without a receiver.
std::string c_answers() {
  ocisac_options options;
  ocisac_options_init(&options);
  options.row_time = kRowTime;
  const auto& pixels = tone_picture();
  const ocisac_frame frame{pixels.data(), OCISAC_GRAY8, kColumns, kRows, kColumns, 0};
  std::vector<double> amplitude(2 * kRows + 1);
  ocisac_tone tone;
  ocisac_tone_init(&tone);
  tone.amplitude = amplitude.data();
  tone.rows = kRows;
  check_code(ocisac_find_frequency(&options, &frame, &tone));
  ocisac_exposure_request request;
  ocisac_exposure_request_init(&request);
  ocisac_flicker light;
  ocisac_flicker_init(&light);
  light.frequency = tone.frequency;
  ocisac_exposure_advice advice;
  ocisac_exposure_advice_init(&advice);
  check_code(ocisac_advise_exposure(&request, &light, 1, &advice));
  std::string answer = bytes_of(amplitude);
  append(answer, tone.gain);
  append(answer, advice.exposure);
  std::array<char, 64> chips{};
  std::size_t count = 0;
  const std::uint8_t payload = 7;
  check_code(ocisac_packet_chips(&options, &payload, 1, 0, chips.data(), chips.size(), &count));
  return answer.append(chips.data(), chips.size());
}

}  // namespace

const std::vector<Scenario>& scenarios() {
  static const std::vector<Scenario> all{
      {"tone_gain", [] { return gain({}); }},
      {"tone_gain, two threads", [] { return gain({.background = {}, .threads = 2}); }},
      {"tone_gain, dft", [] { return gain({.method = GainMethod::dft, .background = {}}); }},
      {"tone_gain, square wave", [] { return gain({.waveform = WaveformShape::square, .background = {}}); }},
      {"tone_gain, robust", [] { return gain({.background = {}, .robust = true}); }},
      {"varying_tone_gain", varying_gain},
      {"find_frequency, calibrate", frequency},
      {"equalize, inverse", [] { return equalised(EqualizerMethod::inverse); }},
      {"equalize, wiener", [] { return equalised(EqualizerMethod::wiener); }},
      {"best_exposure", exposures},
      {"integrate_exposure", integrated},
      {"packets", packets},
      {"receive", received_bits},
      {"detect_sources", lights},
      {"light_share", cleaned},
      {"render_parts", rendered},
      {"FskDemodulator", symbol},
      {"Receiver", stream},
      {"ocisac.h", c_interface},
      {"ocisac.h, one picture", c_answers},
      {"ocisac.h, cleaner", c_cleaner},
  };
  return all;
}

std::string stream_of_ten_frames() {
  std::string stream = "YUV4MPEG2 W" + std::to_string(kColumns) + " H" + std::to_string(kRows) + " F300:1 Cmono\n";
  for (std::size_t number = 0; number < 10; ++number) {
    const auto pixels = data_picture(number);
    stream += "FRAME\n";
    stream.append(pixels.begin(), pixels.end());
  }
  return stream;
}

}  // namespace ocisac::faults
