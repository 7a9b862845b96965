#include "bindings.hpp"
#include "ocisac/lights/detect_sources.hpp"

namespace ocisac::bindings {

namespace {

// In the order of ocisac_fast.sources.LightSource.
py::tuple as_tuple(const LightSource& s) {
  return py::make_tuple(s.frame, s.box, s.frequency, s.frequency_std, s.gain, s.gain_std, s.phase, s.mean, s.snr,
                        s.amplitude, s.share, s.carries_data, s.reflection_of, s.reflection_by_phase, s.merged,
                        s.joined, s.flags);
}

py::list as_list(const std::vector<LightSource>& sources) {
  py::list list;
  for (const LightSource& source : sources) list.append(as_tuple(source));
  return list;
}

py::list detect(const py::array& frames, const Camera& camera, double false_alarms, double min_cycles,
                std::size_t max_sources) {
  const AnyFramesView view = any_view(frames);
  return as_list(unlocked([&] { return detect_sources(view, camera, {false_alarms, min_cycles, max_sources}); }));
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

}  // namespace

void register_lights(py::module_& module) {
  using py::arg;
  module.def("detect_sources", &detect, arg("frames"), arg("camera"), arg("false_alarms"), arg("min_cycles"),
             arg("max_sources"));
  module.def("follow_sources", &follow, arg("frame"), arg("camera"), arg("expected"), arg("false_alarms"),
             arg("min_cycles"));
}

}  // namespace ocisac::bindings
