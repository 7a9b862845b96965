// Real pipelines with ocisacrx. The plugin is found by GST_PLUGIN_PATH, warnings of GLib are fatal (CMakeLists.txt).
#include <gst/app/gstappsrc.h>
#include <gst/gst.h>
#include <gst/video/video.h>

#define DOCTEST_CONFIG_IMPLEMENT
#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/packets/packets.hpp"

namespace {

constexpr std::size_t kRows = 1080, kColumns = 16;
constexpr double kRowTime = 22.2e-6, kChipRate = 15000, kRowsPerChip = 1 / (kChipRate * kRowTime);
const std::string kPayload = "to the bus";

struct Unref {
  void operator()(void* object) const { gst_object_unref(object); }
};
using Element = std::unique_ptr<GstElement, Unref>;

struct Outcome {
  std::vector<std::string> payloads;
  std::string error;
  std::size_t lights = 0;
  bool ended = false;
};

// A light that repeats a packet, 30 frames a second.
std::vector<std::uint8_t> frame_of_light(int frame) {
  static const auto chips =
      ocisac::packet_chips({reinterpret_cast<const std::uint8_t*>(kPayload.data()), kPayload.size()}, {}, 1);
  const double start = 100.3 + frame * kChipRate / 30;  // chip at the first row
  const auto first = static_cast<std::size_t>(start) - 8;
  std::vector<double> levels, rows(kRows);
  for (std::size_t k = 0; k < 400; ++k) levels.push_back(chips[(first + k) % chips.size()]);
  ocisac::expose_chips({levels, 0}, {kRowsPerChip, (static_cast<double>(first) - start) * kRowsPerChip, 1.5}, rows);
  std::vector<std::uint8_t> pixels;
  for (const double row : rows) pixels.insert(pixels.end(), kColumns, static_cast<std::uint8_t>(30 + 150 * row));
  return pixels;
}

Element launch(const std::string& text) {
  GError* error = nullptr;
  Element pipeline(gst_parse_launch(text.c_str(), &error));
  INFO(text, ": ", error != nullptr ? error->message : "");
  REQUIRE(error == nullptr);
  return pipeline;
}

void take(const GstStructure* light, Outcome& outcome) {
  ++outcome.lights;
  const GValue* payload = gst_structure_get_value(light, "payload");
  if (payload == nullptr) return;
  gsize size = 0;
  const auto* bytes =
      static_cast<const char*>(g_bytes_get_data(static_cast<GBytes*>(g_value_get_boxed(payload)), &size));
  outcome.payloads.emplace_back(bytes, size);
}

// Reads the bus until the stream ends, an error comes, or 60 s are over.
Outcome wait(GstElement* pipeline) {
  Outcome outcome;
  GstBus* bus = gst_element_get_bus(pipeline);
  constexpr auto kinds = static_cast<GstMessageType>(GST_MESSAGE_EOS | GST_MESSAGE_ERROR | GST_MESSAGE_ELEMENT);
  while (!outcome.ended && outcome.error.empty()) {
    GstMessage* message = gst_bus_timed_pop_filtered(bus, 60 * GST_SECOND, kinds);
    if (message == nullptr) break;
    if (GST_MESSAGE_TYPE(message) == GST_MESSAGE_EOS) outcome.ended = true;
    if (GST_MESSAGE_TYPE(message) == GST_MESSAGE_ERROR) {
      GError* error = nullptr;
      gst_message_parse_error(message, &error, nullptr);
      outcome.error = error->message;
      g_error_free(error);
    }
    if (gst_message_has_name(message, "ocisac")) take(gst_message_get_structure(message), outcome);
    gst_message_unref(message);
  }
  gst_object_unref(bus);
  return outcome;
}

Outcome run(const std::string& text) {
  const Element pipeline = launch(text);
  gst_element_set_state(pipeline.get(), GST_STATE_PLAYING);
  Outcome outcome = wait(pipeline.get());
  gst_element_set_state(pipeline.get(), GST_STATE_NULL);
  return outcome;
}

// Sends frames [first, end) of the light as luma of this format.
void send(GstElement* source, int first, int end, const char* format, int extra_width = 0) {
  const auto width = static_cast<int>(kColumns) + extra_width;
  GstCaps* caps = gst_caps_new_simple("video/x-raw", "format", G_TYPE_STRING, format, "width", G_TYPE_INT, width,
                                      "height", G_TYPE_INT, static_cast<int>(kRows), "framerate", GST_TYPE_FRACTION, 30,
                                      1, "colorimetry", G_TYPE_STRING, "1:4:7:1", nullptr);
  gst_app_src_set_caps(GST_APP_SRC(source), caps);
  GstVideoInfo info;
  REQUIRE(gst_video_info_from_caps(&info, caps));
  for (int frame = first; frame < end; ++frame) {
    const auto light = frame_of_light(frame);
    GstBuffer* buffer = gst_buffer_new_allocate(nullptr, GST_VIDEO_INFO_SIZE(&info), nullptr);
    gst_buffer_memset(buffer, 0, 128, GST_VIDEO_INFO_SIZE(&info));
    GstVideoFrame video;
    REQUIRE(gst_video_frame_map(&video, &info, buffer, GST_MAP_WRITE));
    const int step = GST_VIDEO_FRAME_COMP_PSTRIDE(&video, 0);
    const int high = std::strcmp(format, "GRAY16_LE") == 0 ? 1 : 0;  // byte of a sample
    for (std::size_t row = 0; row < kRows; ++row) {
      auto* line = static_cast<std::uint8_t*>(GST_VIDEO_FRAME_COMP_DATA(&video, 0)) +
                   row * static_cast<std::size_t>(GST_VIDEO_FRAME_COMP_STRIDE(&video, 0));
      for (int column = 0; column < width; ++column) line[step * column + high] = light[row * kColumns];
    }
    gst_video_frame_unmap(&video);
    GST_BUFFER_PTS(buffer) = gst_util_uint64_scale(static_cast<guint64>(frame), GST_SECOND, 30);
    GST_BUFFER_DURATION(buffer) = GST_SECOND / 30;
    REQUIRE(gst_app_src_push_buffer(GST_APP_SRC(source), buffer) == GST_FLOW_OK);
  }
  gst_caps_unref(caps);
}

const std::string kSource = "appsrc name=source format=time ! ";
const std::string kRx = "ocisacrx name=rx row-time=22.2e-6 exposure=33.3e-6 chip-rate=15000 no-gain=true ";

struct Stream {
  Element pipeline, source;
  explicit Stream(const std::string& text)
      : pipeline(launch(text)), source(gst_bin_get_by_name(GST_BIN(pipeline.get()), "source")) {
    gst_element_set_state(pipeline.get(), GST_STATE_PLAYING);
  }
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;
  ~Stream() { gst_element_set_state(pipeline.get(), GST_STATE_NULL); }
  Outcome finish() {
    gst_app_src_end_of_stream(GST_APP_SRC(source.get()));
    return wait(pipeline.get());
  }
};

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
  for (const char* format : {"GRAY8", "GRAY16_LE", "I420", "NV12", "Y42B", "Y444", "YUY2"}) {
    CAPTURE(format);
    std::size_t in_buffers = 0;
    Stream stream(kSource + kRx + "! fakesink name=sink sync=false");
    const Element sink(gst_bin_get_by_name(GST_BIN(stream.pipeline.get()), "sink"));
    GstPad* pad = gst_element_get_static_pad(sink.get(), "sink");
    gst_pad_add_probe(pad, GST_PAD_PROBE_TYPE_BUFFER, count_meta, &in_buffers, nullptr);
    gst_object_unref(pad);
    send(stream.source.get(), 0, 12, format);
    const Outcome outcome = stream.finish();
    CHECK(outcome.ended);
    REQUIRE_FALSE(outcome.payloads.empty());
    for (const auto& payload : outcome.payloads) CHECK(payload == kPayload);
    CHECK(outcome.lights == 12);
    CHECK(in_buffers == 12);
  }
}

