#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <array>
#include <string>
#include <vector>

#include "channel_arguments.hpp"
#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/chips/clock_tracker.hpp"
#include "ocisac/chips/detect_chips.hpp"
#include "ocisac/chips/preamble.hpp"
#include "ocisac/chips/refine_channel.hpp"
#include "ocisac/chips/sequence_detector.hpp"
#include "ocisac/core/require.hpp"
#include "register.hpp"
#include "shared.hpp"

namespace py = pybind11;

namespace ocisac::bindings {

namespace {

using Vector = py::array_t<double, py::array::c_style>;

std::span<const double> view(const Vector& values) { return {values.data(), static_cast<std::size_t>(values.size())}; }

ChannelModel make_model(std::size_t dark_degree, std::size_t swing_degree, bool exposure_known) {
  return {dark_degree, swing_degree, exposure_known};
}

py::tuple as_tuple(const ClockErrors& errors) { return py::make_tuple(errors.chip, errors.covariance); }

// In the order of ocisac_fast.chips.ChannelEstimate.
py::tuple as_tuple(const ChannelEstimate& channel) {
  return py::make_tuple(channel.clock.rows_per_chip, channel.clock.phase, channel.clock.exposure_rows,
                        as_tuple(channel.errors), channel.dark, channel.swing, channel.noise, channel.rows.begin,
                        channel.rows.end, channel.converged);
}

Vector expose(const Vector& chips, std::ptrdiff_t first, std::size_t rows, double rows_per_chip, double phase,
              double exposure_rows) {
  std::vector<double> out(rows);
  {
    const KnownChips known{view(chips), first};
    const py::gil_scoped_release unlocked;
    expose_chips(known, {rows_per_chip, phase, exposure_rows}, out);
  }
  return Vector(static_cast<py::ssize_t>(out.size()), out.data());
}

py::object fit(const Vector& signal, const Vector& chips, std::ptrdiff_t first, double rows_per_chip, double phase,
               double exposure_rows, std::size_t dark_degree, std::size_t swing_degree, bool exposure_known) {
  std::optional<ChannelEstimate> fitted;
  {
    const auto rows = view(signal);
    const KnownChips known{view(chips), first};
    const py::gil_scoped_release unlocked;
    fitted = fit_channel(rows, known, {rows_per_chip, phase, exposure_rows},
                         make_model(dark_degree, swing_degree, exposure_known));
  }
  return fitted ? py::object(as_tuple(*fitted)) : py::none();
}

py::object bounds(const Vector& chips, std::ptrdiff_t first, double rows_per_chip, double phase, double exposure_rows,
                  const Vector& swing, double noise, std::size_t dark_degree, std::size_t swing_degree,
                  bool exposure_known) {
  std::optional<ClockErrors> errors;
  {
    const auto rows = view(swing);
    const KnownChips known{view(chips), first};
    const py::gil_scoped_release unlocked;
    errors = clock_bounds(known, {rows_per_chip, phase, exposure_rows}, rows, noise,
                          make_model(dark_degree, swing_degree, exposure_known));
  }
  return errors ? py::object(as_tuple(*errors)) : py::none();
}

py::list find(const Vector& signal, const Vector& preamble, double rows_per_chip, double tolerance,
              std::optional<double> exposure_rows, double max_exposure_chips, std::size_t max_matches) {
  std::vector<PreambleMatch> matches;
  {
    const auto rows = view(signal), levels = view(preamble);
    const py::gil_scoped_release unlocked;
    matches = find_preamble(rows, levels, {rows_per_chip, tolerance, exposure_rows, max_exposure_chips, max_matches});
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

// None: the automatic choice. A Python function: detect(rows, rows_per_chip, phase, exposure, noise, first, count) ->
// (count,) levels.
DetectChips detector_of(const std::optional<py::function>& detect) {
  if (!detect) return level_detector();
  return [function = &*detect](const ChipQuestion& question) {
    const py::gil_scoped_acquire locked;
    const Vector rows(static_cast<py::ssize_t>(question.rows.size()), question.rows.data());
    const ChipClock& clock = question.clock;
    const auto chips = (*function)(rows, clock.rows_per_chip, clock.phase, clock.exposure_rows, question.noise,
                                   question.first, question.count)
                           .cast<std::vector<double>>();
    require(chips.size() == question.count, "detect", chips.size(), "as many levels as chips asked for");
    return chips;
  };
}

Vector ratios_of(const Vector& rows, double rows_per_chip, double phase, double exposure_rows, double noise,
                 std::ptrdiff_t first, std::size_t count, const std::string& method) {
  const ChipQuestion question{view(rows), {rows_per_chip, phase, exposure_rows}, noise, first, count};
  const DetectorMethod detector = detector_method(method);
  std::vector<double> ratios;
  {
    const py::gil_scoped_release unlocked;
    ratios = detect_chips(question, detector).llr;
  }
  return Vector(static_cast<py::ssize_t>(ratios.size()), ratios.data());
}

py::object as_object(const std::optional<RefinedChannel>& found) {
  if (!found) return py::none();
  const Vector chips(static_cast<py::ssize_t>(found->chips.size()), found->chips.data());
  return py::make_tuple(as_tuple(found->channel), chips, found->first, found->settled, found->even);
}

py::object refine(const Vector& signal, const py::tuple& start, const std::optional<py::function>& detect,
                  bool exposure_known, std::size_t highest_degree, const Vector& known, std::ptrdiff_t known_first) {
  std::optional<RefinedChannel> found;
  {
    const auto rows = view(signal);
    const auto channel = channel_of(start);
    const RefineOptions options{exposure_known, highest_degree, {view(known), known_first}};
    const auto detector = detector_of(detect);
    const py::gil_scoped_release unlocked;
    found = refine_channel(rows, channel, detector, options);
  }
  return as_object(found);
}

py::object search(const Vector& signal, double rows_per_chip, double tolerance, std::optional<double> exposure_rows,
                  double max_exposure_chips, const std::optional<py::function>& detect, bool exposure_known,
                  std::size_t highest_degree) {
  std::optional<RefinedChannel> found;
  {
    const auto rows = view(signal);
    const RefineOptions options{exposure_known, highest_degree, {}};
    const auto detector = detector_of(detect);
    const py::gil_scoped_release unlocked;
    found = find_channel(rows, {rows_per_chip, tolerance, exposure_rows, max_exposure_chips}, detector, options);
  }
  return as_object(found);
}

bool update(Shared<ClockTracker>& tracker, std::int64_t frame, double rows_per_chip, double phase, double exposure_rows,
            std::ptrdiff_t chip, const std::array<double, 9>& covariance) {
  return tracker.call([&](ClockTracker& alone) {
    return alone.update(frame, {rows_per_chip, phase, exposure_rows}, {chip, covariance});
  });
}

py::object predict(Shared<ClockTracker>& tracker, std::int64_t frame) {
  const auto found = tracker.call([&](const ClockTracker& alone) { return alone.predict(frame); });
  if (!found) return py::none();
  return py::make_tuple(found->clock.rows_per_chip, found->clock.phase, found->clock.exposure_rows, found->chip,
                        found->errors.covariance, found->chips_lost);
}

}  // namespace

void register_channel(py::module_& module) {
  using py::arg;
  module.def("expose_chips", &expose, arg("chips"), arg("first"), arg("rows"), arg("rows_per_chip"), arg("phase"),
             arg("exposure_rows"));
  module.def("fit_channel", &fit, arg("signal"), arg("chips"), arg("first"), arg("rows_per_chip"), arg("phase"),
             arg("exposure_rows"), arg("dark_degree"), arg("swing_degree"), arg("exposure_known"));
  module.def("clock_bounds", &bounds, arg("chips"), arg("first"), arg("rows_per_chip"), arg("phase"),
             arg("exposure_rows"), arg("swing"), arg("noise"), arg("dark_degree"), arg("swing_degree"),
             arg("exposure_known"));
  module.def("find_preamble", &find, arg("signal"), arg("preamble"), arg("rows_per_chip"), arg("tolerance"),
             arg("exposure_rows"), arg("max_exposure_chips"), arg("max_matches"));
  module.def("chip_llr", &ratios_of, arg("rows"), arg("rows_per_chip"), arg("phase"), arg("exposure_rows"),
             arg("noise"), arg("first"), arg("count"), arg("method"));
  module.def("closest_pair_distance", &closest_pair_distance, arg("rows_per_chip"), arg("exposure_rows"));
  module.def("refine_channel", &refine, arg("signal"), arg("start"), arg("detect"), arg("exposure_known"),
             arg("highest_degree"), arg("known"), arg("known_first"));
  module.def("find_channel", &search, arg("signal"), arg("rows_per_chip"), arg("tolerance"), arg("exposure_rows"),
             arg("max_exposure_chips"), arg("detect"), arg("exposure_known"), arg("highest_degree"));
  py::class_<Shared<ClockTracker>>(module, "ClockTracker")
      .def(py::init([](double frame_rows, double frame_rows_std, double drift, double exposure_wander) {
             return Shared(ClockTracker({frame_rows, frame_rows_std, drift, exposure_wander}));
           }),
           arg("frame_rows"), arg("frame_rows_std"), arg("drift"), arg("exposure_wander"))
      .def("update", &update, arg("frame"), arg("rows_per_chip"), arg("phase"), arg("exposure_rows"), arg("chip"),
           arg("covariance"))
      .def("predict", &predict, arg("frame"))
      .def("reset", [](Shared<ClockTracker>& tracker) { tracker.call([](ClockTracker& alone) { alone.reset(); }); });
  module.def("pool_estimates", &pool_values, arg("values"), arg("errors"));
}

}  // namespace ocisac::bindings
