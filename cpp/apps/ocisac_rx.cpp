// ocisac-rx: raw grey frames in, one JSON object a frame out: the gain of a tone and the bits of a source.
#include <CLI/CLI.hpp>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ocisac/camera/linear_light.hpp"
#include "ocisac/estimation/find_frequency.hpp"
#include "ocisac/estimation/tone_gain.hpp"
#include "ocisac/receiver/receive.hpp"
#include "ocisac/require.hpp"
#include "ocisac/version.hpp"

namespace {

using Json = nlohmann::ordered_json;

static_assert(std::endian::native == std::endian::little, "gray16le is read as it lies in memory");

constexpr std::size_t kLargestFrame = std::size_t{1} << 30;  // bytes

struct Size {
  std::size_t width = 0, height = 0;
};

enum class Format { gray8, gray16le };

struct Settings {
  std::string input = "-";
  Size size;
  Format format = Format::gray8;
  double row_time = 0;
  std::optional<double> exposure, frequency, chip_rate;
  ocisac::WaveformShape waveform = ocisac::WaveformShape::tone;
  double background = 0;
  double dark_level = 0;
  bool no_bits = false;
};

Size parse_size(const std::string& text) {
  unsigned long width = 0;
  unsigned long height = 0;
  char rest = 0;
  const bool two_numbers = std::sscanf(text.c_str(), "%5lux%5lu%c", &width, &height, &rest) == 2;
  ocisac::require(two_numbers && width > 0 && height > 0, "--size", text, "WIDTHxHEIGHT in pixels, each 1 to 99999");
  return {width, height};
}

std::size_t frame_bytes(const Settings& settings) {
  const std::size_t bytes = settings.size.width * settings.size.height * (settings.format == Format::gray8 ? 1 : 2);
  ocisac::require(bytes <= kLargestFrame, "--size", bytes, "frames of at most 2^30 bytes");
  return bytes;
}

ocisac::AnyFramesView view_of(const std::vector<std::uint8_t>& frame, const Settings& settings) {
  const auto [width, height] = settings.size;
  if (settings.format == Format::gray8) return ocisac::dense_view(frame.data(), 1, height, width);
  return ocisac::dense_view(reinterpret_cast<const std::uint16_t*>(frame.data()), 1, height, width);
}

// JSON has no NaN: unknown is null.
Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }
double decibels(double ratio) { return ratio > 0 ? 10 * std::log10(ratio) : std::nan(""); }

// Gain of the tone, whose frequency is searched where none is given.
Json gain_facts(const ocisac::AnyFramesView& view, const ocisac::Camera& camera, const Settings& settings) {
  double frequency = settings.frequency.value_or(std::nan(""));
  double frequency_std = std::nan("");
  ocisac::Flags flags = 0;
  if (!settings.frequency) {
    ocisac::FrequencySearch search;
    search.saturation = ocisac::saturation_level(view);
    const auto found = ocisac::find_frequency(view, search);
    frequency = found.frequency / camera.row_time;
    frequency_std = found.frequency_std / camera.row_time;
    flags = found.flags;
  }
  Json facts{{"frequency_hz", number(frequency)}, {"frequency_std_hz", number(frequency_std)}};
  ocisac::ToneGain gain;
  if (std::isfinite(frequency)) {
    ocisac::ToneGainOptions options;
    options.waveform = settings.waveform;
    options.background = {&settings.background, 1};
    gain = ocisac::pooled_tone_gain(view, camera, {&frequency, 1}, options);
    flags |= gain.flags[0];
  }
  const auto first = [](const std::vector<double>& values) { return values.empty() ? std::nan("") : values[0]; };
  facts["gain"] = number(first(gain.gain));
  facts["gain_std"] = number(first(gain.gain_std));
  facts["snr_db"] = number(decibels(first(gain.snr)));
  facts["flags"] = ocisac::flag_names(flags);
  return facts;
}

Json bit_facts(const ocisac::AnyFramesView& view, const ocisac::Camera& camera, const Settings& settings) {
  ocisac::ReceiveOptions options;
  options.chip_rate = settings.chip_rate;
  const auto received = ocisac::receive({&view, 1}, camera, options).front();
  return {{"bits", received.bits},
          {"rows_per_chip", number(received.rows_per_chip)},
          {"chip_rate_hz", number(1 / (received.rows_per_chip * camera.row_time))},
          {"snr_db", number(decibels(received.snr))},
          {"flags", ocisac::flag_names(received.flags)}};
}

