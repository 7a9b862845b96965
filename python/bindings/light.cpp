#include "bindings.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "ocisac/light/integrate_exposure.hpp"
#include "ocisac/light/waveform.hpp"

namespace ocisac::bindings {

namespace {

using Integers = py::array_t<std::int64_t, py::array::c_style>;

std::vector<double> vector_of(const Doubles& array) {
  const auto values = span_of(array);
  return {values.begin(), values.end()};
}

// out: (frames, rows), float64, aligned, any strides.
void integrate(const Waveform& waveform, const Camera& camera, const Integers& rows, double start,
               const Integers& frames, py::array& out) {
  require(out.ndim() == 2, "out", "another shape", "one value for each frame and row");
  const FramesView<double> view = mutable_view(out);  // its rows are frames
  const auto row_numbers = span_of(rows);
  const auto frame_numbers = span_of(frames);
  unlocked([&] { integrate_exposure(waveform, camera, row_numbers, start, frame_numbers, view); });
}

py::array_t<double> sample(const Waveform& waveform, const Doubles& times) {
  py::array_t<double> out(std::vector<py::ssize_t>(times.shape(), times.shape() + times.ndim()));
  const auto at = span_of(times);
  const auto values = mutable_span_of(out);
  unlocked([&] { sample_waveform(waveform, at, values); });
  return out;
}

}  // namespace

void register_light(py::module_& module) {
  using py::arg;
  py::class_<Waveform>(module, "Waveform")
      .def(
          "__add__", [](const Waveform& a, const Waveform& b) { return a + b; }, py::is_operator(), arg("other"))
      .def(
          "__mul__", [](const Waveform& a, const Waveform& b) { return a * b; }, py::is_operator(), arg("other"));
  module.def(
      "constant", [](double level) { return Waveform(level); }, arg("level"));
  module.def(
      "tone",
      [](double frequency, double amplitude, double phase, double depth) {
        return Waveform(Tone{frequency, amplitude, phase, depth});
      },
      arg("frequency"), arg("amplitude"), arg("phase"), arg("depth"));
  module.def(
      "square_wave",
      [](double frequency, double duty, double amplitude, double phase) {
        return Waveform(SquareWave{frequency, duty, amplitude, phase});
      },
      arg("frequency"), arg("duty"), arg("amplitude"), arg("phase"));
  module.def(
      "triangle_wave",
      [](double frequency, double amplitude, double phase, double depth) {
        return Waveform(TriangleWave{frequency, amplitude, phase, depth});
      },
      arg("frequency"), arg("amplitude"), arg("phase"), arg("depth"));
  module.def(
      "chips",
      [](const Doubles& levels, double chip_rate, double start, bool repeat, double amplitude, double rise,
         double fall) {
        return Waveform(Chips{vector_of(levels), chip_rate, start, repeat, amplitude, rise, fall});
      },
      arg("levels"), arg("chip_rate"), arg("start"), arg("repeat"), arg("amplitude"), arg("rise"), arg("fall"));
  module.def(
      "samples",
      [](const Doubles& values, double sample_rate, double start, bool repeat) {
        return Waveform(Samples{vector_of(values), sample_rate, start, repeat});
      },
      arg("values"), arg("sample_rate"), arg("start"), arg("repeat"));
  module.def("exposure_response", py::vectorize(&exposure_response), arg("frequency"), arg("exposure"));
  module.def("integrate_exposure", &integrate, arg("waveform"), arg("camera"), arg("rows"), arg("start"), arg("frames"),
             arg("out"));
  module.def("sample_waveform", &sample, arg("waveform"), arg("times"));
}

}  // namespace ocisac::bindings
