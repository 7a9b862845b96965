// NumPy arrays as views of the core, without a copy; the only other way is a new array that NumPy owns.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstdint>
#include <string>
#include <vector>

#include "ocisac/core/require.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac::bindings {

namespace py = pybind11;

// (rows,), (rows, columns) or (frames, rows, columns) as a typed view; the array must outlive the view.
// Memory that no typed pointer may read (unaligned, foreign byte order) is refused: the Python layer copies it first.
template <class T>
FramesView<T> typed_view(const py::array& array, T* data) {
  const auto stride = [&](py::ssize_t axis) {
    const auto bytes = array.strides(axis);
    const auto size = static_cast<py::ssize_t>(sizeof(T));
    require(bytes % size == 0, "columns", "an unaligned array", "strides that are whole elements");
    return static_cast<std::ptrdiff_t>(bytes / size);
  };
  const auto length = [&](py::ssize_t axis) { return static_cast<std::size_t>(array.shape(axis)); };
  switch (array.ndim()) {
    case 1: return {data, 1, length(0), 1, 0, stride(0), 0};
    case 2: return {data, 1, length(0), length(1), 0, stride(0), stride(1)};
    case 3: return {data, length(0), length(1), length(2), stride(0), stride(1), stride(2)};
    default:
      refuse("columns", std::to_string(array.ndim()) + " dimensions",
             "(rows,), (rows, columns) or (frames, rows, columns)");
  }
}

inline AnyFramesView any_view(const py::array& array) {
  const auto dtype = array.dtype();
  const auto is = [&](auto sample) { return dtype.equal(py::dtype::of<decltype(sample)>()); };
  const auto view = [&](auto sample) -> AnyFramesView {
    using T = decltype(sample);
    return typed_view<const T>(array, static_cast<const T*>(array.data()));
  };
  if (is(std::uint8_t{})) return view(std::uint8_t{});
  if (is(std::uint16_t{})) return view(std::uint16_t{});
  if (is(float{})) return view(float{});
  if (is(double{})) return view(double{});
  refuse("columns", "dtype " + py::str(dtype).cast<std::string>(), "uint8, uint16, float32 or float64");
}

// A new float64 array of `shape` and a view of it.
inline py::array_t<double> new_array(const std::vector<py::ssize_t>& shape) { return py::array_t<double>(shape); }

inline FramesView<double> mutable_view(py::array& array) {
  require(array.writeable(), "out", "a read-only array", "a writable array");
  require(array.dtype().equal(py::dtype::of<double>()), "out", "dtype " + py::str(array.dtype()).cast<std::string>(),
          "float64");
  return typed_view<double>(array, static_cast<double*>(array.mutable_data()));
}

}  // namespace ocisac::bindings
