#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <string>
#include <tuple>
#include <vector>

#include "arrays.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/tones/find_frequency.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace py = pybind11;

namespace {

using Bounds = std::optional<std::tuple<double, double>>;

Harmonics harmonics_of(const std::string& waveform) {
  if (waveform == "auto") return Harmonics::automatic;
  if (waveform == "tone") return Harmonics::fundamental;
  if (waveform == "square") return Harmonics::all;
  refuse("waveform", waveform, "auto, tone or square");
}

// The white level where the camera has one, else what the samples can hold.
double saturation_of(const Camera& camera, const AnyFramesView& frames) {
  return camera.tone_curve.white_level == 0 ? saturation_level(frames) : camera.tone_curve.white_level;
}

// Bounds in Hz become cycles per row.
FrequencySearch search_of(const Camera& camera, const Bounds& bounds, const std::string& waveform,
                          bool select_columns) {
  FrequencySearch search;
  if (bounds) {
    search.lower = std::get<0>(*bounds) * camera.row_time;
    search.upper = std::get<1>(*bounds) * camera.row_time;
  }
  search.harmonics = harmonics_of(waveform);
  search.select_columns = select_columns;
  return search;
}

py::tuple columns_as_arrays(const ToneColumns& columns) {
  py::array_t<bool> used(static_cast<py::ssize_t>(columns.used.size()));
  for (std::size_t i = 0; i < columns.used.size(); ++i)
    used.mutable_at(static_cast<py::ssize_t>(i)) = columns.used[i] != 0;
  return py::make_tuple(used,
                        py::array_t<double>(static_cast<py::ssize_t>(columns.strength.size()), columns.strength.data()),
                        columns.saturated);
}

// Cycles per row, its standard error, signal-to-noise ratio, highest harmonic, flags, columns (used, strength,
// saturated).
py::tuple find(const py::array& columns, const Camera& camera, const Bounds& bounds, const std::string& waveform,
               bool select_columns) {
  const AnyFramesView view = any_view(columns);
  FrequencySearch search = search_of(camera, bounds, waveform, select_columns);
  search.saturation = saturation_of(camera, view);
  const FoundFrequency found = [&] {
    const py::gil_scoped_release unlocked;
    return find_frequency(view, search);
  }();
  return py::make_tuple(found.frequency, found.frequency_std, found.snr, found.harmonics, found.flags,
                        columns_as_arrays(found.columns));
}

py::tuple columns_of_tone(const py::array& columns, const Camera& camera, double frequency) {
  const AnyFramesView view = any_view(columns);
  const ToneColumns found = [&] {
    const py::gil_scoped_release unlocked;
    return tone_columns(view, frequency * camera.row_time, saturation_of(camera, view));
  }();
  return columns_as_arrays(found);
}

std::size_t colour_of(const std::vector<py::array>& colours, const Camera& camera, const Bounds& bounds,
                       const std::string& waveform) {
  std::vector<AnyFramesView> views;
  for (const auto& colour : colours) views.push_back(any_view(colour));
  FrequencySearch search = search_of(camera, bounds, waveform, true);
  if (!views.empty()) search.saturation = saturation_of(camera, views.front());
  const py::gil_scoped_release unlocked;
  return pick_colour(views, search);
}

}  // namespace

void register_frequency(py::module_& module) {
  module.def("find_frequency", &find, py::arg("columns"), py::arg("camera"), py::arg("bounds"), py::arg("waveform"),
             py::arg("select_columns"));
  module.def("tone_columns", &columns_of_tone, py::arg("columns"), py::arg("camera"), py::arg("frequency"));
  module.def("pick_colour", &colour_of, py::arg("colours"), py::arg("camera"), py::arg("bounds"),
             py::arg("waveform"));
}

}  // namespace ocisac::bindings
