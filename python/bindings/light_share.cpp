#include "ocisac/cleaning/light_share.hpp"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <limits>
#include <optional>

#include "ocisac/core/require.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace py = pybind11;

namespace {

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

std::span<const double> span_of(const Doubles& values) {
  return {values.data(), static_cast<std::size_t>(values.size())};
}

BandedPicture picture_of(const Doubles& light, const Doubles& variance) {
  require(light.ndim() == 3, "picture", light.ndim(), "3 dimensions (frames, rows, columns)");
  const auto length = [&](py::ssize_t axis) { return static_cast<std::size_t>(light.shape(axis)); };
  return {span_of(light), span_of(variance), length(0), length(1), length(2)};
}

py::array_t<double> array_of(const std::vector<double>& values, const std::vector<py::ssize_t>& shape) {
  py::array_t<double> array(shape);
  std::copy(values.begin(), values.end(), array.mutable_data());
  return array;
}

py::array_t<double> run_light_share(const Doubles& light, const Doubles& variance, const Doubles& row_light,
                                    bool smooth) {
  const BandedPicture picture = picture_of(light, variance);
  std::vector<double> share;
  {
    const py::gil_scoped_release released;
    share = light_share(picture, span_of(row_light), smooth);
  }
  return array_of(share, {light.shape(1), light.shape(2)});
}

py::tuple run_refine_row_light(const Doubles& light, const Doubles& variance, const Doubles& share,
                               const Doubles& row_light, int steps, const std::optional<Doubles>& basis,
                               double deviation) {
  const BandedPicture picture = picture_of(light, variance);
  const RowModel model{basis ? span_of(*basis) : std::span<const double>{}, deviation};
  RowLight result;
  {
    const py::gil_scoped_release released;
    result = refine_row_light(picture, span_of(share), span_of(row_light), steps, model);
  }
  return py::make_tuple(array_of(result.light, {light.shape(1)}), array_of(result.information, {light.shape(1)}));
}

}  // namespace

void register_light_share(py::module_& module) {
  module.def("light_share", &run_light_share, py::arg("light"), py::arg("variance"), py::arg("row_light"),
             py::arg("smooth") = true);
  module.def("refine_row_light", &run_refine_row_light, py::arg("light"), py::arg("variance"), py::arg("share"),
             py::arg("row_light"), py::arg("steps"), py::arg("basis") = py::none(),
             py::arg("deviation") = std::numeric_limits<double>::infinity());
}

}  // namespace ocisac::bindings
