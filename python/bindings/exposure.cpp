#include "bindings.hpp"
#include "ocisac/exposure/best_exposure.hpp"
#include "ocisac/exposure/exposure_controller.hpp"
#include "ocisac/exposure/flicker.hpp"

namespace ocisac::bindings {

namespace {

ExposureMethod exposure_method(const std::string& name) {
  if (name == "exact") return ExposureMethod::exact;
  if (name == "closed-form") return ExposureMethod::closed_form;
  if (name == "rounded") return ExposureMethod::rounded;
  if (name == "search") return ExposureMethod::search;
  refuse("method", name, "exact, closed-form, rounded or search");
}

// frequencies: (problems, tones)
std::pair<py::array_t<double>, py::array_t<double>> run_best_exposure(
    const Doubles& frequencies, const Doubles& weights, const std::string& method,
    const std::optional<std::pair<double, double>>& bounds, std::optional<double> step, std::size_t points) {
  const auto chosen = exposure_method(method);
  const auto problems = frequencies.shape(0);
  py::array_t<double> exposures(problems), objectives(problems);
  const auto exposure_values = mutable_span_of(exposures), objective_values = mutable_span_of(objectives);
  ExposureDomain domain{std::nullopt, step};
  if (bounds) domain.bounds = {bounds->first, bounds->second};
  unlocked([&] {
    best_exposures(span_of(frequencies), span_of(weights), chosen, domain, points, exposure_values, objective_values);
  });
  return {exposures, objectives};
}

// exposures: (problems,), frequencies: (problems, tones)
py::array_t<double> run_exposure_objective(const Doubles& exposures, const Doubles& frequencies,
                                           const Doubles& weights) {
  py::array_t<double> objectives(exposures.size());
  const auto tones = static_cast<std::size_t>(frequencies.shape(1));
  const auto values = mutable_span_of(objectives);
  unlocked([&] {
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] =
          exposure_objective(span_of(frequencies).subspan(i * tones, tones), span_of(weights), span_of(exposures)[i]);
  });
  return objectives;
}

struct ToneTable {
  std::array<MeasuredTone, kMaxWeightedTones> tones;
  std::size_t count = 0;
};

// (tones, 6): frequency, 1 for sensing, share, snr, gain, gain_std
ToneTable measured_tones(const Doubles& table) {
  ToneTable read;
  require(table.shape(0) <= static_cast<py::ssize_t>(kMaxWeightedTones), "tones", table.shape(0), "at most 32");
  for (py::ssize_t i = 0; i < table.shape(0); ++i)
    read.tones[read.count++] = {table.at(i, 0), table.at(i, 1) != 0, table.at(i, 2),
                                table.at(i, 3), table.at(i, 4),      table.at(i, 5)};
  return read;
}

// In the order of ocisac_fast.exposure_controller.ExposureSuggestion.
py::tuple update(Shared<ExposureController>& controller, const Doubles& table, double exposure, double gain,
                 double level, double peak, double saturated) {
  const ToneTable read = measured_tones(table);
  const ExposureSuggestion s = controller.call([&](ExposureController& alone) {
    return alone.update({{read.tones.data(), read.count}, exposure, gain, level, peak, saturated});
  });
  return py::make_tuple(s.exposure, s.gain, s.objective, s.best_exposure, s.best_objective, s.low, s.high,
                        s.noise_exposure, s.level, s.reasons);
}

std::array<WeightedTone, kMaxWeightedTones> weighted_tones(const Doubles& frequencies, const Doubles& weights) {
  require(frequencies.ndim() == 1 && frequencies.size() <= static_cast<py::ssize_t>(kMaxWeightedTones), "frequencies",
          std::to_string(frequencies.size()) + " values", "1 to 32 in one dimension");
  require(weights.ndim() == 1 && weights.size() == frequencies.size(), "weights",
          std::to_string(weights.size()) + " values", "one a frequency, here " + std::to_string(frequencies.size()));
  std::array<WeightedTone, kMaxWeightedTones> tones{};
  for (py::ssize_t i = 0; i < frequencies.size(); ++i)
    tones[static_cast<std::size_t>(i)] = {frequencies.at(i), weights.at(i)};
  return tones;
}

py::tuple run_best_noisy_exposure(const Doubles& frequencies, const Doubles& weights, double noise_exposure, double low,
                                  double high, double step) {
  const auto tones = weighted_tones(frequencies, weights);
  const auto count = static_cast<std::size_t>(frequencies.size());
  const auto best = unlocked([&] {
    return best_noisy_exposure({tones.data(), count}, noise_exposure, {low, high, step});
  });
  return py::make_tuple(best.exposure, best.objective);
}

Shared<ExposureController> make_controller(double shortest, double longest, double step, double lowest_gain,
                                           double highest_gain, double comm_weight, double sense_weight,
                                           double hysteresis, double level_floor, double level_aim,
                                           double level_ceiling, double max_saturated, double min_snr,
                                           double noise_level) {
  return Shared(ExposureController({{shortest, longest, step},
                                    lowest_gain,
                                    highest_gain,
                                    comm_weight,
                                    sense_weight,
                                    hysteresis,
                                    level_floor,
                                    level_aim,
                                    level_ceiling,
                                    max_saturated,
                                    min_snr,
                                    noise_level}));
}

// (lights, 4): frequency, uncertainty, duty (NaN: a raised cosine), depth
std::vector<FlickeringLight> flickering_lights(const Doubles& table) {
  std::vector<FlickeringLight> lights;
  for (py::ssize_t i = 0; i < table.shape(0); ++i) {
    const double duty = table.at(i, 2);
    lights.push_back(
        {table.at(i, 0), table.at(i, 1), std::isnan(duty) ? std::nullopt : std::optional(duty), table.at(i, 3)});
  }
  return lights;
}

// The largest modulation of any light, of the shape of `exposures`.
py::array_t<double> run_exposure_modulation(const Doubles& lights, const Doubles& exposures) {
  const auto all = flickering_lights(lights);
  py::array_t<double> modulations(std::vector<py::ssize_t>(exposures.shape(), exposures.shape() + exposures.ndim()));
  const auto values = mutable_span_of(modulations);
  unlocked([&] {
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = 0;
      for (const FlickeringLight& light : all)
        values[i] = std::max(values[i], exposure_modulation(light, span_of(exposures)[i]));
    }
  });
  return modulations;
}

