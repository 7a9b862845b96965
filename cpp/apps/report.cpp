#include "report.hpp"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <charconv>
#include <cmath>
#include <string_view>

namespace ocisac::apps {

namespace {

// Bytes that were resident at most. What getrusage tells starts with what the program that started this one had, so it
// stands in only where there is no /proc.
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

void add_flags(JsonLine& line, Flags flags) {
  line.open_list("flags");
  if (flags != 0)
    for (const auto& name : flag_names(flags)) line.item(name);
  line.close_list();
}

void add_gain(JsonLine& line, const LiveGain& gain) {
  line.open("gain");
  line.member("frequency_hz", gain.frequency);
  line.member("frequency_std_hz", gain.frequency_std);
  line.member("gain", gain.gain);
  line.member("gain_std", gain.gain_std);
  line.member("snr_db", decibels(gain.snr));
  add_flags(line, gain.flags);
  line.close();
}

void add_packet(JsonLine& line, const StretchReport& stretch) {
  line.member("packet_blocks", stretch.blocks);
  line.member("packet_share", stretch.share);
  if (!stretch.payload) return;
  const Payload& payload = *stretch.payload;
  line.member("packet", payload.number);
  line.member("payload", std::string_view(reinterpret_cast<const char*>(payload.bytes.data()), payload.bytes.size()));
  line.base64("payload_base64", payload.bytes);
}

void add_received(JsonLine& line, const ReceivedFrame& received, const Camera& camera) {
  line.open("received");
  line.member("outcome", outcome_name(received.outcome));
  line.member("bits", std::string_view(received.bits));
  line.member("rows_per_chip", received.rows_per_chip);
  line.member("chip_rate_hz", 1 / (received.rows_per_chip * camera.row_time));
  line.member("snr_db", decibels(received.snr));
  line.member("error_rate", received.error_rate);
  if (received.stretch) add_packet(line, *received.stretch);
  add_flags(line, received.flags);
  line.close();
}

}  // namespace

std::string_view frame_line(JsonLine& line, const LiveFrame& frame, const StoredRegion& region, const Camera& camera) {
  line.begin();
  line.member("frame", frame.frame);
  line.open_list("region");
  for (const std::size_t value : {region.x, region.y, region.width, region.height})
    line.item(static_cast<std::int64_t>(value));
  line.close_list();
  if (frame.gain) add_gain(line, *frame.gain);
  if (frame.received) add_received(line, *frame.received, camera);
  if (frame.suggestion) {
    line.open("exposure");
    line.member("exposure_s", frame.suggestion->exposure);
    line.member("objective", frame.suggestion->objective);
    line.close();
  }
  return line.end();
}

std::string_view totals_line(JsonLine& line, const Totals& totals) {
  line.begin();
  line.open("totals");
  line.member("frames", totals.frames);
  line.member("torn", totals.torn);
  line.member("received", totals.with_data);
  line.member("bits", totals.bits);
  line.member("payloads", totals.payloads);
  line.member("payload_bytes", totals.payload_bytes);
  line.member("searches", totals.searches);
  line.member("seconds", totals.seconds);
  line.close();
  return line.end();
}

std::string_view stats_line(JsonLine& line, const Stats& stats) {
  line.begin();
  line.open("stats");
  line.member("ready_s", stats.ready);
  line.member("first_frame_s", stats.first_frame);
  line.open("latency_s");
  line.member("mean", stats.computing.mean());
  line.member("p50", stats.computing.percentile(0.5));
  line.member("p90", stats.computing.percentile(0.9));
  line.member("p99", stats.computing.percentile(0.99));
  line.member("p999", stats.computing.percentile(0.999));
  line.member("max", stats.computing.largest());
  line.close();
  line.member("pool_bytes", stats.pool_bytes);
  line.member("peak_memory_bytes", peak_memory());
  line.close();
  return line.end();
}

}  // namespace ocisac::apps
