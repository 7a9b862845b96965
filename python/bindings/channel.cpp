#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <vector>

#include "ocisac/receiver/channel_estimate.hpp"
#include "ocisac/receiver/preamble.hpp"
#include "register.hpp"

namespace py = pybind11;

namespace ocisac::bindings {

namespace {

using Vector = py::array_t<double, py::array::c_style>;

std::span<const double> view(const Vector& values) { return {values.data(), static_cast<std::size_t>(values.size())}; }

ChannelModel make_model(std::size_t dark_degree, std::size_t swing_degree, bool exposure_known) {
  return {dark_degree, swing_degree, exposure_known};
}

py::tuple as_tuple(const ClockErrors& errors) { return py::make_tuple(errors.chip, errors.covariance); }

// In the order of ocisac_fast.channel.ChannelEstimate.
py::tuple as_tuple(const ChannelEstimate& channel) {
  return py::make_tuple(channel.clock.rows_per_chip, channel.clock.phase, channel.clock.exposure,
                        as_tuple(channel.errors), channel.dark, channel.swing, channel.noise, channel.rows.begin,
                        channel.rows.end, channel.converged);
}

Vector expose(const Vector& chips, std::ptrdiff_t first, std::size_t rows, double rows_per_chip, double phase,
              double exposure) {
  std::vector<double> out(rows);
  {
    const KnownChips known{view(chips), first};
    const py::gil_scoped_release unlocked;
    expose_chips(known, {rows_per_chip, phase, exposure}, out);
  }
  return Vector(static_cast<py::ssize_t>(out.size()), out.data());
}

py::object fit(const Vector& signal, const Vector& chips, std::ptrdiff_t first, double rows_per_chip, double phase,
               double exposure, std::size_t dark_degree, std::size_t swing_degree, bool exposure_known) {
  std::optional<ChannelEstimate> fitted;
  {
    const auto rows = view(signal);
    const KnownChips known{view(chips), first};
    const py::gil_scoped_release unlocked;
    fitted = fit_channel(rows, known, {rows_per_chip, phase, exposure},
                         make_model(dark_degree, swing_degree, exposure_known));
  }
  return fitted ? py::object(as_tuple(*fitted)) : py::none();
}

py::object bounds(const Vector& chips, std::ptrdiff_t first, double rows_per_chip, double phase, double exposure,
                  const Vector& swing, double noise, std::size_t dark_degree, std::size_t swing_degree,
                  bool exposure_known) {
  std::optional<ClockErrors> errors;
  {
    const auto rows = view(swing);
    const KnownChips known{view(chips), first};
    const py::gil_scoped_release unlocked;
    errors = clock_bounds(known, {rows_per_chip, phase, exposure}, rows, noise,
                          make_model(dark_degree, swing_degree, exposure_known));
  }
  return errors ? py::object(as_tuple(*errors)) : py::none();
}

py::list find(const Vector& signal, const Vector& preamble, double rows_per_chip, double tolerance,
              std::optional<double> exposure, double longest_exposure, std::size_t most) {
  std::vector<PreambleMatch> matches;
  {
    const auto rows = view(signal), levels = view(preamble);
    const py::gil_scoped_release unlocked;
    matches = find_preamble(rows, levels, {rows_per_chip, tolerance, exposure, longest_exposure, most});
  }
  py::list list;
  for (const auto& match : matches)
    list.append(py::make_tuple(as_tuple(match.channel), match.explained, match.certainty));
  return list;
}

py::tuple pool_values(const Vector& values, const Vector& errors) {
  const Pooled pooled = pool_estimates(view(values), view(errors));
  return py::make_tuple(pooled.value, pooled.std, pooled.count);
}

}  // namespace

void register_channel(py::module_& module) {
  using py::arg;
  module.def("expose_chips", &expose, arg("chips"), arg("first"), arg("rows"), arg("rows_per_chip"), arg("phase"),
             arg("exposure"));
  module.def("fit_channel", &fit, arg("signal"), arg("chips"), arg("first"), arg("rows_per_chip"), arg("phase"),
             arg("exposure"), arg("dark_degree"), arg("swing_degree"), arg("exposure_known"));
  module.def("clock_bounds", &bounds, arg("chips"), arg("first"), arg("rows_per_chip"), arg("phase"), arg("exposure"),
             arg("swing"), arg("noise"), arg("dark_degree"), arg("swing_degree"), arg("exposure_known"));
  module.def("find_preamble", &find, arg("signal"), arg("preamble"), arg("rows_per_chip"), arg("tolerance"),
             arg("exposure"), arg("longest_exposure"), arg("most"));
  module.def("pool_estimates", &pool_values, arg("values"), arg("errors"));
}

}  // namespace ocisac::bindings
