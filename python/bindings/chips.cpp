#include "bindings.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/chips/clock_tracker.hpp"
#include "ocisac/chips/detect_chips.hpp"
#include "ocisac/chips/error_rates.hpp"
#include "ocisac/chips/preamble.hpp"
#include "ocisac/chips/refine_channel.hpp"
#include "ocisac/chips/sequence_detector.hpp"

namespace ocisac::bindings {

namespace {

py::tuple as_tuple(const ClockErrors& errors) { return py::make_tuple(errors.chip, errors.covariance); }

// In the order of ocisac_fast.chips.ChannelEstimate.
py::tuple as_tuple(const ChannelEstimate& channel) {
  return py::make_tuple(channel.clock.rows_per_chip, channel.clock.phase, channel.clock.exposure_rows,
                        as_tuple(channel.errors), channel.dark, channel.swing, channel.noise, channel.rows.begin,
                        channel.rows.end, channel.converged);
}

// A channel in the form of ocisac_fast.chips.
ChannelEstimate channel_of(const py::tuple& values) {
  const auto dark = values[4].cast<std::vector<double>>(), swing = values[5].cast<std::vector<double>>();
  for (const auto* levels : {&dark, &swing})
    require(!levels->empty() && levels->size() <= kHighestDegree + 1, levels == &dark ? "dark" : "swing",
            levels->size(), "1 to 7 coefficients");
  const auto errors = values[3].cast<std::pair<std::ptrdiff_t, std::array<double, 9>>>();
  return {{values[0].cast<double>(), values[1].cast<double>(), values[2].cast<double>()},
          {errors.first, errors.second},
          dark,
          swing,
          values[6].cast<double>(),
          {values[7].cast<std::size_t>(), values[8].cast<std::size_t>()},
          values[9].cast<bool>()};
}

Doubles expose(const Doubles& chips, std::ptrdiff_t first, std::size_t rows, double rows_per_chip, double phase,
               double exposure_rows) {
  py::array_t<double> out(static_cast<py::ssize_t>(rows));
  const auto values = mutable_span_of(out);
  const KnownChips known{span_of(chips), first};
  unlocked([&] { expose_chips(known, {rows_per_chip, phase, exposure_rows}, values); });
  return out;
}

py::object fit(const Doubles& signal, const Doubles& chips, std::ptrdiff_t first, double rows_per_chip, double phase,
               double exposure_rows, std::size_t dark_degree, std::size_t swing_degree, bool exposure_known) {
  const auto rows = span_of(signal);
  const KnownChips known{span_of(chips), first};
  const auto fitted = unlocked([&] {
    return fit_channel(rows, known, {rows_per_chip, phase, exposure_rows}, {dark_degree, swing_degree, exposure_known});
  });
  return fitted ? py::object(as_tuple(*fitted)) : py::none();
}

py::object bounds(const Doubles& chips, std::ptrdiff_t first, double rows_per_chip, double phase, double exposure_rows,
                  const Doubles& swing, double noise, std::size_t dark_degree, std::size_t swing_degree,
                  bool exposure_known) {
  const auto rows = span_of(swing);
  const KnownChips known{span_of(chips), first};
  const auto errors = unlocked([&] {
    return clock_bounds(known, {rows_per_chip, phase, exposure_rows}, rows, noise,
                        {dark_degree, swing_degree, exposure_known});
  });
  return errors ? py::object(as_tuple(*errors)) : py::none();
}

py::list find(const Doubles& signal, const Doubles& preamble, double rows_per_chip, double tolerance,
              std::optional<double> exposure_rows, double max_exposure_chips, std::size_t max_matches) {
  const auto rows = span_of(signal), levels = span_of(preamble);
  const auto matches = unlocked([&] {
    return find_preamble(rows, levels, {rows_per_chip, tolerance, exposure_rows, max_exposure_chips, max_matches});
  });
  py::list list;
  for (const auto& match : matches)
    list.append(py::make_tuple(as_tuple(match.channel), match.explained, match.certainty));
  return list;
}

py::tuple pool_values(const Doubles& values, const Doubles& errors) {
  const Pooled pooled = pool_estimates(span_of(values), span_of(errors));
  return py::make_tuple(pooled.value, pooled.std, pooled.count);
}

// None: the automatic choice. A Python function: detect(rows, rows_per_chip, phase, exposure_rows, noise, first, count)
// -> (count,) levels.
DetectChips detector_of(const std::optional<py::function>& detect) {
  if (!detect) return level_detector();
  return [function = &*detect](const ChipQuestion& question) {
    const py::gil_scoped_acquire locked;
    const Doubles rows = array_of(question.rows);
    const ChipClock& clock = question.clock;
    const auto chips = (*function)(rows, clock.rows_per_chip, clock.phase, clock.exposure_rows, question.noise,
                                   question.first, question.count)
                           .cast<std::vector<double>>();
    require(chips.size() == question.count, "detect", chips.size(), "as many levels as chips asked for");
    return chips;
  };
}

Doubles ratios_of(const Doubles& rows, double rows_per_chip, double phase, double exposure_rows, double noise,
                  std::ptrdiff_t first, std::size_t count, const std::string& method) {
  const ChipQuestion question{span_of(rows), {rows_per_chip, phase, exposure_rows}, noise, first, count};
  return array_of(unlocked([&] { return detect_chips(question, method).llr; }));
}

py::object as_object(const std::optional<RefinedChannel>& found) {
  if (!found) return py::none();
  return py::make_tuple(as_tuple(found->channel), array_of(found->chips), found->first, found->settled, found->even);
}

py::object refine(const Doubles& signal, const py::tuple& start, const std::optional<py::function>& detect,
                  bool exposure_known, std::size_t highest_degree, const Doubles& known, std::ptrdiff_t known_first) {
  const auto rows = span_of(signal);
  const auto channel = channel_of(start);
  const RefineOptions options{exposure_known, highest_degree, {span_of(known), known_first}};
  const auto detector = detector_of(detect);
  return as_object(unlocked([&] { return refine_channel(rows, channel, detector, options); }));
}

py::object search(const Doubles& signal, double rows_per_chip, double tolerance, std::optional<double> exposure_rows,
                  double max_exposure_chips, const std::optional<py::function>& detect, bool exposure_known,
                  std::size_t highest_degree) {
  const auto rows = span_of(signal);
  const RefineOptions options{exposure_known, highest_degree, {}};
  const auto detector = detector_of(detect);
  return as_object(unlocked([&] {
    return find_channel(rows, {rows_per_chip, tolerance, exposure_rows, max_exposure_chips}, detector, options);
  }));
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

// (frames, chips, columns), number of the first chip, method used.
py::tuple detect(const py::array& columns, const Camera& camera, const py::tuple& channel, const std::string& method) {
  const AnyFramesView view = any_view(columns);
  const ChannelEstimate estimate = channel_of(channel);
  const ColumnChips found = unlocked([&] { return detect_chips(view, camera, estimate, method); });
  const Shape shape = shape_of(view);
  const auto ratios =
      array_of(found.llr, {static_cast<py::ssize_t>(shape.frames), static_cast<py::ssize_t>(found.count),
                           static_cast<py::ssize_t>(shape.columns)});
  return py::make_tuple(ratios, found.first, found.method);
}

py::tuple error_rates(double rows_per_chip, double exposure, double noise) {
  const auto rates = unlocked([&] { return detector_error_rates(rows_per_chip, exposure, noise); });
  return py::make_tuple(rates.slicer, rates.inverse, rates.wiener, rates.dfe, rates.mlse);
}

}  // namespace

void register_chips(py::module_& module) {
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
  module.def("detect_chips", &detect, arg("columns"), arg("camera"), arg("channel"), arg("method"));
  module.def("detector_names", [] {
    const auto names = detector_names();
    return std::vector<std::string>(names.begin(), names.end());
  });
  module.def("detector_error_rates", &error_rates, arg("rows_per_chip"), arg("exposure"), arg("noise"));
}

}  // namespace ocisac::bindings
