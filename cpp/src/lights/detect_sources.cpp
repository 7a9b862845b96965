#include "ocisac/lights/detect_sources.hpp"

#include <cmath>
#include <span>
#include <utility>

#include "lights/box_gain.hpp"
#include "lights/detection.hpp"
#include "lights/light_search.hpp"
#include "lights/light_verdict.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

void check(const DetectOptions& options) {
  require(options.false_alarms > 0 && options.false_alarms <= 1, "false_alarms", options.false_alarms,
          "above 0 up to 1 in a picture");
  require(std::isfinite(options.min_cycles) && options.min_cycles >= 2, "min_cycles", options.min_cycles,
          "a finite number, 2 or above");
  require(options.max_sources >= 1, "max_sources", options.max_sources, "1 or above");
}

LightSource source_of(const SearchedFrame& in, const Detection& found) {
  const RefinedLight& light = found.light;
  const double row_time = in.camera.row_time, frequency = light.frequency / row_time;
  const MeasuredLight gain = box_gain(frame_of(in.frame.frames, in.frame.index), in.camera, light.box, frequency);
  LightSource source;
  source.frame = in.frame.index;
  source.box = found.box;
  source.probability = found.probability;
  source.frequency = frequency;
  source.frequency_std = std::hypot(light.frequency_std, light.systematic.std) / row_time;
  source.gain = gain.gain, source.gain_std = gain.gain_std;
  source.phase = gain.phase;
  source.mean = gain.mean;
  source.snr = light.snr;
  source.amplitude = light.amplitude;
  source.share = light.edges > 0 ? 0 : light.periodic;  // none of data
  source.carries_data = !is_tone(found);
  source.reflection_of = found.reflection_of;
  source.reflection_by_phase = found.reflection_by_phase;
  source.merged = found.merged;
  source.joined = found.joined;
  source.flags = gain.flags | flag_if(light.systematic.doubted, flag::model_misfit);
  return source;
}

std::vector<LightSource> sources_of(const SearchedFrame& in, const Detections& found) {
  std::vector<LightSource> sources;
  for (const Detection& one : listed_lights(in, found)) sources.push_back(source_of(in, one));
  return sources;
}

Region whole(const Shape& shape) { return {0, 0, shape.columns, shape.rows}; }

void check(const Region& region, const Shape& shape, const char* name) {
  const auto fits = [](std::size_t first, std::size_t count, std::size_t all) {
    return count > 0 && first < all && count <= all - first;
  };
  require(fits(region.x, region.width, shape.columns), name, region.x, "columns of the frame");
  require(fits(region.y, region.height, shape.rows), name, region.y, "rows of the frame");
}

void check(const ExpectedLight& light, const Shape& shape, const Camera& camera) {
  check(light.box, shape, "box");
  check(light.region, shape, "region");
  require(light.frequency > 0 && light.frequency * camera.row_time < 0.5, "frequency", light.frequency,
          "above 0, below half the row rate");
}

}  // namespace

std::vector<LightSource> detect_sources(const AnyFramesView& frames, const Camera& camera,
                                        const DetectOptions& options) {
  check(frames, kMostLight);
  check(camera);
  check(options);
  std::vector<LightSource> sources;
  const Shape shape = shape_of(frames);
  require(options.frame.value_or(0) < shape.frames, "frame", options.frame.value_or(0), "a frame of those given");
  const std::size_t first = options.frame.value_or(0), end = options.frame ? first + 1 : shape.frames;
  for (std::size_t frame = first; frame < end; ++frame) {
    const SearchedFrame in = searched_frame(frames, frame, camera, options);
    const std::vector<LightSource> found = sources_of(in, searched(in, {}, whole(shape)));
    sources.insert(sources.end(), found.begin(), found.end());
  }
  return sources;
}

std::vector<LightCandidate> light_candidates(const AnyFramesView& frame, const Camera& camera, bool data) {
  check(frame);
  check(camera);
  const SearchedFrame in = searched_frame(frame, 0, camera, {.min_cycles = 2});
  const Detections found = searched(in, {}, whole(shape_of(frame)));
  return data ? found.waveforms : tone_candidates(in, found);
}

std::vector<LightSource> follow_sources(const AnyFramesView& frame, const Camera& camera,
                                        std::span<const ExpectedLight> expected, const DetectOptions& options) {
  check(frame);
  check(camera);
  check(options);
  const Shape shape = shape_of(frame);
  require(shape.frames == 1, "frame", shape.frames, "one frame");
  for (const ExpectedLight& light : expected) check(light, shape, camera);
  const SearchedFrame in = searched_frame(frame, 0, camera, options);
  Detections found;
  std::vector<const ExpectedLight*> missing;
  for (const ExpectedLight& light : expected) {
    const double cycles_per_row = light.frequency * camera.row_time;
    if (light.seen && !light.data && add_expected(in, light.box, cycles_per_row, found)) continue;
    missing.push_back(&light);
  }
  for (const ExpectedLight* light : missing) {
    const double cycles_per_row = light->frequency * camera.row_time;
    found = searched(in, std::move(found), light->region, {&cycles_per_row, light->data ? 0U : 1U});
  }
  return sources_of(in, found);
}

}  // namespace ocisac
