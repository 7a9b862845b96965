#include "bindings.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/lights/calibrate.hpp"
#include "ocisac/lights/detect_sources.hpp"
#include "ocisac/lights/known_light.hpp"
#include "tones.hpp"

namespace ocisac::bindings {

namespace {

// In the order of ocisac_fast.sources.LightSource.
py::tuple as_tuple(const LightSource& s) {
  return py::make_tuple(s.frame, s.box, s.probability, s.frequency, s.frequency_std, s.gain, s.gain_std, s.phase,
                        s.mean, s.snr, s.amplitude, s.share, s.carries_data, s.reflection_of, s.reflection_by_phase,
                        s.merged, s.joined, s.flags);
}

py::list as_list(const std::vector<LightSource>& sources) {
  py::list list;
  for (const LightSource& source : sources) list.append(as_tuple(source));
  return list;
}

py::list detect(const py::array& frames, const Camera& camera, double false_alarms, double min_cycles,
                std::size_t max_sources, std::optional<std::size_t> frame) {
  const AnyFramesView view = any_view(frames);
  const DetectOptions options{false_alarms, min_cycles, max_sources, frame};
  return as_list(unlocked([&] { return detect_sources(view, camera, options); }));
}

// In the order of LightCandidate.
py::list candidates(const py::array& frame, const Camera& camera, bool data) {
  const AnyFramesView view = any_view(frame);
  py::list list;
  for (const LightCandidate& one : unlocked([&] { return light_candidates(view, camera, data); }))
    list.append(py::make_tuple(one.box, one.frequency, one.probability, one.odds, one.terms));
  return list;
}

// In the order of ExpectedLight.
using Expected = std::tuple<Region, double, Region, bool, bool>;

py::list follow(const py::array& frame, const Camera& camera, const std::vector<Expected>& expected,
                double false_alarms, double min_cycles) {
  const AnyFramesView view = any_view(frame);
  std::vector<ExpectedLight> lights;
  for (const auto& [box, frequency, region, seen, data] : expected)
    lights.push_back({box, frequency, region, seen, data});
  return as_list(unlocked([&] { return follow_sources(view, camera, lights, {false_alarms, min_cycles}); }));
}

// In the order of ocisac_fast.lights.recognition.
py::tuple as_tuple(const MeasuredLight& s) {
  return py::make_tuple(s.box, s.frequency, s.swing, s.gain, s.gain_std, s.phase, s.mean, s.flags);
}

KnownLight known_light(const py::array& frame, const Camera& camera, const Region& box, double frequency,
                       bool carries_data) {
  const AnyFramesView view = any_view(frame);
  return unlocked([&] { return KnownLight(view, camera, box, frequency, carries_data); });
}

py::object find_again(const KnownLight& light, const py::array& frame,
                      const std::vector<std::array<std::ptrdiff_t, 2>>& corners) {
  const AnyFramesView view = any_view(frame);
  std::vector<Place> places;
  for (const auto& [x, y] : corners) places.push_back({x, y});
  const auto found = unlocked([&] { return light.find(view, places); });
  return found ? as_tuple(*found) : py::object(py::none());
}

// Row time (s), its standard error (s), the tone as of find() and the light's probability. Bounds: cycles per row.
py::tuple row_time_of(const py::array& columns, double frequency, const Bounds& bounds, const std::string& waveform,
                      bool select_columns) {
  const AnyFramesView view = any_view(columns);
  Camera per_row;
  per_row.row_time = 1;
  FrequencySearch search = search_of(per_row, bounds, waveform, select_columns);
  search.saturation = saturation_level(view, per_row.tone_curve);
  const Calibration result = unlocked([&] { return calibrate(view, frequency, search); });
  return py::make_tuple(result.row_time, result.row_time_std, tuple_of(result.found), result.probability);
}

std::size_t colour_of(const std::vector<py::array>& colours, const Camera& camera, const Bounds& bounds,
                      const std::string& waveform) {
  const auto views = views_of(colours);
  FrequencySearch search = search_of(camera, bounds, waveform, true);
  if (!views.empty()) search.saturation = saturation_level(views.front(), camera.tone_curve);
  return unlocked([&] { return pick_colour(views, search); });
}

}  // namespace

void register_lights(py::module_& module) {
  using py::arg;
  module.def("detect_sources", &detect, arg("frames"), arg("camera"), arg("false_alarms"), arg("min_cycles"),
             arg("max_sources"), arg("frame"));
  module.def("light_candidates", &candidates, arg("frame"), arg("camera"), arg("data"));
  module.def("follow_sources", &follow, arg("frame"), arg("camera"), arg("expected"), arg("false_alarms"),
             arg("min_cycles"));
  py::class_<KnownLight>(module, "KnownLight")
      .def(py::init(&known_light), arg("frame"), arg("camera"), arg("box"), arg("frequency"), arg("carries_data"))
      .def_property_readonly("first", [](const KnownLight& light) { return as_tuple(light.first()); })
      .def("find", &find_again, arg("frame"), arg("places"));
  module.def("calibrate", &row_time_of, arg("columns"), arg("frequency"), arg("bounds"), arg("waveform"),
             arg("select_columns"));
  module.def("pick_colour", &colour_of, arg("colours"), arg("camera"), arg("bounds"), arg("waveform"));
}

}  // namespace ocisac::bindings
