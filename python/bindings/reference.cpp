// Kernels of receiver and detector that Python calls only to compare them with their twins in ocisac_fast.reference.
#include "bindings.hpp"
#include "chips/lit_rows.hpp"
#include "columns/lamp_slope.hpp"
#include "lights/own_pixels.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "ocisac/chips/row_profile.hpp"

namespace ocisac::bindings {

namespace {

std::vector<ProfileFrame> frames_of(const std::vector<Doubles>& signals, const std::vector<Doubles>& exposed) {
  std::vector<ProfileFrame> frames;
  for (std::size_t f = 0; f < signals.size(); ++f)
    frames.push_back({span_of(signals[f]), f < exposed.size() ? span_of(exposed[f]) : std::span<const double>{}});
  return frames;
}

py::object as_object(const std::optional<RowProfile>& profile) {
  if (!profile) return py::none();
  return py::make_tuple(array_of(profile->dark), array_of(profile->swing));
}

py::tuple as_tuple(RowRange rows) { return py::make_tuple(rows.begin, rows.end); }

py::object without_nuisance(const Doubles& signal, double slow, const std::vector<double>& tones,
                            const Doubles& exposed, const std::vector<double>& scale) {
  const auto fit = remove_nuisance(span_of(signal), {slow, tones, scale}, span_of(exposed));
  if (!fit) return py::none();
  return py::make_tuple(array_of(fit->rest), fit->squares);
}

// Frequency and own pixels by fit_outline() of log light (rows, groups); None if they do not settle.
std::optional<py::tuple> outline_of(const Doubles& light, const py::array_t<bool, py::array::c_style>& own,
                                    double frequency) {
  const auto rows = static_cast<std::size_t>(light.shape(0)), groups = static_cast<std::size_t>(light.shape(1));
  const auto all = span_of(light);
  const auto mask = span_of(own);
  OwnPixels pixels{{all.begin(), all.end()},
                   {mask.begin(), mask.end()},
                   std::vector<double>(rows),
                   std::vector<double>(rows),
                   {0, 0, groups, rows}};
  const auto found = fit_outline(pixels, frequency);
  if (!found) return {};
  return py::make_tuple(*found, array_of(pixels.own, {light.shape(0), light.shape(1)}));
}

}  // namespace

void register_reference(py::module_& module) {
  using py::arg;
  module.def(
      "first_profile",
      [](const std::vector<Doubles>& signals, std::size_t smooth) {
        return as_object(first_profile(frames_of(signals, {}), smooth));
      },
      arg("signals"), arg("smooth"));
  module.def(
      "fit_profile",
      [](const std::vector<Doubles>& signals, const std::vector<Doubles>& exposed, const Doubles& shape,
         std::size_t smooth,
         double weight) { return as_object(fit_profile(frames_of(signals, exposed), span_of(shape), smooth, weight)); },
      arg("signals"), arg("exposed"), arg("shape"), arg("smooth"), arg("weight"));
  module.def(
      "profile_rows",
      [](const std::vector<double>& swing, double share) {
        return as_tuple(profile_rows({std::vector<double>(swing.size()), swing}, share));
      },
      arg("swing"), arg("share"));
  module.def(
      "lit_rows",
      [](const Doubles& signal, double noise, std::pair<std::size_t, std::size_t> seen, double least_departure,
         double texture, double most_noise, bool expected) {
        const DarkRows dark{least_departure, texture, most_noise, expected};
        const LitRows lit = lit_rows(span_of(signal), noise, {seen.first, seen.second}, dark);
        return py::make_tuple(as_tuple(lit.rows), lit.shortest);
      },
      arg("signal"), arg("noise"), arg("seen"), arg("least_departure") = DarkRows{}.least_departure,
      arg("texture") = DarkRows{}.texture, arg("most_noise") = DarkRows{}.most_noise,
      arg("expected") = DarkRows{}.expected);
  module.def("remove_nuisance", &without_nuisance, arg("signal"), arg("slow"), arg("tones"), arg("exposed"),
             arg("scale") = std::vector<double>{});
  module.def(
      "strongest_tone",
      [](const Doubles& signals, std::size_t rows, double lowest, double highest) {
        const StrongestTone found = strongest_tone(span_of(signals), rows, lowest, highest);
        return py::make_tuple(found.frequency, found.prominence);
      },
      arg("signals"), arg("rows"), arg("lowest"), arg("highest"));
  module.def(
      "without_square_wave",
      [](const Doubles& signal, double frequency, double exposure_rows) {
        return array_of(without_square_wave(span_of(signal), frequency, exposure_rows));
      },
      arg("signal"), arg("frequency"), arg("exposure_rows"));
  module.def(
      "lamp_slope",
      [](const Doubles& swings, const Doubles& centres) { return lamp_slope(span_of(swings), span_of(centres)); },
      arg("swings"), arg("centres"));
  module.def("fit_outline", &outline_of, arg("light"), arg("own"), arg("frequency"));
}

}  // namespace ocisac::bindings
