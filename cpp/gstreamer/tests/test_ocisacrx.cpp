// ocisacrx in real pipelines.
#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/packets/packets.hpp"
#include "pipelines.hpp"

namespace {

using namespace pipelines;

constexpr std::size_t kRows = 1080;
constexpr int kColumns = 16;
constexpr double kRowTime = 22.2e-6, kChipRate = 15000, kRowsPerChip = 1 / (kChipRate * kRowTime);
const std::string kPayload = "to the bus";
const std::string kRx = "ocisacrx name=rx row-time=22.2e-6 exposure=33.3e-6 chip-rate=15000 no-gain=true ";

// Rows under a light that repeats a packet, 30 frames a second.
std::vector<std::uint8_t> rows_of_light(int frame) {
  static const auto chips =
      ocisac::packet_chips({reinterpret_cast<const std::uint8_t*>(kPayload.data()), kPayload.size()}, {}, 1);
  const double start = 100.3 + frame * kChipRate / 30;  // chip at the first row
  const auto first = static_cast<std::size_t>(start) - 8;
  std::vector<double> levels, rows(kRows);
  for (std::size_t k = 0; k < 400; ++k) levels.push_back(chips[(first + k) % chips.size()]);
  ocisac::expose_chips({levels, 0}, {kRowsPerChip, (static_cast<double>(first) - start) * kRowsPerChip, 1.5}, rows);
  std::vector<std::uint8_t> pixels;
  for (const double row : rows) pixels.push_back(static_cast<std::uint8_t>(30 + 150 * row));
  return pixels;
}

// Sends frames [first, end) of the light as luma of this format.
void send_light(const Stream& stream, int first, int end, const char* format, int extra_width = 0) {
  const unsigned unit = std::strcmp(format, "GRAY16_LE") == 0 ? 256 : 1;
  for (int frame = first; frame < end; ++frame) {
    const auto light = rows_of_light(frame);
    send(stream.source.get(), {format, kColumns + extra_width, static_cast<int>(kRows)}, frame,
         [&](std::size_t row, std::size_t, unsigned) { return unit * light[row]; });
  }
}

std::vector<std::string> payloads_of(const Outcome& outcome) {
  std::vector<std::string> payloads;
  for (const auto& message : outcome.messages) {
    const GValue* payload = gst_structure_get_value(message.get(), "payload");
    if (payload == nullptr) continue;
    gsize size = 0;
    const auto* bytes =
        static_cast<const char*>(g_bytes_get_data(static_cast<GBytes*>(g_value_get_boxed(payload)), &size));
    payloads.emplace_back(bytes, size);
  }
  return payloads;
}

// The lights in the metadata of every buffer that leaves the element.
GstPadProbeReturn count_meta(GstPad*, GstPadProbeInfo* info, gpointer data) {
  GstCustomMeta* meta = gst_buffer_get_custom_meta(GST_PAD_PROBE_INFO_BUFFER(info), "GstOcisacMeta");
  if (meta == nullptr) return GST_PAD_PROBE_OK;
  const GValue* lights = gst_structure_get_value(gst_custom_meta_get_structure(meta), "lights");
  *static_cast<std::size_t*>(data) += gst_value_list_get_size(lights);
  return GST_PAD_PROBE_OK;
}

}  // namespace

TEST_CASE("payloads come on the bus and in the buffers' metadata, in every format") {
  for (const char* format : {"GRAY8", "GRAY16_LE", "I420", "NV12", "Y42B", "Y444", "YUY2", "UYVY"}) {
    CAPTURE(format);
    std::size_t in_buffers = 0;
    Stream stream(kSource + kRx + "! fakesink name=sink sync=false");
    stream.probe("sink", "sink", count_meta, &in_buffers);
    send_light(stream, 0, 12, format);
    const Outcome outcome = stream.finish();
    CHECK(outcome.ended);
    const auto payloads = payloads_of(outcome);
    REQUIRE_FALSE(payloads.empty());
    for (const auto& payload : payloads) CHECK(payload == kPayload);
    CHECK(outcome.messages.size() == 12);
    CHECK(in_buffers == 12);
  }
}

TEST_CASE("a file that was written is read again: filesrc, decodebin") {
  {
    Stream writing("appsrc name=source format=time ! matroskamux ! filesink location=lamp.mkv");
    send_light(writing, 0, 30, "GRAY8");
    CHECK(writing.finish().ended);
  }
  const Outcome outcome = run("filesrc location=lamp.mkv ! decodebin ! " + kRx + "! fakesink sync=false");
  CHECK(outcome.ended);
  CHECK(outcome.messages.size() == 30);
  CHECK(payloads_of(outcome).size() >= 4);  // time stamps of whole milliseconds are those of a jittering camera
}