TEST_CASE("a file that was written is read again: filesrc, decodebin") {
  {
    Stream writing("appsrc name=source format=time ! matroskamux ! filesink location=lamp.mkv");
    send(writing.source.get(), 0, 30, "GRAY8");
    CHECK(writing.finish().ended);
  }
  const Outcome outcome = run("filesrc location=lamp.mkv ! decodebin ! " + kRx + "! fakesink sync=false");
  CHECK(outcome.ended);
  CHECK(outcome.lights == 30);
  CHECK(outcome.payloads.size() >= 4);  // time stamps of whole milliseconds are those of a jittering camera
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
  send(stream.source.get(), 0, 6, "GRAY8");
  send(stream.source.get(), 6, 12, "I420", 8);
  send(stream.source.get(), 12, 18, "GRAY8");
  const Outcome outcome = stream.finish();
  CHECK(outcome.ended);
  CHECK(outcome.error == "");
  CHECK(outcome.lights == 18);
}

TEST_CASE("time that jumps back is received as a new stream, and so is what follows a flush") {
  Stream stream(kSource + kRx + "! fakesink sync=false");
  send(stream.source.get(), 30, 42, "GRAY8");
  send(stream.source.get(), 0, 12, "GRAY8");
  const Outcome outcome = stream.finish();
  CHECK(outcome.ended);
  CHECK(outcome.payloads.size() >= 2);

  const Element seeking = launch("videotestsrc num-buffers=300 ! video/x-raw,format=GRAY8,width=32,height=240 ! " +
                                 kRx + "! fakesink sync=true");
  gst_element_set_state(seeking.get(), GST_STATE_PAUSED);
  CHECK(gst_element_get_state(seeking.get(), nullptr, nullptr, 20 * GST_SECOND) == GST_STATE_CHANGE_SUCCESS);
  for (const GstClockTime place : {2 * GST_SECOND, GST_SECOND})
    CHECK(gst_element_seek_simple(seeking.get(), GST_FORMAT_TIME, GST_SEEK_FLAG_FLUSH, static_cast<gint64>(place)));
  CHECK(gst_element_get_state(seeking.get(), nullptr, nullptr, 20 * GST_SECOND) == GST_STATE_CHANGE_SUCCESS);
  gst_element_set_state(seeking.get(), GST_STATE_NULL);
}