// (intervals, 2)
py::array_t<double> run_flicker_free_intervals(const Doubles& lights, double below,
                                               const std::pair<double, double>& bounds) {
  const auto all = flickering_lights(lights);
  const auto found = unlocked([&] { return flicker_free_intervals(all, below, {{bounds.first, bounds.second}}); });
  py::array_t<double> result({static_cast<py::ssize_t>(found.size()), py::ssize_t{2}});
  double* place = result.mutable_data();
  for (const Interval& interval : found) *place++ = interval.low, *place++ = interval.high;
  return result;
}

// exposure, modulation, holds, modulations, objective, gain
py::tuple run_flicker_free_exposure(const Doubles& lights, double below, std::optional<double> near,
                                    const std::pair<double, double>& bounds, std::optional<double> step,
                                    std::optional<double> f_comm, std::optional<double> f_sense,
                                    std::optional<double> min_gain, const std::pair<double, double>& weights) {
  const auto all = flickering_lights(lights);
  const FlickerFreeRequest request{
      below, near, {bounds.first, bounds.second}, step, f_comm, f_sense, min_gain, weights.first, weights.second};
  const auto found = unlocked([&] { return flicker_free_exposure(all, request); });
  return py::make_tuple(found.exposure, found.modulation, found.holds, py::tuple(py::cast(found.modulations)),
                        found.objective, found.gain);
}

}  // namespace

void register_exposure(py::module_& module) {
  using py::arg;
  module.def("best_exposure", &run_best_exposure, arg("frequencies"), arg("weights"), arg("method"), arg("bounds"),
             arg("step"), arg("points"));
  module.def("exposure_objective", &run_exposure_objective, arg("exposure"), arg("frequencies"), arg("weights"));
  module.def("best_noisy_exposure", &run_best_noisy_exposure, arg("frequencies"), arg("weights"), arg("noise_exposure"),
             arg("low"), arg("high"), arg("step"));
  module.def("exposure_modulation", &run_exposure_modulation, arg("lights"), arg("exposure"));
  module.def("flicker_free_intervals", &run_flicker_free_intervals, arg("lights"), arg("below"), arg("bounds"));
  module.def("flicker_free_exposure", &run_flicker_free_exposure, arg("lights"), arg("below"), arg("near"),
             arg("bounds"), arg("step"), arg("f_comm"), arg("f_sense"), arg("min_gain"), arg("weights"));
  py::class_<Shared<ExposureController>>(module, "ExposureController")
      .def(py::init(&make_controller), arg("shortest"), arg("longest"), arg("step"), arg("lowest_gain"),
           arg("highest_gain"), arg("comm_weight"), arg("sense_weight"), arg("hysteresis"), arg("floor"), arg("aim"),
           arg("ceiling"), arg("max_saturated"), arg("min_snr"), arg("noise_level"))
      .def("update", &update, arg("tones"), arg("exposure"), arg("gain"), arg("level"), arg("peak"), arg("saturated"))
      .def("reset", [](Shared<ExposureController>& controller) {
        controller.call([](ExposureController& alone) { alone.reset(); });
      });
}

}  // namespace ocisac::bindings
