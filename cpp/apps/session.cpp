#include "session.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include "byte_input.hpp"
#include "frame_reader.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/receiver/receiver.hpp"
#include "output.hpp"
#include "report.hpp"
#include "stop_signal.hpp"
#include "stream_fit.hpp"
#include "timestamps.hpp"

namespace ocisac::apps {

namespace {

// Camera from the options, completed by the stream's header.
Camera camera_of(const Settings& settings, const StreamHeader& header) {
  Camera camera = settings.camera;
  camera.tone_curve.dark_level = settings.dark_level.value_or(header.dark_level);
  camera.tone_curve.white_level = settings.white_level.value_or(header.white_level);
  if (!camera.frame_time && header.frame_rate) camera.frame_time = 1 / *header.frame_rate;
  return camera;
}

Region region_of(const Settings& settings, const FrameLayout& layout) {
  const Region whole{0, 0, layout.width, layout.height};
  const Region region = settings.region.value_or(whole);
  require_inside("--region", {region.x, region.y, region.width, region.height}, layout.width, layout.height);
  return region;
}

ReceiverOptions receiver_options(const Settings& settings, const FrameLayout& layout, const Region& region) {
  ReceiverOptions options{.light = settings.light, .regions = {}, .max_sources = settings.max_sources};
  if (settings.region) options.regions = {to_time_order(region, settings.scan_axis, layout.width, layout.height)};
  return options;
}

std::string delimited(const std::vector<std::uint8_t>& payload, Delimiter delimiter) {
  std::string text(payload.begin(), payload.end());
  if (delimiter == Delimiter::newline) text += '\n';
  if (delimiter != Delimiter::length) return text;
  std::string length;
  for (int shift = 24; shift >= 0; shift -= 8) length += static_cast<char>(payload.size() >> shift & 0xFF);
  return length + text;
}

const Payload* payload_of(const LightFrame& light) {
  const bool whole = light.received && light.received->stretch && light.received->stretch->payload;
  return whole ? &*light.received->stretch->payload : nullptr;
}

void count(Totals& totals, const std::vector<LightFrame>& lights) {
  ++totals.frames;
  totals.searches += lights.front().searched;
  bool received = false;
  for (const LightFrame& light : lights) {
    if (!light.received) continue;
    received |= light.received->outcome == FrameOutcome::received;
    totals.bits += light.received->bits.size();
    if (light.received->outcome == FrameOutcome::received && light.received->rows_per_chip > 0)
      totals.rows_per_chip = light.received->rows_per_chip;
    if (const auto& stretch = light.received->stretch) {
      totals.blocks += stretch->blocks;
      totals.share = std::max(totals.share, stretch->share);
    }
    if (const Payload* payload = payload_of(light)) {
      ++totals.payloads;
      totals.payload_bytes += payload->bytes.size();
    }
  }
  totals.with_data += received;
}

class Session {
 public:
  Session(const Settings& settings, const StreamHeader& header, std::optional<Timestamps>& times)
      : settings_(settings),
        layout_(header.layout),
        camera_(camera_of(settings, header)),
        unpacked_(region_of(settings, header.layout)),
        picture_(header.layout),
        receiver_(camera_, receiver_options(settings, header.layout, unpacked_)),
        times_(times) {
    const Region whole{0, 0, layout_.width, layout_.height};
    const auto rows = to_time_order(whole, settings.scan_axis, layout_.width, layout_.height).height;
    const auto& data = settings.light.data;
    if (const auto doubt = time_doubt(camera_, rows, data ? data->chip_rate : std::nullopt)) write_warning(*doubt);
    if (header.bytes == 0) format_check_.emplace(header.layout);  // raw
  }

