#include "ocisac/tones/projection.hpp"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <span>
#include <string>

#include "arrays.hpp"
#include "ocisac/tones/read_bytes.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace {

using Weights = py::array_t<double, py::array::c_style | py::array::forcecast>;

RowWeights row_weights(const Weights& weights, std::size_t rows, int row_group, int limbs) {
  require(weights.ndim() == 2, "weights", std::to_string(weights.ndim()) + " dimensions", "(outputs, groups)");
  const auto outputs = static_cast<std::size_t>(weights.shape(0));
  return {{weights.data(), static_cast<std::size_t>(weights.size())}, outputs, rows, row_group, limbs};
}

py::array_t<double> as_array(std::span<const double> values, const std::vector<py::ssize_t>& shape) {
  py::array_t<double> array(shape);
  std::ranges::copy(values, array.mutable_data());
  return array;
}

// sums (outputs, columns), totals, squares and maximum (columns,) of one frame.
py::tuple project_frame(const py::array& columns, const RowWeights& weights) {
  require(columns.ndim() == 2, "columns", std::to_string(columns.ndim()) + " dimensions", "(rows, columns)");
  require(static_cast<std::size_t>(columns.shape(0)) == weights.rows(), "columns",
          std::to_string(columns.shape(0)) + " rows", "as many as the weights are for");
  const AnyFramesView view = any_view(columns);
  const auto count = static_cast<std::size_t>(columns.shape(1));
  Projection result;
  {
    const py::gil_scoped_release unlocked;
    result = project(view, 0, 0, count, weights);
  }
  const py::ssize_t width = columns.shape(1);
  return py::make_tuple(as_array(result.sums, {static_cast<py::ssize_t>(weights.outputs()), width}),
                        as_array(result.totals, {width}), as_array(result.squares, {width}),
                        as_array(result.maximum, {width}));
}

py::tuple project_once(const py::array& columns, const Weights& weights, int row_group, int limbs) {
  require(columns.ndim() == 2, "columns", std::to_string(columns.ndim()) + " dimensions", "(rows, columns)");
  return project_frame(columns, row_weights(weights, static_cast<std::size_t>(columns.shape(0)), row_group, limbs));
}

std::uint64_t read_array(const py::array_t<std::uint8_t>& array, int threads) {
  require((array.flags() & py::array::c_style) != 0, "array", "strides", "dense bytes");
  const std::span bytes(array.data(), static_cast<std::size_t>(array.size()));
  const py::gil_scoped_release unlocked;
  return read_bytes(bytes, threads);
}

}  // namespace

void register_projection(py::module_& module) {
  py::class_<RowWeights>(module, "RowWeights")
      .def(py::init(&row_weights), py::arg("weights"), py::arg("rows"), py::arg("row_group"), py::arg("limbs"));
  module.def("project", &project_frame, py::arg("columns"), py::arg("weights"));
  module.def("project", &project_once, py::arg("columns"), py::arg("weights"), py::arg("row_group"), py::arg("limbs"));
  module.def("read_bytes", &read_array, py::arg("array").noconvert(), py::arg("threads") = 1);
  module.def("force_simd_target", &force_simd_target, py::arg("name"));
}

}  // namespace ocisac::bindings
