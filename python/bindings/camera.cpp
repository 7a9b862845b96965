#include "ocisac/camera/camera.hpp"

#include "bindings.hpp"
#include "ocisac/camera/linear_light.hpp"

namespace ocisac::bindings {

namespace {

ToneCurve::Kind tone_curve_kind(const std::string& name) {
  if (name == "linear") return ToneCurve::Kind::linear;
  if (name == "gamma") return ToneCurve::Kind::gamma;
  if (name == "srgb") return ToneCurve::Kind::srgb;
  if (name == "hlg") return ToneCurve::Kind::hlg;
  if (name == "pq") return ToneCurve::Kind::pq;
  refuse("tone_curve", name, "linear, gamma, srgb, hlg or pq");
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
  using py::arg;
  py::class_<Camera>(module, "Camera")
      .def(py::init(&make_camera), arg("row_time"), arg("exposure"), arg("frame_time"), arg("tone_curve"), arg("gamma"),
           arg("dark_level"), arg("white_level"));
  // `type_maximum`: of the stored samples, 1 for floats.
  const auto define = [&](const char* name, double (*convert)(const ToneCurve&, double, double)) {
    module.def(
        name,
        [convert](const Doubles& values, const Camera& camera, double type_maximum) {
          py::array_t<double> out(std::vector<py::ssize_t>(values.shape(), values.shape() + values.ndim()));
          std::transform(values.data(), values.data() + values.size(), out.mutable_data(),
                         [&](double value) { return convert(camera.tone_curve, value, type_maximum); });
          return out;
        },
        arg("values"), arg("camera"), arg("type_maximum"));
  };
  define("linear_light", &linear_light);
  define("stored_value", &stored_value);
  define("light_per_step", &light_per_step);
  // `type_maximum`: NaN for floats.
  module.def(
      "saturation_level",
      [](const Camera& camera, double type_maximum) { return saturation_level(camera.tone_curve, type_maximum); },
      arg("camera"), arg("type_maximum"));
}

}  // namespace ocisac::bindings
