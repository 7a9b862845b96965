#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <string>
#include <vector>

#include "arrays.hpp"
#include "channel_arguments.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/chips/detect_chips.hpp"
#include "ocisac/chips/error_rates.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace {

// (frames, chips, columns), the first chip's number, the method that was used.
py::tuple detect(const py::array& columns, const Camera& camera, const py::tuple& channel, const std::string& method) {
  const AnyFramesView view = any_view(columns);
  const ChannelEstimate estimate = channel_of(channel);
  const DetectorMethod detector = detector_method(method);
  ColumnChips found;
  {
    const py::gil_scoped_release released;
    found = detect_chips(view, camera, estimate, detector);
  }
  const Shape shape = shape_of(view);
  auto ratios = new_array({static_cast<py::ssize_t>(shape.frames), static_cast<py::ssize_t>(found.count),
                           static_cast<py::ssize_t>(shape.columns)});
  std::ranges::copy(found.llr, ratios.mutable_data());
  return py::make_tuple(ratios, found.first, kDetectorNames[static_cast<std::size_t>(found.method)]);
}

py::tuple error_rates(double rows_per_chip, double exposure, double noise) {
  DetectorErrorRates rates{};
  {
    const py::gil_scoped_release released;
    rates = detector_error_rates(rows_per_chip, exposure, noise);
  }
  return py::make_tuple(rates.slicer, rates.inverse, rates.wiener, rates.dfe, rates.mlse);
}

}  // namespace

void register_detection(py::module_& module) {
  using py::arg;
  module.def("detect_chips", &detect, arg("columns"), arg("camera"), arg("channel"), arg("method"));
  module.def("detector_error_rates", &error_rates, arg("rows_per_chip"), arg("exposure"), arg("noise"));
}

}  // namespace ocisac::bindings
