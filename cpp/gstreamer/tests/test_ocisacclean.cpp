// ocisacclean in real pipelines, against the truth and against the C interface.
#include <doctest/doctest.h>
#include <ocisac/ocisac.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <map>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "pipelines.hpp"

namespace {

using namespace pipelines;

constexpr int kRows = 96, kColumns = 32;
constexpr double kRowTime = 1e-5, kPeriod = 11.3, kStep = 0.37;  // rows per cycle; cycles from frame to frame
const std::string kClean = "ocisacclean name=clean row-time=1e-5 ";
const std::string kSink = " ! fakesink name=sink sync=false";

// Boxes, each colour darker than the one before: the picture without bands.
double box(std::size_t row, std::size_t column, unsigned component) {
  const double gray = 60 + 25 * static_cast<double>((row / 29 + column / 9 + (row / 17) * (column / 13)) % 4);
  return gray * (1 - 0.2 * component);
}

// The same under a tone, whose brightest rows are as bright as the boxes. `unit`: DN of 1/255.
Pixels banded(int frame, unsigned unit = 1) {
  return [=](std::size_t row, std::size_t column, unsigned component) {
    const double angle = 2 * std::numbers::pi * (static_cast<double>(row) / kPeriod + kStep * frame);
    const double noise = static_cast<double>((row * 7919 + column * 104729 + component) % 5) / 4 - 0.5;
    return unit *
           static_cast<unsigned>(std::lround(box(row, column, component) * (1 + 0.7 * std::cos(angle)) / 1.7 + noise));
  };
}

// A picture of noise: without bands.
unsigned unbanded(std::size_t row, std::size_t column, unsigned) {
  return 60 + static_cast<unsigned>((row * kColumns + column) * 2654435761U >> 13 & 63U);
}

// Components of pictures, row by row.
using Picture = std::vector<std::vector<unsigned>>;

Picture picture(const Pixels& pixels, unsigned components, std::size_t rows = kRows, std::size_t columns = kColumns) {
  Picture result(components);
  for (unsigned component = 0; component < components; ++component)
    for (std::size_t row = 0; row < rows; ++row)
      for (std::size_t column = 0; column < columns; ++column)
        result[component].push_back(pixels(row, column, component));
  return result;
}

// Root of the mean square of the deviation from the boxes, DN of 1/255.
double error_of(const Picture& picture, unsigned component, unsigned unit = 1) {
  double sum = 0;
  for (std::size_t i = 0; i < picture[component].size(); ++i) {
    const double truth = box(i / kColumns, i % kColumns, component);
    sum += std::pow(picture[component][i] / static_cast<double>(unit) - truth, 2);
  }
  return std::sqrt(sum / static_cast<double>(picture[component].size()));
}

// Cleans frames of the same values by the C interface.
class Direct {
 public:
  using Change = void (*)(ocisac_cleaner_options&);
  explicit Direct(Change change = [](ocisac_cleaner_options&) {}) {
    ocisac_cleaner_options options;
    ocisac_cleaner_options_init(&options);
    options.row_time = kRowTime;
    options.frame_time = 1 / 30.0;
    change(options);
    REQUIRE(ocisac_cleaner_create(&options, &cleaner_) == OCISAC_OK);
  }
  Direct(const Direct&) = delete;
  Direct& operator=(const Direct&) = delete;
  ~Direct() { ocisac_cleaner_destroy(cleaner_); }

  void push(const ocisac_plane* planes, std::size_t count, double time = NAN) const {
    ocisac_stamp stamp;
    ocisac_stamp_init(&stamp);
    stamp.time = time;
    REQUIRE(ocisac_cleaner_push_stamped(cleaner_, planes, count, &stamp, nullptr) == OCISAC_OK);
  }

  // The first `planes` components are cleaned.
  Picture operator()(Picture picture, std::size_t planes, bool wide) {
    return wide ? cleaned<std::uint16_t>(std::move(picture), planes)
                : cleaned<std::uint8_t>(std::move(picture), planes);
  }

 private:
  template <class Sample>
  Picture cleaned(Picture picture, std::size_t count) {
    constexpr auto bytes = static_cast<std::ptrdiff_t>(sizeof(Sample));
    std::vector<std::vector<Sample>> samples;
    for (std::size_t k = 0; k < count; ++k) samples.emplace_back(picture[k].begin(), picture[k].end());
    std::vector<ocisac_plane> planes;
    for (auto& each : samples)
      planes.push_back(
          {each.data(), bytes > 1 ? OCISAC_GRAY16 : OCISAC_GRAY8, kColumns, kRows, bytes * kColumns, bytes});
    push(planes.data(), count);
    for (std::size_t k = 0; k < count; ++k) std::copy(samples[k].begin(), samples[k].end(), picture[k].begin());
    return picture;
  }