TEST_CASE("pixels pass through unchanged, buffers of others too") {
  // tee: its buffers are shared, so that the element may not write into them
  const Outcome outcome =
      run("videotestsrc num-buffers=20 ! video/x-raw,format=GRAY8,width=64,height=480 ! tee name=t "
          "t. ! queue ! ocisacrx row-time=20e-6 ! fakesink t. ! queue ! fakesink");
  CHECK(outcome.ended);
  CHECK(outcome.error == "");
}

TEST_CASE("an error names the property, and its value") {
  CHECK(run("videotestsrc num-buffers=2 ! ocisacrx ! fakesink").error.find("row_time: got 0") == 0);
  CHECK(run("videotestsrc num-buffers=2 ! video/x-raw,format=GRAY8,width=64,height=64 ! "
            "ocisacrx row-time=1e-5 region=60,0,10,10 ! fakesink")
            .error.find("region: got 60,0,10,10") == 0);
  CHECK(run("videotestsrc num-buffers=2 ! video/x-raw,format=I420,interlace-mode=interleaved ! "
            "ocisacrx row-time=1e-5 ! fakesink")
            .error != "");
}

TEST_CASE("other caps in the stream begin another stream") {
  Stream stream(kSource + kRx + "! fakesink sync=false");
  send_light(stream, 0, 6, "GRAY8");
  send_light(stream, 6, 12, "I420", 8);
  send_light(stream, 12, 18, "GRAY8");
  const Outcome outcome = stream.finish();
  CHECK(outcome.ended);
  CHECK(outcome.error == "");
  CHECK(outcome.messages.size() == 18);
}

TEST_CASE("time that jumps back is received as a new stream, and so is what follows a flush") {
  Stream stream(kSource + kRx + "! fakesink sync=false");
  send_light(stream, 30, 42, "GRAY8");
  send_light(stream, 0, 12, "GRAY8");
  const Outcome outcome = stream.finish();
  CHECK(outcome.ended);
  CHECK(payloads_of(outcome).size() >= 2);

  seek("videotestsrc num-buffers=300 ! video/x-raw,format=GRAY8,width=32,height=240 ! " + kRx + "! fakesink sync=true",
       {2, 1});
}

TEST_CASE("a stalled sink does not keep the pipeline from ending") {
  Stream stream(kSource + kRx + "! queue max-size-buffers=1 ! fakesink name=sink sync=true");
  send_light(stream, 0, 4, "GRAY8");
  send_light(stream, 100000, 100004, "GRAY8");  // due in an hour
}  // the destructor stops it

TEST_CASE("frames without time stamps are received by their numbers") {
  Stream stream("appsrc name=source format=bytes ! capsfilter ! " + kRx + "! fakesink sync=false");
  stream.probe("source", "src", remove_stamp);
  send_light(stream, 0, 12, "GRAY8");
  const Outcome outcome = stream.finish();
  CHECK(outcome.ended);
  const auto payloads = payloads_of(outcome);
  REQUIRE_FALSE(payloads.empty());
  CHECK(payloads.front() == kPayload);
}

TEST_CASE("properties keep what they are given") {
  const Element rx(gst_element_factory_make("ocisacrx", nullptr));
  REQUIRE(rx);
  g_object_set(rx.get(), "row-time", 2e-5, "sources", 3U, "region", "1,2,3,4", "lengthened", TRUE, nullptr);
  gst_util_set_object_arg(G_OBJECT(rx.get()), "scan-axis", "-x");
  gst_util_set_object_arg(G_OBJECT(rx.get()), "tone-curve", "srgb");
  gdouble row_time = 0;
  guint sources = 0;
  gint axis = -1, curve = -1;
  gboolean lengthened = FALSE;
  gchar* region = nullptr;
  g_object_get(rx.get(), "row-time", &row_time, "sources", &sources, "region", &region, "lengthened", &lengthened,
               "scan-axis", &axis, "tone-curve", &curve, nullptr);
  CHECK(row_time == 2e-5);
  CHECK(sources == 3);
  CHECK(std::string(region) == "1,2,3,4");
  CHECK(lengthened == TRUE);
  CHECK(axis == 3);
  CHECK(curve == 1);
  g_free(region);
}
