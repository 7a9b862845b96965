// Common parts of the bindings: NumPy arrays as views of the core, regions, objects shared by several threads, and one
// register function per room.
#pragma once

#include <pybind11/complex.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "ocisac/core/region.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/core/views.hpp"

// A region is a tuple (x, y, width, height) in Python; ocisac_fast.core.Region is one with names.
namespace pybind11::detail {

template <>
struct type_caster<ocisac::Region> {
  PYBIND11_TYPE_CASTER(ocisac::Region, const_name("tuple[int, int, int, int]"));

  bool load(handle source, bool convert) {
    if (!isinstance<tuple>(source) || len(source) != 4) return false;
    std::array<make_caster<std::size_t>, 4> numbers;
    for (std::size_t i = 0; i < numbers.size(); ++i)
      if (!numbers[i].load(reinterpret_borrow<tuple>(source)[i], convert)) return false;
    const auto number = [&](std::size_t i) { return cast_op<std::size_t>(numbers[i]); };
    value = {number(0), number(1), number(2), number(3)};
    return true;
  }

  static handle cast(const ocisac::Region& region, return_value_policy, handle) {
    return make_tuple(region.x, region.y, region.width, region.height).release();
  }
};

}  // namespace pybind11::detail

namespace ocisac::bindings {

namespace py = pybind11;

// In the order of the rooms.
void register_core(py::module_& module);
void register_camera(py::module_& module);
void register_light(py::module_& module);
void register_tones(py::module_& module);
void register_exposure(py::module_& module);
void register_chips(py::module_& module);
void register_packets(py::module_& module);
void register_lights(py::module_& module);
void register_receiver(py::module_& module);
void register_cleaning(py::module_& module);
void register_scene(py::module_& module);

// Converted to dense float64 if the caller's array has another type or layout.
using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

template <class T, int flags>
std::span<const T> span_of(const py::array_t<T, flags>& array) {
  return {array.data(), static_cast<std::size_t>(array.size())};
}

template <class T>
std::span<T> mutable_span_of(py::array_t<T>& array) {
  return {array.mutable_data(), static_cast<std::size_t>(array.size())};
}

// A new array of `shape` with a copy of `values` (any range).
template <class Values>
auto array_of(const Values& values, const std::vector<py::ssize_t>& shape) {
  py::array_t<typename Values::value_type> array(shape);
  std::ranges::copy(values, array.mutable_data());
  return array;
}

template <class Values>
auto array_of(const Values& values) {
  return array_of(values, {static_cast<py::ssize_t>(values.size())});
}

// (rows,), (rows, columns) or (frames, rows, columns) as a typed view; the array must outlive the view.
// Unaligned memory and foreign byte order are rejected, since the Python layer copies such arrays first.
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

// By its number: comparing data types by their meaning takes NumPy 2 µs and more.
template <class T>
bool holds(const py::array& array) {
  const py::dtype dtype = array.dtype();
  return dtype.num() == py::detail::npy_format_descriptor<T>::value && (dtype.byteorder() == '=' || sizeof(T) == 1);
}

// True for an array, of no other class, that any_view() takes as it is.
inline bool is_viewable(const py::object& object) {
  if (!Py_IS_TYPE(object.ptr(), py::detail::npy_api::get().PyArray_Type_)) return false;
  const auto array = py::reinterpret_borrow<py::array>(object);
  const bool known =
      holds<std::uint8_t>(array) || holds<std::uint16_t>(array) || holds<float>(array) || holds<double>(array);
  const bool whole = std::all_of(array.strides(), array.strides() + array.ndim(),
                                 [&](py::ssize_t stride) { return stride % array.itemsize() == 0; });
  return known && whole && array.ndim() >= 1 && array.ndim() <= 3 && array.size() > 0 &&
         (array.flags() & py::detail::npy_api::NPY_ARRAY_ALIGNED_) != 0;
}

inline AnyFramesView any_view(const py::array& array) {
  const auto is = [&](auto sample) { return holds<decltype(sample)>(array); };
  const auto view = [&](auto sample) -> AnyFramesView {
    using T = decltype(sample);
    return typed_view<const T>(array, static_cast<const T*>(array.data()));
  };
  if (is(std::uint8_t{})) return view(std::uint8_t{});
  if (is(std::uint16_t{})) return view(std::uint16_t{});
  if (is(float{})) return view(float{});
  if (is(double{})) return view(double{});
  refuse("columns", "dtype " + py::str(array.dtype()).cast<std::string>(), "uint8, uint16, float32 or float64");
}

inline std::vector<AnyFramesView> views_of(const std::vector<py::array>& arrays) {
  std::vector<AnyFramesView> views;
  views.reserve(arrays.size());
  for (const auto& array : arrays) views.push_back(any_view(array));
  return views;
}

template <class T = double>
FramesView<T> mutable_view(py::array& array, const char* allowed = "float64") {
  require(array.writeable(), "out", "a read-only array", "a writable array");
  require(array.dtype().equal(py::dtype::of<T>()), "out", "dtype " + py::str(array.dtype()).cast<std::string>(),
          allowed);
  return typed_view<T>(array, static_cast<T*>(array.mutable_data()));
}

// Runs body() without the interpreter's lock; body must not use Python objects.
template <class Body>
auto unlocked(Body body) {
  const py::gil_scoped_release released;
  return body();
}

// A stateful object of the core that several Python threads may share: one call at a time.
template <class T>
class Shared {
 public:
  explicit Shared(T object) : held_(std::make_unique<Held>(std::move(object))) {}

  // Runs body(T&) without the interpreter's lock; calls of other threads wait.
  template <class Body>
  auto call(Body body) {
    const py::gil_scoped_release released;
    const std::scoped_lock alone(held_->busy);
    return body(held_->object);
  }

 private:
  struct Held {
    explicit Held(T&& given) : object(std::move(given)) {}
    T object;
    std::mutex busy;
  };
  std::unique_ptr<Held> held_;  // pybind11 moves the result of a factory
};

}  // namespace ocisac::bindings
