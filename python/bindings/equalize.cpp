#include "ocisac/tones/equalize.hpp"

#include <pybind11/numpy.h>

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "ocisac/core/require.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace py = pybind11;

namespace {

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

EqualizerMethod equalizer_method(const std::string& name) {
  if (name == "inverse") return EqualizerMethod::inverse;
  if (name == "wiener") return EqualizerMethod::wiener;
  refuse("method", name, "inverse or wiener");
}

py::array_t<double> array_of(const std::vector<FrequencyBand>& bands) {
  py::array_t<double> array({static_cast<py::ssize_t>(bands.size()), py::ssize_t{2}});
  auto values = array.mutable_unchecked<2>();
  for (py::ssize_t i = 0; i < values.shape(0); ++i) {
    values(i, 0) = bands[static_cast<std::size_t>(i)].low;
    values(i, 1) = bands[static_cast<std::size_t>(i)].high;
  }
  return array;
}

py::array_t<double> array_of(const std::vector<double>& values) {
  return py::array_t<double>(static_cast<py::ssize_t>(values.size()), values.data());
}

py::tuple run_equalize(const py::array& columns, const Camera& camera, const std::string& method, const Doubles& noise,
                       double max_boost, py::array out) {
  const AnyFramesView view = any_view(columns);
  const FramesView<double> result = mutable_view(out);
  const EqualizerSettings settings{equalizer_method(method), max_boost,
                                   std::span(noise.data(), static_cast<std::size_t>(noise.size()))};
  EqualizerReport report;
  {
    const py::gil_scoped_release released;
    report = equalize(view, camera, settings, result);
  }
  return py::make_tuple(array_of(report.frequencies_lost), array_of(report.noise_gain), array_of(report.noise));
}

}  // namespace

void register_equalize(py::module_& module) {
  module.def("equalize", &run_equalize, py::arg("columns"), py::arg("camera"), py::arg("method"), py::arg("noise"),
             py::arg("max_boost"), py::arg("out"));
  module.def(
      "lost_frequencies",
      [](const Camera& camera, double max_boost) { return array_of(lost_frequencies(camera, max_boost)); },
      py::arg("camera"), py::arg("max_boost"));
}

}  // namespace ocisac::bindings