  // Returns false after the reader of the output has gone.
  bool take(const Frame& frame) {
    const double began = seconds_now();
    if (totals_.frames == 0) first_ = began;
    if (const auto doubt = format_check_ ? format_check_->push(frame.bytes) : std::nullopt) write_warning(*doubt);
    const auto view = in_time_order(picture_.view(frame.bytes, unpacked_), settings_.scan_axis);
    const auto time = times_ ? times_->next(camera_.frame_time) : std::nullopt;
    if (times_ && !time) {
      if (stop_requested()) return false;
      throw std::invalid_argument(
          "--timestamps: got fewer times than frames, allowed: one for each, within 2 s of it (rpicam-vid --flush)");
    }
    const auto lost = times_ ? times_->lost() : 0;
    const auto lights = receiver_.push({&view, 1}, {static_cast<std::int64_t>(frame.number) + lost, time});
    totals_.missing = static_cast<std::size_t>(lost);
    count(totals_, lights);
    rows_ = shape_of(view).rows;
    const bool read = settings_.payload_alone ? write_payloads(lights) : write_lines(lights, time);
    const double taken = seconds_now() - began;
    if (totals_.frames == 1)
      stats_.first_frame = taken;
    else
      stats_.computing.add(taken);
    return read;
  }

  void finish(std::size_t torn, double ready) {
    stats_.ready = ready;
    totals_.torn = torn;
    totals_.seconds = totals_.frames == 0 ? 0 : seconds_now() - first_;
    if (!settings_.payload_alone) write_all(STDOUT_FILENO, totals_line(totals_));
    if (settings_.payload_alone && totals_.frames > 0 && totals_.payloads == 0 && !stop_requested())
      write_message(no_payload_text(totals_, settings_.light.data->format, rows_, camera_.frame_time.has_value()));
    if (settings_.stats) write_all(STDERR_FILENO, stats_line(stats_));
  }

  [[nodiscard]] const Totals& totals() const { return totals_; }

 private:
  bool write_lines(const std::vector<LightFrame>& lights, std::optional<double> time) {
    std::string lines;
    for (const LightFrame& light : lights) {
      const Region region = to_stored(light.region, settings_.scan_axis, layout_.width, layout_.height);
      lines += light_line(light, region, rows_, camera_, time);
    }
    return write_all(STDOUT_FILENO, lines);
  }

  bool write_payloads(const std::vector<LightFrame>& lights) const {
    for (const LightFrame& light : lights) {
      const Payload* payload = payload_of(light);
      if (payload == nullptr) continue;
      if (!write_all(STDOUT_FILENO, delimited(payload->bytes, settings_.delimiter))) return false;
    }
    return true;
  }

  const Settings& settings_;
  FrameLayout layout_;
  Camera camera_;
  Region unpacked_;
  GrayPicture picture_;
  Receiver receiver_;
  std::optional<FormatCheck> format_check_;  // of raw frames
  std::optional<Timestamps>& times_;
  std::size_t rows_ = 0;  // of the picture
  Stats stats_;
  Totals totals_;
  double first_ = 0;
};

}  // namespace

double seconds_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

ExitCode run(const Settings& settings, double began) {
  catch_stop_signals();
  std::optional<Timestamps> times;
  if (settings.timestamps) times.emplace(*settings.timestamps);
  if (stop_requested()) return kDone;
  ByteInput input(settings.input);
  const double ready = seconds_now() - began;
  const auto bytes = input.remaining();
  FrameReader frames([&](std::span<std::uint8_t> wanted) { return input.read(wanted); }, settings.raw, write_message);
  if (!frames.header()) {
    if (stop_requested()) return kDone;
    write_message("no frames: the input is empty");
    return kRefused;
  }
  const auto length = frames.header()->bytes == 0 ? bytes : std::nullopt;
  if (const auto doubt = length ? length_doubt(*length, frames.header()->layout) : std::nullopt) write_warning(*doubt);
  Session session(settings, *frames.header(), times);
  while (const auto frame = frames.next()) {
    if (!session.take(*frame) || stop_requested()) break;
    if (settings.frames && session.totals().frames >= *settings.frames) break;
  }
  session.finish(frames.torn(), ready);
  if (session.totals().frames == 0 && !stop_requested()) return kRefused;
  return settings.payload_alone && session.totals().payloads == 0 && !stop_requested() ? kNoPayload : kDone;
}

}  // namespace ocisac::apps
