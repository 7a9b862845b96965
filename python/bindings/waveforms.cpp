// Waveforms and the exposure integration of them.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "arrays.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/integrate_exposure.hpp"
#include "ocisac/light/waveform.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace py = pybind11;

namespace {

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Integers = py::array_t<std::int64_t, py::array::c_style>;

template <class T, int flags>
std::span<const T> span_of(const py::array_t<T, flags>& array) {
  return {array.data(), static_cast<std::size_t>(array.size())};
}

std::vector<double> vector_of(const Doubles& array) {
  const auto values = span_of(array);
  return {values.begin(), values.end()};
}

// out: (frames, rows), float64, aligned, any strides.
void integrate(const Waveform& waveform, const Camera& camera, const Integers& rows, double start,
               const Integers& frames, py::array& out) {
  require(out.ndim() == 2 && out.shape(0) == frames.size() && out.shape(1) == rows.size(), "out", "another shape",
          "one value for each frame and row");
  const FramesView<double> view = mutable_view(out);  // frames run along its rows
  const auto row_numbers = span_of(rows);
  const auto frame_numbers = span_of(frames);
  const py::gil_scoped_release release;
  std::vector<double> buffer(view.column_stride == 1 ? 0 : row_numbers.size());
  for (std::size_t j = 0; j < frame_numbers.size(); ++j) {
    const std::span<double> means =
        buffer.empty() ? std::span(view.at(0, j, 0), row_numbers.size()) : std::span(buffer);
    integrate_exposure(waveform, camera, row_numbers, start, frame_numbers[j], means);
    for (std::size_t i = 0; i < buffer.size(); ++i) view(0, j, i) = buffer[i];
  }
}

py::array_t<double> sample(const Waveform& waveform, const Doubles& times) {
  py::array_t<double> out(std::vector<py::ssize_t>(times.shape(), times.shape() + times.ndim()));
  const auto at = span_of(times);
  const std::span<double> values(out.mutable_data(), at.size());
  const py::gil_scoped_release release;
  sample_waveform(waveform, at, values);
  return out;
}

}  // namespace

void register_waveforms(py::module_& module) {
  py::class_<Waveform>(module, "Waveform")
      .def(
          "__add__", [](const Waveform& a, const Waveform& b) { return a + b; }, py::is_operator(), py::arg("other"))
      .def(
          "__mul__", [](const Waveform& a, const Waveform& b) { return a * b; }, py::is_operator(), py::arg("other"));
  module.def(
      "constant", [](double level) { return Waveform(level); }, py::arg("level"));
  module.def(
      "tone",
      [](double frequency, double amplitude, double phase, double depth) {
        return Waveform(Tone{frequency, amplitude, phase, depth});
      },
      py::arg("frequency"), py::arg("amplitude"), py::arg("phase"), py::arg("depth"));
  module.def(
      "square_wave",
      [](double frequency, double duty, double amplitude, double phase) {
        return Waveform(SquareWave{frequency, duty, amplitude, phase});
      },
      py::arg("frequency"), py::arg("duty"), py::arg("amplitude"), py::arg("phase"));
  module.def(
      "chips",
      [](const Doubles& levels, double chip_rate, double start, bool repeat, double amplitude) {
        return Waveform(Chips{vector_of(levels), chip_rate, start, repeat, amplitude});
      },
      py::arg("levels"), py::arg("chip_rate"), py::arg("start"), py::arg("repeat"), py::arg("amplitude"));
  module.def(
      "samples",
      [](const Doubles& values, double sample_rate, double start, bool repeat) {
        return Waveform(Samples{vector_of(values), sample_rate, start, repeat});
      },
      py::arg("values"), py::arg("sample_rate"), py::arg("start"), py::arg("repeat"));
  module.def("integrate_exposure", &integrate, py::arg("waveform"), py::arg("camera"), py::arg("rows"),
             py::arg("start"), py::arg("frames"), py::arg("out"));
  module.def("sample_waveform", &sample, py::arg("waveform"), py::arg("times"));
}

}  // namespace ocisac::bindings