TEST_CASE("a stalled sink does not keep the pipeline from ending") {
  Stream stream(kSource + kRx + "! queue max-size-buffers=1 ! fakesink name=sink sync=true");
  send(stream.source.get(), 0, 4, "GRAY8");
  send(stream.source.get(), 100000, 100004, "GRAY8");  // due in an hour
}  // the destructor stops it

TEST_CASE("frames without time stamps are received by their numbers") {
  Stream stream("appsrc name=source format=bytes ! capsfilter ! " + kRx + "! fakesink sync=false");
  GstPad* pad = gst_element_get_static_pad(stream.source.get(), "src");
  gst_pad_add_probe(
      pad, GST_PAD_PROBE_TYPE_BUFFER,
      [](GstPad*, GstPadProbeInfo* info, gpointer) {
        GST_BUFFER_PTS(GST_PAD_PROBE_INFO_BUFFER(info)) = GST_CLOCK_TIME_NONE;
        return GST_PAD_PROBE_OK;
      },
      nullptr, nullptr);
  gst_object_unref(pad);
  send(stream.source.get(), 0, 12, "GRAY8");
  const Outcome outcome = stream.finish();
  CHECK(outcome.ended);
  REQUIRE_FALSE(outcome.payloads.empty());
  CHECK(outcome.payloads.front() == kPayload);
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

int main(int argc, char** argv) {
  gst_init(&argc, &argv);
  const int result = doctest::Context(argc, argv).run();
  gst_deinit();  // so that the tracer of leaks reports
  return result;
}