  ocisac_cleaner* cleaner_ = nullptr;
};

// Frames that come to a pad, all their components.
GstPadProbeReturn collect(GstPad* pad, GstPadProbeInfo* probe, gpointer data) {
  GstCaps* caps = gst_pad_get_current_caps(pad);
  GstVideoInfo info;
  GstVideoFrame video;
  if (gst_video_info_from_caps(&info, caps) &&
      gst_video_frame_map(&video, &info, GST_PAD_PROBE_INFO_BUFFER(probe), GST_MAP_READ)) {
    Picture picture;
    for (unsigned k = 0; k < GST_VIDEO_INFO_N_COMPONENTS(&info); ++k) picture.push_back(values_of(video, k));
    static_cast<std::vector<Picture>*>(data)->push_back(std::move(picture));
    gst_video_frame_unmap(&video);
  }
  gst_caps_unref(caps);
  return GST_PAD_PROBE_OK;
}

GstPadProbeReturn mark_discontinuity(GstPad*, GstPadProbeInfo* probe, gpointer) {
  GST_BUFFER_FLAG_SET(GST_PAD_PROBE_INFO_BUFFER(probe), GST_BUFFER_FLAG_DISCONT);
  return GST_PAD_PROBE_OK;
}

// s, of this thread.
double thread_time() {
  std::timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// Before and after an element, on its streaming thread: what it takes is added.
GstPadProbeReturn start_watch(GstPad*, GstPadProbeInfo*, gpointer sum) {
  *static_cast<double*>(sum) -= thread_time();
  return GST_PAD_PROBE_OK;
}
GstPadProbeReturn stop_watch(GstPad*, GstPadProbeInfo*, gpointer sum) {
  *static_cast<double*>(sum) += thread_time();
  return GST_PAD_PROBE_OK;
}

double number_in(const Structure& message, const char* field) {
  double value = NAN;
  gst_structure_get_double(message.get(), field, &value);
  return value;
}

// The element's count of the frame since its stream began.
int frame_in(const Structure& message) {
  gint64 value = -1;
  gst_structure_get_int64(message.get(), "frame", &value);
  return static_cast<int>(value);
}

std::vector<int> frames_in(const Outcome& outcome) {
  std::vector<int> frames;
  for (const auto& message : outcome.messages) frames.push_back(frame_in(message));
  return frames;
}

void send_banded(const Stream& stream, int first, int end, const Form& form = {"GRAY8", kColumns, kRows}) {
  for (int frame = first; frame < end; ++frame) send(stream.source.get(), form, frame, banded(frame));
}

}  // namespace

TEST_CASE("bands go, to the pixel as by the C interface, in every format, and the rest stays") {
  // Three frames as stored, and as the C interface cleans them.
  struct Frames {
    std::vector<Picture> stored, cleaned;
    Frames(unsigned count, bool wide, unsigned unit) {
      Direct direct;
      for (int frame = 0; frame < 3; ++frame) {
        stored.push_back(picture(banded(frame, unit), count));
        cleaned.push_back(direct(stored.back(), count, wide));
      }
    }
  };
  std::map<std::pair<unsigned, bool>, Frames> directly;
  for (const std::string format :
       {"GRAY8", "GRAY16_LE", "I420", "YV12", "NV12", "NV21", "Y42B", "Y444", "YUY2", "YVYU", "UYVY",
        "RGB",   "BGR",       "RGBx", "BGRx", "xRGB", "xBGR", "RGBA", "BGRA", "ARGB", "ABGR", "GBR"}) {
    CAPTURE(format);
    const GstVideoFormatInfo* info = gst_video_format_get_info(gst_video_format_from_string(format.c_str()));
    const unsigned count = GST_VIDEO_FORMAT_INFO_IS_RGB(info) ? 3 : 1;
    const bool wide = GST_VIDEO_FORMAT_INFO_DEPTH(info, 0) > 8;
    const unsigned unit = wide ? 257 : 1;
    const auto& direct = directly.try_emplace({count, wide}, count, wide, unit).first->second;
    std::vector<Picture> outputs;
    Stream stream(kSource + kClean + kSink);
    stream.probe("sink", "sink", collect, &outputs);
    for (int frame = 0; frame < 3; ++frame)
      send(stream.source.get(), {format.c_str(), kColumns, kRows}, frame, banded(frame, unit));
    const Outcome outcome = stream.finish();
    CHECK(outcome.error == "");
    REQUIRE(outputs.size() == 3);
    REQUIRE(outcome.messages.size() == 3);
    for (int frame = 0; frame < 3; ++frame) {
      const auto at = static_cast<std::size_t>(frame);
      for (unsigned k = 0; k < outputs[at].size(); ++k) {
        CAPTURE(k);
        if (k >= count) {
          CHECK(std::ranges::all_of(outputs[at][k], [](unsigned value) { return value == 128; }));
          continue;
        }
        CHECK(outputs[at][k] == direct.cleaned[at][k]);
        CHECK(error_of(outputs[at], k, unit) < 0.15 * error_of(direct.stored[at], k, unit));
      }
      const auto& message = outcome.messages[at];
      CHECK(gst_structure_has_name(message.get(), "ocisacclean"));
      CHECK(std::string(gst_structure_get_string(message.get(), "model")) == "tone");
      CHECK(std::string(gst_structure_get_string(message.get(), "unchanged")) == "");
      CHECK(number_in(message, "frequency_hz") == doctest::Approx(1 / (kPeriod * kRowTime)).epsilon(0.01));
      CHECK(number_in(message, "light_left") < 0.1);
      CHECK(frame_in(message) == frame);
    }
  }
}

TEST_CASE("properties and the caps' range reach the cleaner") {
  struct Case {
    std::string properties;
    GstVideoColorRange range;
    Direct::Change change;
  };
  const Case cases[] = {
      {"", GST_VIDEO_COLOR_RANGE_16_235, [](auto& options) { options.dark_level = 16, options.white_level = 235; }},
      {"dark-level=8 white-level=250", GST_VIDEO_COLOR_RANGE_16_235,
       [](auto& options) { options.dark_level = 8, options.white_level = 250; }},
      {"level=mean", GST_VIDEO_COLOR_RANGE_0_255, [](auto& options) { options.mean_level = 1; }},
      {"model=rows", GST_VIDEO_COLOR_RANGE_0_255, [](auto& options) { options.model = OCISAC_MODEL_ROWS; }},
      {"max-gain=2", GST_VIDEO_COLOR_RANGE_0_255, [](auto& options) { options.max_gain = 2; }},
      {"toe=0", GST_VIDEO_COLOR_RANGE_0_255, [](auto& options) { options.toe = 0; }},
      {"toe=0.05", GST_VIDEO_COLOR_RANGE_0_255, [](auto& options) { options.toe = 0.05; }},
      {"tone-curve=srgb", GST_VIDEO_COLOR_RANGE_0_255, [](auto& options) { options.tone_curve = OCISAC_SRGB; }},
      {"tone-curve=gamma gamma=1.5", GST_VIDEO_COLOR_RANGE_0_255,
       [](auto& options) { options.tone_curve = OCISAC_GAMMA, options.gamma = 1.5; }},
      {"scan-axis=-y", GST_VIDEO_COLOR_RANGE_0_255, [](auto& options) { options.scan_axis = OCISAC_UP; }},
      {"scan-axis=x", GST_VIDEO_COLOR_RANGE_0_255, [](auto& options) { options.scan_axis = OCISAC_RIGHT; }},
      {"frame-rate=25", GST_VIDEO_COLOR_RANGE_0_255, [](auto& options) { options.frame_time = 1 / 25.0; }},
  };
  for (const Case& each : cases) {
    CAPTURE(each.properties);
    std::vector<Picture> outputs;
    Stream stream(kSource + kClean + each.properties + kSink);
    stream.probe("sink", "sink", collect, &outputs);
    send_banded(stream, 0, 2, {"Y444", kColumns, kRows, each.range});
    CHECK(stream.finish().error == "");
    REQUIRE(outputs.size() == 2);
    Direct direct(each.change);
    for (int frame = 0; frame < 2; ++frame)
      CHECK(outputs[static_cast<std::size_t>(frame)][0] == direct(picture(banded(frame), 1), 1, false)[0]);
  }
}

TEST_CASE("buffers of others keep their pixels") {
  std::vector<Picture> given, cleaned;
  Stream stream(kSource + "tee name=t t. ! queue ! " + kClean + kSink + " t. ! queue ! fakesink name=other sync=false");
  stream.probe("sink", "sink", collect, &cleaned);
  stream.probe("other", "sink", collect, &given);
  send_banded(stream, 0, 4);
  CHECK(stream.finish().ended);
  REQUIRE(given.size() == 4);
  REQUIRE(cleaned.size() == 4);
  for (int frame = 0; frame < 4; ++frame) {
    const auto at = static_cast<std::size_t>(frame);
    CHECK(given[at] == picture(banded(frame), 1));
    CHECK(error_of(cleaned[at], 0) < 0.15 * error_of(given[at], 0));
  }
}

TEST_CASE("a frame that cleaning would make worse passes as it is, with the reason") {
  std::vector<Picture> outputs;
  Stream stream(kSource + kClean + kSink);
  stream.probe("sink", "sink", collect, &outputs);
  send(stream.source.get(), {"GRAY8", kColumns, kRows}, 0, unbanded);
  const Outcome outcome = stream.finish();
  CHECK(outcome.ended);
  REQUIRE(outcome.messages.size() == 1);
  CHECK(std::string(gst_structure_get_string(outcome.messages[0].get(), "unchanged")) != "");
  REQUIRE(outputs.size() == 1);
  CHECK(outputs[0] == picture(unbanded, 1));
  const Outcome black =
      run("videotestsrc num-buffers=2 pattern=black ! video/x-raw,format=GRAY8,width=64,height=48 ! " + kClean + kSink);
  REQUIRE(black.messages.size() == 2);
  for (const auto& message : black.messages) {
    CHECK(std::string(gst_structure_get_string(message.get(), "unchanged")) ==
          "no bands: all rows have the same light");
    CHECK_FALSE(gst_structure_has_field(message.get(), "frequency_hz"));
  }
  // bars and ball of a source of test pictures, which have no bands either
  const Outcome test =
      run("videotestsrc num-buffers=3 pattern=ball ! video/x-raw,format=BGRx,width=64,height=48 ! " + kClean + kSink);
  CHECK(test.ended);
  CHECK(test.messages.size() == 3);
}

TEST_CASE("a file is cleaned: filesrc, decodebin") {
  {
    Stream writing("appsrc name=source format=time ! matroskamux ! filesink location=bands.mkv");
    send_banded(writing, 0, 5);
    CHECK(writing.finish().ended);
  }
  const Outcome outcome = run("filesrc location=bands.mkv ! decodebin ! " + kClean + kSink);
  CHECK(outcome.ended);
  CHECK(frames_in(outcome) == std::vector{0, 1, 2, 3, 4});
  for (const auto& message : outcome.messages) CHECK(number_in(message, "light_left") < 0.1);
}

TEST_CASE("an error names the property or the frame, and its value") {
  const std::string source = "videotestsrc num-buffers=2 ! video/x-raw,width=64,height=64,format=";
  CHECK(run(source + "GRAY8 ! ocisacclean ! fakesink").error.find("row_time: got 0") == 0);
  CHECK(run(source + "GRAY8 ! ocisacclean row-time=1e-5 max-gain=1 ! fakesink").error.find("max_gain: got 1") == 0);
  CHECK(run(source + "GRAY8 ! ocisacclean row-time=1e-5 dark-level=9 white-level=9 ! fakesink")
            .error.find("white_level: got 9") == 0);
  CHECK(run(source + "I420,interlace-mode=interleaved ! ocisacclean row-time=1e-5 ! fakesink")
            .error.find("interlaced video") == 0);
  CHECK(run("videotestsrc num-buffers=2 ! video/x-raw,width=64,height=7,format=GRAY8 ! " + kClean + "! fakesink")
            .error.find("frames: got ") == 0);
}

TEST_CASE("other caps in the stream begin another stream") {
  std::vector<Picture> outputs;
  Stream stream(kSource + kClean + kSink);
  stream.probe("sink", "sink", collect, &outputs);
  send_banded(stream, 0, 2);
  send_banded(stream, 2, 4, {"I420", kColumns + 8, kRows + 20});
  send_banded(stream, 4, 5, {"BGRx", kColumns, kRows});
  const Outcome outcome = stream.finish();
  CHECK(outcome.ended);
  CHECK(frames_in(outcome) == std::vector{0, 1, 0, 1, 0});
  REQUIRE(outputs.size() == 5);
  const Picture direct = Direct()(picture(banded(4), 3), 3, false);
  for (unsigned k = 0; k < 3; ++k) CHECK(outputs[4][k] == direct[k]);
}

TEST_CASE("time that jumps back and discontinuities begin another stream, and so does what follows a flush") {
  std::vector<Picture> outputs;
  Stream back(kSource + kClean + kSink);
  back.probe("sink", "sink", collect, &outputs);
  send_banded(back, 3, 6);
  send_banded(back, 0, 2);
  CHECK(frames_in(back.finish()) == std::vector{0, 1, 2, 0, 1});
  REQUIRE(outputs.size() == 5);
  CHECK(outputs[3] == Direct()(picture(banded(0), 1), 1, false));

  Stream gaps(kSource + "identity name=gaps ! " + kClean + kSink);
  gaps.probe("gaps", "src", mark_discontinuity);
  send_banded(gaps, 0, 3);
  CHECK(frames_in(gaps.finish()) == std::vector{0, 0, 0});

  seek("videotestsrc num-buffers=300 ! video/x-raw,format=GRAY8,width=32,height=240 ! " + kClean + "! fakesink",
       {2, 1});
}

TEST_CASE("the phase of slow bands advances in frames that are missing") {
  constexpr int rows = 240, columns = 64;
  const auto scene = [](std::size_t row, std::size_t column) {  // boxes without a period
    const auto place = static_cast<std::uint32_t>(row / 29 * 100 + column / 8);
    return 60 + 10 * static_cast<double>((place * 2654435761U >> 13U) % 6);
  };
  std::vector<Picture> outputs;
  Stream stream(kSource + kClean + kSink);
  stream.probe("sink", "sink", collect, &outputs);
  const Direct direct;
  std::vector<Picture> stored, cleaned;
  for (const int number : {0, 1, 2, 3, 4, 6, 7, 10, 11}) {
    const Pixels pixels = [&](std::size_t row, std::size_t column, unsigned) {
      const double angle = 2 * std::numbers::pi * (1.2 * static_cast<double>(row) / rows + 0.3 * number);
      const double noise = static_cast<double>((row * 7919 + column * 104729 + static_cast<std::size_t>(number)) % 5);
      return static_cast<unsigned>(
          std::lround(scene(row, column) * (1 + 0.3 * std::cos(angle)) / 1.3 + noise / 4 - 0.5));
    };
    send(stream.source.get(), {"GRAY8", columns, rows}, number, pixels);
    stored.push_back(picture(pixels, 1, rows, columns));
    std::vector<std::uint8_t> bytes(stored.back()[0].begin(), stored.back()[0].end());
    const ocisac_plane plane = {bytes.data(), OCISAC_GRAY8, columns, rows, columns, 1};
    direct.push(&plane, 1,
                static_cast<double>(gst_util_uint64_scale(static_cast<guint64>(number), GST_SECOND, 30)) / GST_SECOND);
    cleaned.push_back({{bytes.begin(), bytes.end()}});
  }
  CHECK(frames_in(stream.finish()) == std::vector{0, 1, 2, 3, 4, 5, 6, 7, 8});
  CHECK(outputs == cleaned);
  // Root of the mean square of the deviation from the scene, after the best gain.
  const auto error = [&](const Picture& picture) {
    double both = 0, own = 0, all = 0;
    for (std::size_t i = 0; i < picture[0].size(); ++i) {
      const double truth = scene(i / columns, i % columns), value = picture[0][i];
      both += value * truth;
      own += value * value;
      all += truth * truth;
    }
    return std::sqrt(all - both * both / own);
  };
  for (std::size_t k = 5; k < outputs.size(); ++k) CHECK(error(outputs[k]) < 0.5 * error(stored[k]));
}

TEST_CASE("frames without time stamps are one stream") {
  Stream stream("appsrc name=source format=bytes ! capsfilter ! " + kClean + kSink);
  stream.probe("source", "src", remove_stamp);
  send_banded(stream, 0, 3);
  CHECK(frames_in(stream.finish()) == std::vector{0, 1, 2});
}

TEST_CASE("a stalled sink does not keep a cleaned pipeline from ending") {
  Stream stream(kSource + kClean + "! queue max-size-buffers=1 ! fakesink name=sink sync=true");
  send_banded(stream, 0, 4);
  send_banded(stream, 100000, 100004);  // due in an hour
}  // the destructor stops it

TEST_CASE("late frames are dropped, and nothing upstream hears of it") {
  int heard = 0;
  Stream stream(kSource + kClean + kSink);
  const Element clean = stream.element("clean");
  GstPad* above = gst_element_get_static_pad(stream.source.get(), "src");
  gst_pad_add_probe(
      above, GST_PAD_PROBE_TYPE_EVENT_UPSTREAM,
      [](GstPad*, GstPadProbeInfo* info, gpointer count) {
        *static_cast<int*>(count) += GST_EVENT_TYPE(GST_PAD_PROBE_INFO_EVENT(info)) == GST_EVENT_QOS;
        return GST_PAD_PROBE_OK;
      },
      &heard, nullptr);
  gst_object_unref(above);
  send_banded(stream, 0, 1);
  GstBus* bus = gst_element_get_bus(stream.pipeline.get());
  GstMessage* first = gst_bus_timed_pop_filtered(bus, 60 * GST_SECOND, GST_MESSAGE_ELEMENT);
  gst_object_unref(bus);
  REQUIRE(first != nullptr);
  gst_message_unref(first);
  // The sink got it so late that frames before 2/10 s cannot be in time.
  GstPad* below = gst_element_get_static_pad(clean.get(), "src");
  CHECK(gst_pad_send_event(below, gst_event_new_qos(GST_QOS_TYPE_UNDERFLOW, 2.0, GST_SECOND / 5, 0)));
  gst_object_unref(below);
  send_banded(stream, 1, 9);
  const Outcome outcome = stream.finish();
  CHECK(frames_in(outcome) == std::vector{1, 2});  // frames 7 and 8 of the source
  CHECK(heard == 0);
}

TEST_CASE("a stopped pipeline runs again, and post-messages=false keeps the bus quiet") {
  Stream stream(kSource + kClean + "post-messages=false " + kSink);
  send_banded(stream, 0, 2);
  CHECK(stream.finish().messages.empty());
  gst_element_set_state(stream.pipeline.get(), GST_STATE_READY);
  g_object_set(stream.element("clean").get(), "post-messages", TRUE, nullptr);
  gst_element_set_state(stream.pipeline.get(), GST_STATE_PLAYING);
  send_banded(stream, 0, 2);
  CHECK(frames_in(stream.finish()) == std::vector{0, 1});
}

TEST_CASE("properties of the cleaner keep what they are given") {
  const Element clean(gst_element_factory_make("ocisacclean", nullptr));
  REQUIRE(clean);
  gdouble toe = 0, gain = 0, white = 0;
  g_object_get(clean.get(), "toe", &toe, "max-gain", &gain, "white-level", &white, nullptr);
  CHECK(toe == -1);
  CHECK(gain == 8);
  CHECK(white == -1);
  g_object_set(clean.get(), "toe", 0.25, "max-gain", 3.0, nullptr);
  gst_util_set_object_arg(G_OBJECT(clean.get()), "model", "chips");
  gst_util_set_object_arg(G_OBJECT(clean.get()), "level", "mean");
  gint model = -1, level = -1;
  g_object_get(clean.get(), "toe", &toe, "max-gain", &gain, "model", &model, "level", &level, nullptr);
  CHECK(toe == 0.25);
  CHECK(gain == 3);
  CHECK(model == OCISAC_MODEL_CHIPS);
  CHECK(level == 1);
}

// Not run by itself: `ocisac_gstreamer_tests --no-skip -tc='1080p*'` prints times.
TEST_CASE("1080p at the rate of the C interface" * doctest::skip()) {
  constexpr int rows = 1080, columns = 1920, frames = 20;
  constexpr std::size_t size = std::size_t{rows} * columns;
  for (int turn = 0; turn < 3; ++turn) {
    double piped = 0, direct = 0;
    Stream stream(kSource + kClean + kSink);
    stream.probe("clean", "sink", start_watch, &piped);
    stream.probe("clean", "src", stop_watch, &piped);
    const Direct cleaner;
    for (int frame = 0; frame < frames; ++frame) {
      send(stream.source.get(), {"GRAY8", columns, rows}, frame, banded(frame));
      std::vector<std::uint8_t> pixels;
      for (std::size_t i = 0; i < size; ++i)
        pixels.push_back(static_cast<std::uint8_t>(banded(frame)(i / columns, i % columns, 0)));
      const ocisac_plane plane = {pixels.data(), OCISAC_GRAY8, columns, rows, columns, 1};
      direct -= thread_time();
      cleaner.push(&plane, 1);
      direct += thread_time();
    }
    CHECK(stream.finish().messages.size() == frames);
    MESSAGE(frames, " frames of 1080p, processor time: ocisacclean ", piped, " s, ocisac_cleaner_push ", direct,
            " s, ratio ", piped / direct);
  }
}
