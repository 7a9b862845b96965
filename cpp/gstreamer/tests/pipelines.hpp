// Pipelines for tests: made from text, fed with pictures, and watched to their ends.
#pragma once

#include <gst/app/gstappsrc.h>
#include <gst/gst.h>
#include <gst/video/video.h>

#include <cstddef>
#include <functional>
#include <initializer_list>
#include <memory>
#include <string>
#include <vector>

namespace pipelines {

struct Unref {
  void operator()(void* object) const { gst_object_unref(object); }
};
using Element = std::unique_ptr<GstElement, Unref>;

struct FreeStructure {
  void operator()(GstStructure* structure) const { gst_structure_free(structure); }
};
using Structure = std::unique_ptr<GstStructure, FreeStructure>;

struct Outcome {
  std::vector<Structure> messages;  // of elements
  std::string error;
  bool ended = false;
};

Element launch(const std::string& text);

// Reads the bus until the stream ends, an error comes, or 60 s are over.
Outcome wait(GstElement* pipeline);

Outcome run(const std::string& text);

// Flushing seeks to these times (s), one after the other, of a pipeline that is paused.
void seek(const std::string& text, std::initializer_list<int> places);

const std::string kSource = "appsrc name=source format=time ! ";

// A pipeline that begins with kSource, and plays.
struct Stream {
  Element pipeline, source;
  explicit Stream(const std::string& text);
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;
  ~Stream();

  Element element(const char* name) const;
  void probe(const char* element, const char* pad, GstPadProbeCallback call, gpointer data = nullptr) const;
  Outcome finish();
};

// A probe of buffers that takes their time stamps away.
GstPadProbeReturn remove_stamp(GstPad*, GstPadProbeInfo* probe, gpointer);

// Pictures for an appsrc.
struct Form {
  const char* format;
  int width, height;
  GstVideoColorRange range = GST_VIDEO_COLOR_RANGE_0_255;
};

// The DN of a component (luma; red, green, blue) at a place.
using Pixels = std::function<unsigned(std::size_t row, std::size_t column, unsigned component)>;

// Sends a frame at number/30 s. Components of chroma and alpha are 128.
void send(GstElement* source, const Form& form, int number, const Pixels& pixels);

// The values of a component, row by row.
std::vector<unsigned> values_of(GstVideoFrame& video, unsigned component);

}  // namespace pipelines
