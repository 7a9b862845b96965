#include "settings.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "byte_input.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/core/version.hpp"
#include "ocisac/tones/projection.hpp"
#include "stream_header.hpp"

namespace ocisac::apps {

namespace {

constexpr double kMaxRowTime = 1;  // s; longer: a forgotten unit
const std::map<std::string, double> kTimeUnits{{"s", 1}, {"ms", 1e-3}, {"us", 1e-6}, {"ns", 1e-9}};
const std::map<std::string, double> kFrequencyUnits{{"Hz", 1}, {"kHz", 1e3}, {"MHz", 1e6}};

constexpr auto kFooter =
    R"(Frames may be lost: packets are joined by the frames' numbers, or by --timestamps, and a block that is lost is sent again.
Torn frames are left out and reported. A light that is lost is searched again; a gap is counted in frames_missing.

Exit codes: 0 the input ended, its reader went, or SIGINT or SIGTERM came; 1 reading or writing failed;
2 options or input without meaning; 3 --payload, and none came whole.)";

// Options as text, before they are combined.
struct Written {
  std::string size, format = "gray8", region, tone_curve = "linear", line_code = "manchester";
  std::optional<Delimiter> delimiter;
  ChipOptions data;
  GainOptions gain;
  std::size_t stride = 0;
  std::optional<double> row_time, frame_rate;
  bool lengthened = false, no_bits = false, no_gain = false, version = false;
};

// `count` whole numbers up to kMaxSide, separated by `separator`; empty for any other text.
std::vector<std::size_t> parse_pixels(std::string_view text, char separator, std::size_t count) {
  std::vector<std::size_t> numbers;
  for (bool more = true; more;) {
    const auto end = text.find(separator);
    const auto number = whole_number(text.substr(0, end));
    if (!number || *number > kMaxSide) return {};
    numbers.push_back(*number);
    more = end != text.npos;
    if (more) text.remove_prefix(end + 1);
  }
  return numbers.size() == count ? numbers : std::vector<std::size_t>{};
}

std::pair<std::size_t, std::size_t> parse_size(const std::string& text) {
  const auto n = parse_pixels(text, 'x', 2);
  require(!n.empty() && n[0] > 0 && n[1] > 0, "--size", text, "WIDTHxHEIGHT in pixels, each 1 to 99999");
  return {n[0], n[1]};
}

Region parse_region(const std::string& text) {
  const auto n = parse_pixels(text, ',', 4);
  require(!n.empty() && n[2] > 0 && n[3] > 0, "--region", text, "x,y,w,h in pixels, w and h above 0");
  return {n[0], n[1], n[2], n[3]};
}

ToneCurve parse_tone_curve(const std::string& text) {
  if (text == "linear") return {};
  if (text == "srgb") return {.kind = ToneCurve::Kind::srgb};
  if (text == "gamma") return {.kind = ToneCurve::Kind::gamma};
  double power = 0;
  char rest = 0;
  const bool written = std::sscanf(text.c_str(), "gamma:%lf%c", &power, &rest) == 1;
  require(written && std::isfinite(power) && power > 0, "--tone-curve", text, "linear, srgb, gamma or gamma:POWER");
  return {.kind = ToneCurve::Kind::gamma, .gamma = power};
}

// Without descriptions, which --help would show as the parser's own.
template <class Value>
CLI::Validator one_of(const std::map<std::string, Value>& values) {
  return CLI::Validator(CLI::CheckedTransformer(values, CLI::ignore_case)).description("");
}

CLI::Validator with_unit(const std::map<std::string, double>& units) {
  return CLI::Validator(CLI::AsNumberWithUnit(units)).description("");
}

// Names in any case; other texts stay as they are, for the message.
CLI::Validator any_case(std::vector<std::string_view> names) {
  return {[names](std::string& text) {
            const std::string lower = CLI::detail::to_lower(text);
            const auto begins = [&](std::string_view name) { return lower.starts_with(name); };
            if (std::any_of(names.begin(), names.end(), begins)) text = lower;
            return std::string{};
          },
          ""};
}

// A plain CLI11 integer would wrap a minus sign before a count.
CLI::Validator whole() {
  return {[](const std::string& text) {
            return whole_number(text) ? std::string{} : "got " + text + ", allowed: a whole number, 0 or above";
          },
          ""};
}

CLI::Validator named() {
  return {[](const std::string& path) { return path.empty() ? "got no name, allowed: that of a file" : std::string{}; },
          ""};
}

void add_input_options(CLI::App& app, Settings& settings, Written& written) {
  app.add_option("input", settings.input, "File or FIFO: raw frames, YUV4MPEG2 or PGM; - is standard input")
      ->type_name("FILE")
      ->capture_default_str();
  app.add_option("--size", written.size, "Of raw frames, pixels; required for them")->type_name("WIDTHxHEIGHT");
  app.add_option("--format", written.format, "Of raw frames: " + std::string(pixel_format_names()))
      ->type_name("NAME")
      ->transform(any_case({"gray", "yuv", "nv12", "yuyv"}))
      ->capture_default_str();
  app.add_option("--stride", written.stride, "Bytes from row to row of raw frames; dense when not given")
      ->type_name("BYTES")
      ->check(whole());
  app.add_option("--timestamps", settings.timestamps, "Times of raw frames, ms, one a line (rpicam-vid --save-pts)")
      ->type_name("FILE")
      ->check(named());
  app.add_option("--frames", settings.frames, "Stop after so many")->type_name("N")->check(whole());
  app.add_option("--region", written.region, "Box of the light in stored pixels; detected when not given")
      ->type_name("x,y,w,h");
  app.add_option("--scan-axis", settings.scan_axis,
                 "Direction in which rows are read out: y (down), -y (up), x (right) or -x (left)")
      ->type_name("y|-y|x|-x")
      ->transform(one_of<ScanAxis>(
          {{"y", ScanAxis::down}, {"-y", ScanAxis::up}, {"x", ScanAxis::right}, {"-x", ScanAxis::left}}));
}

void add_camera_options(CLI::App& app, Settings& settings, Written& written) {
  const auto time = with_unit(kTimeUnits);
  app.add_option("--row-time", written.row_time, "Time from one row to the next, such as 22.2us. Required")
      ->type_name("TIME")
      ->transform(time);
  app.add_option("--exposure", settings.camera.exposure, "Exposure time of a row, such as 622us")
      ->type_name("TIME")
      ->transform(time);
  app.add_option("--frame-rate", written.frame_rate,
                 "Frame rate; joins packets over frames; YUV4MPEG2 states it itself")
      ->type_name("HZ")
      ->transform(with_unit(kFrequencyUnits));
  app.add_option("--tone-curve", written.tone_curve, "Tone curve: linear, srgb, gamma or gamma:POWER")
      ->type_name("CURVE")
      ->transform(any_case({"linear", "srgb", "gamma"}))
      ->capture_default_str();
  app.add_option("--dark-level", settings.dark_level, "Stored value of no light")->type_name("DN");
  app.add_option("--white-level", settings.white_level, "Stored value of full light")->type_name("DN");
}

void add_light_options(CLI::App& app, Settings& settings, Written& written) {
  const auto frequency = with_unit(kFrequencyUnits);
  ChipOptions& data = written.data;
  GainOptions& gain = written.gain;
  app.add_option("--frequency", gain.frequency, "Frequency of the tone, such as 500Hz; estimated when not given")
      ->type_name("HZ")
      ->transform(frequency);
  app.add_option("--waveform", gain.waveform, "Waveform of the light")
      ->type_name("tone|square")
      ->transform(one_of<WaveformShape>({{"tone", WaveformShape::tone}, {"square", WaveformShape::square}}));
  app.add_option("--duty", gain.duty, "Bright share of a square wave")->type_name("SHARE")->capture_default_str();
  app.add_option("--background", gain.background, "Light that is not the source's, DN above dark")->type_name("DN");
  app.add_option("--sense", settings.light.sense_frequency, "Of the moving scene, for the suggested exposure")
      ->type_name("HZ")
      ->transform(frequency);
  app.add_option("--sources", settings.max_sources, "Max. number of lights")
      ->type_name("N")
      ->check(whole())
      ->capture_default_str();
  app.add_option("--chip-rate", data.chip_rate, "Chips per second; estimated when not given")
      ->type_name("HZ")
      ->transform(frequency);
  app.add_option("--line-code", written.line_code, "Line code of packets: none, manchester, 4b6b, 8b10b")
      ->type_name("CODE")
      ->transform(any_case({"none", "manchester", "4b6b", "8b10b"}))
      ->capture_default_str();
  app.add_option("--block-bytes", data.format.block_bytes, "Coded bytes of a packet's block")
      ->type_name("N")
      ->check(whole())
      ->capture_default_str();
  app.add_flag("--lengthened", written.lengthened, "Packets with the lengthened preamble");
}

void add_output_options(CLI::App& app, Settings& settings, Written& written) {
  app.add_flag("--no-bits", written.no_bits, "Gain only");
  app.add_flag("--no-gain", written.no_gain, "Bits and payload only");
  app.add_flag("--payload", settings.payload_alone,
               "Write the payloads and nothing else to standard output, each with a new line at its end");
  app.add_option("--delimiter", written.delimiter,
                 "With --payload: newline after each (default), its length before it (4 bytes, big-endian), none")
      ->type_name("newline|length|none")
      ->transform(one_of<Delimiter>(
          {{"none", Delimiter::none}, {"newline", Delimiter::newline}, {"length", Delimiter::length}}));
  app.add_flag("--stats", settings.stats, "Latency and memory at the end, on standard error");
  app.set_config("--config", "", "File of options, TOML: row-time = \"22.2us\"")->type_name("FILE")->check(named());
  app.add_flag("--version", written.version, "Version, commit, SIMD targets, OpenCV");
}

// The parser would take a read that fails for the end of the file, hold a file of any length, pass over names that are
// no options, and read the first value of an option whose list is empty, as in "duty = [", or the last of several.
class OptionsFile : public CLI::ConfigTOML {
 public:
  explicit OptionsFile(const CLI::App& app) : app_(app) {}

