#include "ocisac/exposure/exposure_controller.hpp"

#include <pybind11/numpy.h>

#include <array>
#include <cstddef>
#include <string>

#include "ocisac/core/require.hpp"
#include "register.hpp"
#include "shared.hpp"

namespace ocisac::bindings {

namespace py = pybind11;

namespace {

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

struct ToneTable {
  std::array<MeasuredTone, max_weighted_tones> tones;
  std::size_t count = 0;
};

// (tones, 6): frequency, 1 for sensing, share, snr, gain, gain_std
ToneTable measured_tones(const Doubles& table) {
  ToneTable read;
  require(table.shape(0) <= static_cast<py::ssize_t>(max_weighted_tones), "tones", table.shape(0), "at most 32");
  for (py::ssize_t i = 0; i < table.shape(0); ++i)
    read.tones[read.count++] = {table.at(i, 0), table.at(i, 1) != 0 ? ToneKind::sensing : ToneKind::communication,
                                table.at(i, 2), table.at(i, 3),
                                table.at(i, 4), table.at(i, 5)};
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

std::array<WeightedTone, max_weighted_tones> weighted_tones(const Doubles& frequencies, const Doubles& weights) {
  require(frequencies.ndim() == 1 && frequencies.size() <= static_cast<py::ssize_t>(max_weighted_tones), "frequencies",
          std::to_string(frequencies.size()) + " values", "1 to 32 in one dimension");
  require(weights.ndim() == 1 && weights.size() == frequencies.size(), "weights",
          std::to_string(weights.size()) + " values", "one a frequency, here " + std::to_string(frequencies.size()));
  std::array<WeightedTone, max_weighted_tones> tones{};
  for (py::ssize_t i = 0; i < frequencies.size(); ++i)
    tones[static_cast<std::size_t>(i)] = {frequencies.at(i), weights.at(i)};
  return tones;
}

py::tuple run_best_noisy_exposure(const Doubles& frequencies, const Doubles& weights, double noise_exposure, double low,
                                  double high, double step) {
  const auto tones = weighted_tones(frequencies, weights);
  const auto count = static_cast<std::size_t>(frequencies.size());
  BestExposure best{};
  {
    const py::gil_scoped_release released;
    best = best_noisy_exposure({tones.data(), count}, noise_exposure, {low, high, step});
  }
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

}  // namespace

void register_exposure_controller(py::module_& module) {
  module.def("best_noisy_exposure", &run_best_noisy_exposure, py::arg("frequencies"), py::arg("weights"),
             py::arg("noise_exposure"), py::arg("low"), py::arg("high"), py::arg("step"));
  py::class_<Shared<ExposureController>>(module, "ExposureController")
      .def(py::init(&make_controller), py::arg("shortest"), py::arg("longest"), py::arg("step"), py::arg("lowest_gain"),
           py::arg("highest_gain"), py::arg("comm_weight"), py::arg("sense_weight"), py::arg("hysteresis"),
           py::arg("level_floor"), py::arg("level_aim"), py::arg("level_ceiling"), py::arg("max_saturated"),
           py::arg("min_snr"), py::arg("noise_level"))
      .def("update", &update, py::arg("tones"), py::arg("exposure"), py::arg("gain"), py::arg("level"), py::arg("peak"),
           py::arg("saturated"))
      .def("reset", [](Shared<ExposureController>& controller) {
        controller.call([](ExposureController& alone) { alone.reset(); });
      });
}

}  // namespace ocisac::bindings
