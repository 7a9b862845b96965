#include "report.hpp"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>

namespace ocisac::apps {

namespace {

using Json = nlohmann::ordered_json;

// Peak resident memory. getrusage includes that of the parent process before exec, so it is the fallback where /proc is
// missing.
long peak_memory() {
  std::array<char, 4096> status{};
  const int file = ::open("/proc/self/status", O_RDONLY | O_CLOEXEC);
  const auto got = file < 0 ? 0 : ::read(file, status.data(), status.size());
  if (file >= 0) ::close(file);
  const std::string_view text(status.data(), got > 0 ? static_cast<std::size_t>(got) : 0);
  constexpr std::string_view name = "VmHWM:";
  long kilobytes = 0;
  if (const auto at = text.find(name); at != text.npos) {
    const auto digits = text.find_first_of("0123456789", at);
    if (digits != text.npos) std::from_chars(text.data() + digits, text.data() + text.size(), kilobytes);
  }
  if (kilobytes == 0) {
    rusage usage{};
    ::getrusage(RUSAGE_SELF, &usage);
    kilobytes = usage.ru_maxrss;
  }
  return kilobytes * 1024;
}

double decibels(double ratio) { return ratio > 0 ? 10 * std::log10(ratio) : std::nan(""); }

Json names_of(Flags flags) { return flags == 0 ? Json::array() : Json(flag_names(flags)); }

void add_packet(Json& line, const StretchReport& stretch) {
  line["packet_outcome"] = outcome_name(stretch.outcome);
  line["packet_blocks"] = stretch.blocks;
  line["packet_bytes"] = stretch.bytes;
  line["packet_cut"] = stretch.cut;
  line["packet_doubtful"] = stretch.doubtful;
  line["packet_share"] = stretch.share;
  line["packet_inverted"] = stretch.inverted;
  line["packet_lack"] = lack_name(stretch.lack);
  if (!stretch.payload) return;
  const auto& bytes = stretch.payload->bytes;
  line["packet"] = stretch.payload->number;
  line["payload"] = std::string(bytes.begin(), bytes.end());
  line["payload_base64"] = base64(bytes);
}

void add_data(Json& line, const ReceivedFrame& received, const Camera& camera) {
  line["bits"] = received.bits;
  line["rows_per_chip"] = received.rows_per_chip;
  line["chip_rate_hz"] = 1 / (received.rows_per_chip * camera.row_time);
  line["snr_db"] = decibels(received.snr);
  line["exposure_s"] = received.exposure;
  line["error_rate"] = received.error_rate;
  line["outcome"] = outcome_name(received.outcome);
  line["frames_missing"] = received.missing;
  if (received.stretch) add_packet(line, *received.stretch);
  line["flags"] = names_of(received.flags);
}

void add_gain(Json& line, const LightGain& gain) {
  line["frequency_hz"] = gain.frequency;
  line["frequency_std_hz"] = gain.frequency_std;
  line["gain"] = gain.gain;
  line["gain_std"] = gain.gain_std;
  line["gain_snr_db"] = decibels(gain.snr);
  line["gain_flags"] = names_of(gain.flags);
}

std::string text_of(const Json& line) { return line.dump(-1, ' ', false, Json::error_handler_t::replace) + '\n'; }

}  // namespace

std::string base64(std::span<const std::uint8_t> bytes) {
  static constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t k = 0; k < bytes.size(); k += 3) {
    const auto byte = [&](std::size_t at) { return at < bytes.size() ? std::uint32_t{bytes[at]} : 0U; };
    const std::uint32_t group = byte(k) << 16 | byte(k + 1) << 8 | byte(k + 2);
    for (std::size_t digit = 0; digit < 4; ++digit)
      text += k + digit <= bytes.size() ? digits[group >> (18 - 6 * digit) & 63] : '=';
  }
  return text;
}

std::string light_line(const LightFrame& light, const Region& region, std::size_t rows, const Camera& camera,
                       std::optional<double> time) {
  Json line{{"frame", light.frame},
            {"source", light.source},
            {"rows", rows},
            {"region", {region.x, region.y, region.width, region.height}}};
  if (time) line["time_s"] = *time;
  if (light.received) add_data(line, *light.received, camera);
  if (light.gain) add_gain(line, *light.gain);
  if (light.suggestion) line["suggested_exposure_s"] = light.suggestion->exposure;
  return text_of(line);
}

std::string totals_line(const Totals& totals) {
  return text_of({{"totals",
                   {{"frames", totals.frames},
                    {"torn", totals.torn},
                    {"missing", totals.missing},
                    {"received", totals.with_data},
                    {"bits", totals.bits},
                    {"payloads", totals.payloads},
                    {"payload_bytes", totals.payload_bytes},
                    {"searches", totals.searches},
                    {"seconds", totals.seconds}}}});
}

std::string no_payload_text(const Totals& totals, const PacketFormat& format, std::size_t shown_rows,
                            bool has_frame_time) {
  const auto number = [](auto value) { return std::to_string(value); };
  std::string text = "no payload in " + number(totals.frames) + (totals.frames == 1 ? " frame: " : " frames: ");
  if (totals.with_data == 0)
    return text + "no light with chips was found; --row-time, --exposure and --chip-rate may be wrong or missing";
  const auto shown = static_cast<std::size_t>(static_cast<double>(shown_rows) / totals.rows_per_chip);
  text += "chips in " + number(totals.with_data) + " of them, ";
  text += totals.blocks == 0
              ? "but no header of a packet"
              : "headers of " + number(totals.blocks) + " blocks, " +
                    number(std::lround(100 * std::min(totals.share, 1.0))) + " % of the bytes that a payload needs";
  if (totals.blocks == 0)
    text += "; --line-code, --block-bytes, --lengthened, --chip-rate or --row-time may differ from the sender's";
  if (block_chips(format) > shown)
    text += "; a block of " + number(format.block_bytes) + " bytes is " + number(block_chips(format)) +
            " chips, a frame shows " + number(shown) + ": smaller blocks show more headers";
  if (!has_frame_time) text += "; packets are joined over frames with --frame-rate only";
  return text;
}

std::string stats_line(const Stats& stats) {
  const Latency& latency = stats.computing;
  return text_of({{"stats",
                   {{"ready_s", stats.ready},
                    {"first_frame_s", stats.first_frame},
                    {"latency_s",
                     {{"mean", latency.mean()},
                      {"p50", latency.percentile(0.5)},
                      {"p90", latency.percentile(0.9)},
                      {"p99", latency.percentile(0.99)},
                      {"p999", latency.percentile(0.999)},
                      {"max", latency.largest()}}},
                    {"peak_memory_bytes", peak_memory()}}}});
}

}  // namespace ocisac::apps
