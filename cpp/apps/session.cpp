#include "session.hpp"

#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <string>

#include "byte_input.hpp"
#include "frame_reader.hpp"
#include "ocisac/core/require.hpp"
#include "orientation.hpp"
#include "output.hpp"
#include "report.hpp"
#include "stop_signal.hpp"

namespace ocisac::apps {

namespace {

// The camera, as the stream itself tells where the options do not.
Camera camera_of(const Settings& settings, const StreamHeader& header) {
  Camera camera = settings.camera;
  camera.tone_curve.dark_level = settings.dark_level.value_or(header.dark_level);
  camera.tone_curve.white_level = settings.white_level.value_or(header.white_level);
  if (!camera.frame_time && header.frame_rate) camera.frame_time = 1 / *header.frame_rate;
  return camera;
}

StoredRegion region_of(const Settings& settings, const FrameLayout& layout) {
  const StoredRegion whole{0, 0, layout.width, layout.height};
  const StoredRegion region = settings.region.value_or(whole);
  require_inside("--region", {region.x, region.y, region.width, region.height}, layout.width, layout.height);
  return region;
}

LiveOptions live_options(const Settings& settings, const FrameLayout& layout, const StoredRegion& region) {
  LiveOptions live = settings.live;
  if (settings.region) live.region = to_time_order(region, settings.scan_axis, layout.width, layout.height);
  return live;
}

void count(Totals& totals, const LiveFrame& frame) {
  ++totals.frames;
  totals.searches += frame.searched;
  if (!frame.received) return;
  totals.with_data += frame.received->outcome == FrameOutcome::received;
  totals.bits += frame.received->bits.size();
  if (frame.received->stretch && frame.received->stretch->payload) {
    ++totals.payloads;
    totals.payload_bytes += frame.received->stretch->payload->bytes.size();
  }
}

class Session {
 public:
  Session(const Settings& settings, const StreamHeader& header)
      : settings_(settings),
        layout_(header.layout),
        camera_(camera_of(settings, header)),
        unpacked_(region_of(settings, header.layout)),
        picture_(header.layout),
        receiver_(camera_, live_options(settings, header.layout, unpacked_)) {}

  // False where nobody reads any more.
  bool take(const Frame& frame) {
    const double began = seconds_now();
    if (totals_.frames == 0) first_ = began;
    const auto view = in_time_order(picture_.view(frame.bytes, unpacked_), settings_.scan_axis);
    const LiveFrame& result = receiver_.push(view, static_cast<std::int64_t>(frame.number));
    count(totals_, result);
    const bool read = settings_.payload_alone ? write_payload(result) : write_line(result);
    const double taken = seconds_now() - began;
    if (totals_.frames == 1)
      stats_.first_frame = taken;
    else
      stats_.computing.add(taken);
    return read;
  }

  void finish(std::size_t torn, double ready, std::size_t pool_bytes) {
    stats_.ready = ready;
    stats_.pool_bytes = pool_bytes;
    totals_.torn = torn;
    totals_.seconds = totals_.frames == 0 ? 0 : seconds_now() - first_;
    if (!settings_.payload_alone) write_all(STDOUT_FILENO, totals_line(line_, totals_));
    if (settings_.stats) write_all(STDERR_FILENO, stats_line(line_, stats_));
  }

  [[nodiscard]] const Totals& totals() const { return totals_; }

 private:
  bool write_line(const LiveFrame& result) {
    const StoredRegion region = to_stored(result.region, settings_.scan_axis, layout_.width, layout_.height);
    return write_all(STDOUT_FILENO, frame_line(line_, result, region, camera_));
  }

  bool write_payload(const LiveFrame& result) {
    if (!result.received || !result.received->stretch || !result.received->stretch->payload) return true;
    const auto& bytes = result.received->stretch->payload->bytes;
    return write_all(STDOUT_FILENO, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  }

  const Settings& settings_;
  FrameLayout layout_;
  Camera camera_;
  StoredRegion unpacked_;
  GrayPicture picture_;
  LiveReceiver receiver_;
  JsonLine line_;
  Stats stats_;
  Totals totals_;
  double first_ = 0;
};

}  // namespace

double seconds_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

ExitCode run(const Settings& settings, double began, std::size_t (*pool_bytes)()) {
  catch_stop_signals();
  ByteInput input(settings.input);
  const double ready = seconds_now() - began;
  FrameReader frames([&](std::span<std::uint8_t> bytes) { return input.read(bytes); }, settings.raw, write_message);
  if (!frames.header()) {
    if (stop_requested()) return kDone;
    write_message("no frames: the input is empty");
    return kRefused;
  }
  Session session(settings, *frames.header());
  while (const auto frame = frames.next()) {
    if (!session.take(*frame) || stop_requested()) break;
    if (settings.frames && session.totals().frames >= *settings.frames) break;
  }
  session.finish(frames.torn(), ready, pool_bytes());
  if (session.totals().frames == 0 && !stop_requested()) return kRefused;
  return settings.payload_alone && session.totals().payloads == 0 && !stop_requested() ? kNoPayload : kDone;
}

}  // namespace ocisac::apps