// Reads frames until the input ends; a torn last frame is told and left out.
int run(const Settings& settings, std::istream& input) {
  const ocisac::Camera camera{
      settings.row_time, settings.exposure, {}, {ocisac::ToneCurve::Kind::linear, 1.0, settings.dark_level, 0}};
  check(camera);
  std::vector<std::uint8_t> frame(frame_bytes(settings));
  for (std::size_t count = 0;; ++count) {
    input.read(reinterpret_cast<char*>(frame.data()), static_cast<std::streamsize>(frame.size()));
    const auto bytes = static_cast<std::size_t>(input.gcount());
    if (bytes == 0) {
      if (count == 0) std::cerr << "ocisac-rx: no frames: the input is empty\n";
      return count == 0 ? 2 : 0;
    }
    if (bytes < frame.size()) {
      std::cerr << "ocisac-rx: frame " << count << " is torn: " << bytes << " of " << frame.size()
                << " bytes; left out\n";
      return count == 0 ? 2 : 0;
    }
    const auto view = view_of(frame, settings);
    Json line{{"frame", count}, {"gain", gain_facts(view, camera, settings)}};
    if (!settings.no_bits) line["received"] = bit_facts(view, camera, settings);
    std::cout << line.dump() << std::endl;  // flushed: a reader behind a pipe sees each frame at once
    if (!std::cout) return 0;               // the reader has gone
  }
}

const std::map<std::string, double> kTimeUnits{{"s", 1}, {"ms", 1e-3}, {"us", 1e-6}, {"ns", 1e-9}};
const std::map<std::string, double> kFrequencyUnits{{"Hz", 1}, {"kHz", 1e3}, {"MHz", 1e6}};

int main_or_throw(int argc, char** argv) {
  CLI::App app{"Gain and bits of a modulated light in raw grey frames from a rolling-shutter camera, as JSON lines."};
  Settings settings;
  std::string size;
  bool version = false;
  const auto with_unit = [](const auto& units) { return CLI::AsNumberWithUnit(units); };
  app.option_defaults()->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
  app.add_option("input", settings.input, "File or FIFO of raw frames; - is standard input")->capture_default_str();
  app.add_option("--size", size, "WIDTHxHEIGHT of a frame, pixels");
  app.add_option("--format", settings.format, "Samples: gray8 or gray16le")
      ->transform(
          CLI::Transformer(std::map<std::string, Format>{{"gray8", Format::gray8}, {"gray16le", Format::gray16le}}));
  app.add_option("--row-time", settings.row_time, "Time from row to row, such as 22.2us")
      ->transform(with_unit(kTimeUnits));
  app.add_option("--exposure", settings.exposure, "Exposure time, such as 622us")->transform(with_unit(kTimeUnits));
  app.add_option("--frequency", settings.frequency, "Of the tone, such as 500Hz; searched when not given")
      ->transform(with_unit(kFrequencyUnits));
  app.add_option("--chip-rate", settings.chip_rate, "Chips a second; searched when not given")
      ->transform(with_unit(kFrequencyUnits));
  app.add_option("--waveform", settings.waveform, "tone or square")
      ->transform(CLI::Transformer(std::map<std::string, ocisac::WaveformShape>{
          {"tone", ocisac::WaveformShape::tone}, {"square", ocisac::WaveformShape::square}}));
  app.add_option("--background", settings.background, "Light that is not the source's, DN above dark");
  app.add_option("--dark-level", settings.dark_level, "DN of no light");
  app.add_flag("--no-bits", settings.no_bits, "Gain only");
  app.add_flag("--version", version, "Version, commit and OpenCV");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help
    throw std::invalid_argument(error.what());
  }
  if (version) {
    std::cout << "ocisac-rx " << ocisac::version() << " (" << ocisac::commit() << "), OpenCV "
              << ocisac::opencv_version() << '\n';
    return 0;
  }
  ocisac::require(!size.empty(), "--size", "nothing", "WIDTHxHEIGHT in pixels");
  settings.size = parse_size(size);
  ocisac::require_positive("--row-time", settings.row_time);
  std::ios::sync_with_stdio(false);
  if (settings.input == "-") return run(settings, std::cin);
  std::ifstream file(settings.input, std::ios::binary);
  ocisac::require(file.is_open(), "input", settings.input, "a file that can be read, or -");
  return run(settings, file);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return main_or_throw(argc, argv);
  } catch (const std::exception& problem) {
    std::cerr << "ocisac-rx: " << problem.what() << '\n';
    return 2;
  }
}
