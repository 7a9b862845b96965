#include "ocisac/exposure/best_exposure.hpp"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <optional>
#include <span>
#include <string>
#include <utility>

#include "ocisac/core/require.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace py = pybind11;

namespace {

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

ExposureMethod exposure_method(const std::string& name) {
  if (name == "exact") return ExposureMethod::exact;
  if (name == "closed-form") return ExposureMethod::closed_form;
  if (name == "rounded") return ExposureMethod::rounded;
  if (name == "search") return ExposureMethod::search;
  refuse("method", name, "exact, closed-form, rounded or search");
}

std::span<const double> span_of(const Doubles& array) { return {array.data(), static_cast<std::size_t>(array.size())}; }

// frequencies: (problems, tones)
std::pair<py::array_t<double>, py::array_t<double>> run_best_exposure(
    const Doubles& frequencies, const Doubles& weights, const std::string& method,
    const std::optional<std::pair<double, double>>& bounds, std::optional<double> step, std::size_t points) {
  const auto chosen = exposure_method(method);
  const auto problems = frequencies.shape(0);
  py::array_t<double> exposures(problems), objectives(problems);
  const auto count = static_cast<std::size_t>(problems);
  const std::span exposure_values(exposures.mutable_data(), count), objective_values(objectives.mutable_data(), count);
  ExposureDomain domain{std::nullopt, step};
  if (bounds) domain.bounds = {bounds->first, bounds->second};
  {
    const py::gil_scoped_release released;
    best_exposures(span_of(frequencies), span_of(weights), chosen, domain, points, exposure_values, objective_values);
  }
  return {exposures, objectives};
}

// exposures: (problems,), frequencies: (problems, tones)
py::array_t<double> run_exposure_objective(const Doubles& exposures, const Doubles& frequencies,
                                           const Doubles& weights) {
  py::array_t<double> objectives(exposures.size());
  const auto tones = static_cast<std::size_t>(frequencies.shape(1));
  const std::span values(objectives.mutable_data(), static_cast<std::size_t>(objectives.size()));
  {
    const py::gil_scoped_release released;
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] =
          exposure_objective(span_of(frequencies).subspan(i * tones, tones), span_of(weights), span_of(exposures)[i]);
  }
  return objectives;
}

}  // namespace

void register_best_exposure(py::module_& module) {
  module.def("best_exposure", &run_best_exposure, py::arg("frequencies"), py::arg("weights"), py::arg("method"),
             py::arg("bounds"), py::arg("step"), py::arg("points"));
  module.def("exposure_objective", &run_exposure_objective, py::arg("exposure"), py::arg("frequencies"),
             py::arg("weights"));
}

}  // namespace ocisac::bindings