  [[nodiscard]] std::vector<CLI::ConfigItem> from_config(std::istream& input) const override {
    require_no_output("--config", app_.get_config_ptr()->as<std::string>());
    std::string text((1 << 20) + 1, '\0');
    errno = 0;
    input.read(text.data(), static_cast<std::streamsize>(text.size()));
    if (input.bad()) throw std::system_error(errno ? errno : EIO, std::generic_category(), "--config");
    text.resize(static_cast<std::size_t>(input.gcount()));
    require(input.eof(), "--config", "a longer file", "at most 1 MiB");
    std::istringstream whole(text);
    auto options = CLI::ConfigTOML::from_config(whole);
    for (const auto& item : options) {
      const bool is_option = item.parents.empty() && app_.get_option_no_throw("--" + item.name) != nullptr;
      const std::string name = item.parents.empty() ? item.name : "[" + item.parents.front() + "]";
      require(is_option, "--config", name, "names of options, such as row-time");
      require(item.inputs.size() == 1, item.name, item.inputs.empty() ? "no value" : "several values",
              "one in --config");
    }
    return options;
  }

 private:
  const CLI::App& app_;
};

void print_version() {
  std::cout << "ocisac-rx " << version() << " (" << commit() << "), SIMD";
  for (const auto& target : simd_targets()) std::cout << ' ' << target;
  std::cout << ", OpenCV " << opencv_version() << '\n';
}

// Combines options that depend on each other, and checks them.
void complete(Settings& settings, Written written) {
  if (!written.size.empty()) {
    const auto format = pixel_format(written.format);
    require(format.has_value(), "--format", written.format, pixel_format_names());
    const auto [width, height] = parse_size(written.size);
    settings.raw = raw_layout(*format, width, height, written.stride);
  }
  if (!written.region.empty()) settings.region = parse_region(written.region);
  if (!written.row_time)
    throw std::invalid_argument("--row-time is missing: the time from one row to the next, such as 22.2us");
  settings.camera.row_time = *written.row_time;
  require_positive("--row-time", settings.camera.row_time);
  require(settings.camera.row_time <= kMaxRowTime, "--row-time", settings.camera.row_time,
          "at most 1 s; numbers without a unit are seconds, such as 22.2us");
  if (written.frame_rate) {
    require_positive("--frame-rate", *written.frame_rate);
    settings.camera.frame_time = 1 / *written.frame_rate;
  }
  settings.camera.tone_curve = parse_tone_curve(written.tone_curve);
  check(settings.camera);
  require(!written.delimiter || settings.payload_alone, "--delimiter", "no --payload", "--payload");
  settings.delimiter = written.delimiter.value_or(settings.delimiter);
  const bool no_gain = written.no_gain || settings.payload_alone;
  require(!written.no_bits || !no_gain, "--no-bits", "with --no-gain or --payload", "something to do");
  written.data.format.line_code = LineCode::named(written.line_code);
  if (written.lengthened) written.data.format.preamble = Preamble::lengthened;
  settings.light.data = written.no_bits ? std::nullopt : std::optional(written.data);
  settings.light.gain = no_gain ? std::nullopt : std::optional(written.gain);
  require(settings.max_sources > 0, "--sources", 0, "1 or above");
  require(!settings.frames || *settings.frames > 0, "--frames", 0, "1 or above");
}

}  // namespace

std::optional<Settings> read_settings(int argc, const char* const* argv) {
  CLI::App app{"Gain, bits and payload of a modulated light in frames of a rolling-shutter camera, as JSON lines.",
               "ocisac-rx"};
  app.footer(kFooter);
  app.option_defaults()->multi_option_policy(CLI::MultiOptionPolicy::TakeLast)->ignore_case();
  Settings settings;
  Written written;
  add_input_options(app, settings, written);
  add_camera_options(app, settings, written);
  add_light_options(app, settings, written);
  add_output_options(app, settings, written);
  app.config_formatter(std::make_shared<OptionsFile>(app));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {  // --help
      app.exit(error);
      return std::nullopt;
    }
    throw std::invalid_argument(error.what());
  }
  if (written.version) {
    print_version();
    return std::nullopt;
  }
  complete(settings, written);
  return settings;
}

}  // namespace ocisac::apps
