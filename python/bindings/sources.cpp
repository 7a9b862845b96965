#include "ocisac/receiver/sources.hpp"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <vector>

#include "arrays.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace {

// In the order of ocisac_fast.sources.LightSource.
py::tuple as_tuple(const LightSource& s) {
  return py::make_tuple(s.frame, s.x, s.y, s.width, s.height, s.frequency, s.frequency_std, s.gain, s.gain_std, s.phase,
                        s.mean, s.snr, s.amplitude, s.share, s.carries_data, s.reflection_of, s.reflection_by_phase,
                        s.merged, s.joined, s.flags);
}

py::list detect(const py::array& frames, const Camera& camera, double false_alarms, double min_cycles,
                std::size_t most) {
  const AnyFramesView view = any_view(frames);
  std::vector<LightSource> sources;
  {
    const py::gil_scoped_release unlocked;
    sources = detect_sources(view, camera, {false_alarms, min_cycles, most});
  }
  py::list list;
  for (const LightSource& source : sources) list.append(as_tuple(source));
  return list;
}

}  // namespace

void register_sources(py::module_& module) {
  module.def("detect_sources", &detect, py::arg("frames"), py::arg("camera"), py::arg("false_alarms"),
             py::arg("min_cycles"), py::arg("most"));
}

}  // namespace ocisac::bindings
