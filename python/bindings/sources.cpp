#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <tuple>
#include <vector>

#include "arrays.hpp"
#include "ocisac/lights/detect_sources.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace {

// In the order of ocisac_fast.sources.LightSource.
py::tuple as_tuple(const LightSource& s) {
  return py::make_tuple(s.frame, s.x, s.y, s.width, s.height, s.frequency, s.frequency_std, s.gain, s.gain_std, s.phase,
                        s.mean, s.snr, s.amplitude, s.share, s.carries_data, s.reflection_of, s.reflection_by_phase,
                        s.merged, s.joined, s.flags);
}

py::list as_list(const std::vector<LightSource>& sources) {
  py::list list;
  for (const LightSource& source : sources) list.append(as_tuple(source));
  return list;
}

py::list detect(const py::array& frames, const Camera& camera, double false_alarms, double min_cycles,
                std::size_t max_sources) {
  const AnyFramesView view = any_view(frames);
  std::vector<LightSource> sources;
  {
    const py::gil_scoped_release unlocked;
    sources = detect_sources(view, camera, {false_alarms, min_cycles, max_sources});
  }
  return as_list(sources);
}

// As of ExpectedLight.
using Corners = std::tuple<std::size_t, std::size_t, std::size_t, std::size_t>;
using Expected = std::tuple<Corners, double, Corners, bool, bool>;

py::list follow(const py::array& frame, const Camera& camera, const std::vector<Expected>& expected,
                double false_alarms, double min_cycles) {
  const AnyFramesView view = any_view(frame);
  const auto region = [](const Corners& corners) {
    const auto& [x, y, width, height] = corners;
    return Region{x, y, width, height};
  };
  std::vector<ExpectedLight> lights;
  for (const auto& [box, frequency, where, seen, data] : expected)
    lights.push_back({region(box), frequency, region(where), seen, data});
  std::vector<LightSource> sources;
  {
    const py::gil_scoped_release unlocked;
    sources = follow_sources(view, camera, lights, {false_alarms, min_cycles});
  }
  return as_list(sources);
}

}  // namespace

void register_sources(py::module_& module) {
  module.def("detect_sources", &detect, py::arg("frames"), py::arg("camera"), py::arg("false_alarms"),
             py::arg("min_cycles"), py::arg("max_sources"));
  module.def("follow_sources", &follow, py::arg("frame"), py::arg("camera"), py::arg("expected"),
             py::arg("false_alarms"), py::arg("min_cycles"));
}

}  // namespace ocisac::bindings
