#include <limits>

#include "bindings.hpp"
#include "ocisac/cleaning/light_share.hpp"

namespace ocisac::bindings {

namespace {

BandedPicture picture_of(const Doubles& light, const Doubles& variance) {
  require(light.ndim() == 3, "picture", light.ndim(), "3 dimensions (frames, rows, columns)");
  const auto length = [&](py::ssize_t axis) { return static_cast<std::size_t>(light.shape(axis)); };
  return {span_of(light), span_of(variance), length(0), length(1), length(2)};
}

py::array_t<double> run_light_share(const Doubles& light, const Doubles& variance, const Doubles& row_light,
                                    bool smooth) {
  const BandedPicture picture = picture_of(light, variance);
  const auto share = unlocked([&] { return light_share(picture, span_of(row_light), smooth); });
  return array_of(share, {light.shape(1), light.shape(2)});
}

py::tuple run_refine_row_light(const Doubles& light, const Doubles& variance, const Doubles& share,
                               const Doubles& row_light, int steps, const std::optional<Doubles>& basis,
                               double deviation) {
  const BandedPicture picture = picture_of(light, variance);
  const RowLightPrior model{basis ? span_of(*basis) : std::span<const double>{}, deviation};
  const RowLight result =
      unlocked([&] { return refine_row_light(picture, span_of(share), span_of(row_light), steps, model); });
  return py::make_tuple(array_of(result.light, {light.shape(1)}), array_of(result.information, {light.shape(1)}));
}

}  // namespace

void register_cleaning(py::module_& module) {
  using py::arg;
  module.def("light_share", &run_light_share, arg("light"), arg("variance"), arg("row_light"), arg("smooth") = true);
  module.def(
      "comparison_lag",
      [](const Doubles& row_light) {
        require(row_light.ndim() == 2, "row_light", row_light.ndim(), "2 dimensions (frames, rows)");
        return comparison_lag(span_of(row_light), static_cast<std::size_t>(row_light.shape(1)));
      },
      arg("row_light"));
  module.def("refine_row_light", &run_refine_row_light, arg("light"), arg("variance"), arg("share"), arg("row_light"),
             arg("steps"), arg("basis") = py::none(), arg("deviation") = std::numeric_limits<double>::infinity());
}

}  // namespace ocisac::bindings
