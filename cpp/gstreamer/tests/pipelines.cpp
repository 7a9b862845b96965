#include "pipelines.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <cstring>

namespace pipelines {

namespace {

// Calls `call(value)` for each value of a component, row by row, read and written in the component's own width.
template <class Call>
void each_value(GstVideoFrame& video, unsigned component, Call call) {
  const bool wide = GST_VIDEO_FRAME_COMP_DEPTH(&video, component) > 8;
  for (int row = 0; row < GST_VIDEO_FRAME_COMP_HEIGHT(&video, component); ++row)
    for (int column = 0; column < GST_VIDEO_FRAME_COMP_WIDTH(&video, component); ++column) {
      auto* place = static_cast<std::uint8_t*>(GST_VIDEO_FRAME_COMP_DATA(&video, component)) +
                    row * GST_VIDEO_FRAME_COMP_STRIDE(&video, component) +
                    column * GST_VIDEO_FRAME_COMP_PSTRIDE(&video, component);
      std::uint16_t value = *place;
      if (wide) std::memcpy(&value, place, sizeof value);
      const auto changed =
          static_cast<std::uint16_t>(call(value, static_cast<std::size_t>(row), static_cast<std::size_t>(column)));
      if (changed == value) continue;
      *place = static_cast<std::uint8_t>(changed);
      if (wide) std::memcpy(place, &changed, sizeof changed);
    }
}

}  // namespace

Element launch(const std::string& text) {
  GError* error = nullptr;
  Element pipeline(gst_parse_launch(text.c_str(), &error));
  const std::string problem = error != nullptr ? error->message : "";
  g_clear_error(&error);
  CAPTURE(text);
  REQUIRE(problem == "");
  return pipeline;
}

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
    if (GST_MESSAGE_TYPE(message) == GST_MESSAGE_ELEMENT)
      outcome.messages.emplace_back(gst_structure_copy(gst_message_get_structure(message)));
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

void seek(const std::string& text, std::initializer_list<int> places) {
  const Element pipeline = launch(text);
  gst_element_set_state(pipeline.get(), GST_STATE_PAUSED);
  CHECK(gst_element_get_state(pipeline.get(), nullptr, nullptr, 20 * GST_SECOND) == GST_STATE_CHANGE_SUCCESS);
  for (const int place : places)
    CHECK(gst_element_seek_simple(pipeline.get(), GST_FORMAT_TIME, GST_SEEK_FLAG_FLUSH,
                                  place * static_cast<gint64>(GST_SECOND)));
  CHECK(gst_element_get_state(pipeline.get(), nullptr, nullptr, 20 * GST_SECOND) == GST_STATE_CHANGE_SUCCESS);
  gst_element_set_state(pipeline.get(), GST_STATE_NULL);
}

Stream::Stream(const std::string& text) : pipeline(launch(text)), source(element("source")) {
  gst_element_set_state(pipeline.get(), GST_STATE_PLAYING);
}

Stream::~Stream() { gst_element_set_state(pipeline.get(), GST_STATE_NULL); }

Element Stream::element(const char* name) const { return Element(gst_bin_get_by_name(GST_BIN(pipeline.get()), name)); }

void Stream::probe(const char* name, const char* pad_name, GstPadProbeCallback call, gpointer data) const {
  GstPad* pad = gst_element_get_static_pad(element(name).get(), pad_name);
  gst_pad_add_probe(pad, GST_PAD_PROBE_TYPE_BUFFER, call, data, nullptr);
  gst_object_unref(pad);
}

GstPadProbeReturn remove_stamp(GstPad*, GstPadProbeInfo* probe, gpointer) {
  GST_BUFFER_PTS(GST_PAD_PROBE_INFO_BUFFER(probe)) = GST_CLOCK_TIME_NONE;
  return GST_PAD_PROBE_OK;
}

Outcome Stream::finish() {
  gst_app_src_end_of_stream(GST_APP_SRC(source.get()));
  return wait(pipeline.get());
}

void send(GstElement* source, const Form& form, int number, const Pixels& pixels) {
  GstVideoInfo info;
  gst_video_info_set_format(&info, gst_video_format_from_string(form.format), static_cast<guint>(form.width),
                            static_cast<guint>(form.height));
  info.colorimetry.range = form.range;
  info.fps_n = 30;
  GstCaps* caps = gst_video_info_to_caps(&info);
  gst_app_src_set_caps(GST_APP_SRC(source), caps);
  gst_caps_unref(caps);
  GstBuffer* buffer = gst_buffer_new_allocate(nullptr, GST_VIDEO_INFO_SIZE(&info), nullptr);
  gst_buffer_memset(buffer, 0, 128, GST_VIDEO_INFO_SIZE(&info));
  GstVideoFrame video;
  REQUIRE(gst_video_frame_map(&video, &info, buffer, GST_MAP_READWRITE));
  const unsigned components = GST_VIDEO_INFO_IS_RGB(&info) ? 3 : 1;
  for (unsigned component = 0; component < components; ++component)
    each_value(video, component,
               [&](unsigned, std::size_t row, std::size_t column) { return pixels(row, column, component); });
  gst_video_frame_unmap(&video);
  GST_BUFFER_PTS(buffer) = gst_util_uint64_scale(static_cast<guint64>(number), GST_SECOND, 30);
  GST_BUFFER_DURATION(buffer) = GST_SECOND / 30;
  REQUIRE(gst_app_src_push_buffer(GST_APP_SRC(source), buffer) == GST_FLOW_OK);
}

std::vector<unsigned> values_of(GstVideoFrame& video, unsigned component) {
  std::vector<unsigned> values;
  each_value(video, component, [&](unsigned value, std::size_t, std::size_t) {
    values.push_back(value);
    return value;
  });
  return values;
}

}  // namespace pipelines
