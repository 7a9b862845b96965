#include "ocisac/camera/camera.hpp"

#include <pybind11/complex.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <string>

#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace py = pybind11;

namespace {

ToneCurve::Kind tone_curve_kind(const std::string& name) {
  if (name == "linear") return ToneCurve::Kind::linear;
  if (name == "gamma") return ToneCurve::Kind::gamma;
  if (name == "srgb") return ToneCurve::Kind::srgb;
  refuse("tone_curve", name, "linear, gamma or srgb");
}

Camera make_camera(double row_time, std::optional<double> exposure, std::optional<double> frame_time,
                   const std::string& tone_curve, double gamma, double dark_level, std::optional<double> white) {
  if (white) require(*white > dark_level, "white_level", *white, "a finite number above dark_level");
  const Camera camera{
      row_time, exposure, frame_time, {tone_curve_kind(tone_curve), gamma, dark_level, white.value_or(0)}};
  check(camera);
  return camera;
}

}  // namespace

void register_camera(py::module_& module) {
  py::class_<Camera>(module, "Camera")
      .def(py::init(&make_camera), py::arg("row_time"), py::arg("exposure"), py::arg("frame_time"),
           py::arg("tone_curve"), py::arg("gamma"), py::arg("dark_level"), py::arg("white_level"));
  module.def("exposure_response", py::vectorize(&exposure_response), py::arg("frequency"), py::arg("exposure"));
}

}  // namespace ocisac::bindings
