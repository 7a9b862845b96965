#include "tones.hpp"

#include <utility>

#include "bindings.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/rows/basis.hpp"
#include "ocisac/rows/dense_fit.hpp"
#include "ocisac/tones/equalize.hpp"
#include "ocisac/tones/find_frequency.hpp"
#include "ocisac/tones/projection.hpp"
#include "ocisac/tones/tone_gain.hpp"
#include "ocisac/tones/tone_spectrum.hpp"
#include "ocisac/tones/varying_tone.hpp"

namespace ocisac::bindings {

namespace {

GainMethod gain_method(const std::string& name) {
  if (name == "fit" || name == "robust") return GainMethod::fit;
  if (name == "dft") return GainMethod::dft;
  refuse("method", name, "fit, robust or dft");
}

WaveformShape waveform_shape(const std::string& name) {
  if (name == "tone") return WaveformShape::tone;
  if (name == "square") return WaveformShape::square;
  refuse("waveform", name, "tone or square");
}

ToneGainOptions gain_options(const std::string& method, const std::string& waveform, double duty,
                             std::span<const double> background, double efficiency, int threads, bool pooled) {
  ToneGainOptions options{gain_method(method), waveform_shape(waveform), duty, background, efficiency, threads};
  options.robust = method == "robust";
  options.pooled = pooled;
  return options;
}

using Shape = std::vector<py::ssize_t>;

// gain, gain_std, phase, mean, snr, flags. shape: the axis of the tones, if there is one.
py::tuple gain_arrays(const py::array& columns, const Camera& camera, std::span<const double> tones, Shape shape,
                      const ToneGainOptions& options) {
  const AnyFramesView view = any_view(columns);
  if (columns.ndim() == 3) shape.push_back(columns.shape(0));
  if (columns.ndim() > 1 && !options.pooled) shape.push_back(columns.shape(columns.ndim() - 1));
  py::array_t<double> gain(shape), gain_std(shape), phase(shape), mean(shape), snr(shape);
  py::array_t<Flags> flags(shape);
  const ToneGainView result{mutable_span_of(gain), mutable_span_of(gain_std), mutable_span_of(phase),
                            mutable_span_of(mean), mutable_span_of(snr),      mutable_span_of(flags)};
  unlocked([&] { tone_gain(view, camera, tones, options, result); });
  return py::make_tuple(gain, gain_std, phase, mean, snr, flags);
}

// frequencies: () or (tones,).
py::tuple tone_gain_arrays(const py::array& columns, const Camera& camera, const Doubles& frequencies,
                           const std::string& method, const std::string& waveform, double duty,
                           const Doubles& background, double efficiency, int threads, bool pooled) {
  if (frequencies.ndim() > 1)
    refuse("frequency", "shape " + py::str(frequencies.attr("shape")).cast<std::string>(), "one value or (tones,)");
  return gain_arrays(columns, camera, span_of(frequencies),
                     {frequencies.shape(), frequencies.shape() + frequencies.ndim()},
                     gain_options(method, waveform, duty, span_of(background), efficiency, threads, pooled));
}

// A float or an array (tones,) of them; no value for what must be converted first.
std::optional<std::vector<double>> frequencies_as_given(const py::object& frequency) {
  if (PyFloat_Check(frequency.ptr())) return std::vector{frequency.cast<double>()};
  if (!is_viewable(frequency)) return {};
  const auto values = py::reinterpret_borrow<py::array>(frequency);
  if (!holds<double>(values) || values.ndim() != 1) return {};
  const auto view = typed_view<const double>(values, static_cast<const double*>(values.data()));
  std::vector<double> tones(view.rows);
  for (std::size_t k = 0; k < tones.size(); ++k) tones[k] = view(0, k, 0);
  return tones;
}

// The same of arguments that need no conversion: an array that can be viewed, Python's own numbers and texts, no
// background. None for others, which Python checks and converts first: that takes 40 to 100 µs where a pass over frames
// has displaced the interpreter from the caches.
py::object tone_gain_as_given(const py::object& columns, const Camera& camera, const py::object& frequency,
                              const py::object& method, const py::object& waveform, const py::object& duty,
                              const py::object& background, const py::object& efficiency, const py::object& threads,
                              const py::object& pooled) {
  const auto are_floats = [](const auto&... values) { return (PyFloat_Check(values.ptr()) && ...); };
  if (!is_viewable(columns) || !are_floats(duty, background, efficiency) || !PyUnicode_CheckExact(method.ptr()) ||
      !PyUnicode_CheckExact(waveform.ptr()) || !PyLong_CheckExact(threads.ptr()) || !PyBool_Check(pooled.ptr()))
    return py::none();
  const auto tones = frequencies_as_given(frequency);
  int overflow = 0;
  const long count = PyLong_AsLongAndOverflow(threads.ptr(), &overflow);
  if (!tones || background.cast<double>() != 0 || overflow != 0 || !std::in_range<int>(count)) return py::none();
  return gain_arrays(py::reinterpret_borrow<py::array>(columns), camera, *tones,
                     PyFloat_Check(frequency.ptr()) ? Shape() : Shape{static_cast<py::ssize_t>(tones->size())},
                     gain_options(method.cast<std::string>(), waveform.cast<std::string>(), duty.cast<double>(), {},
                                  efficiency.cast<double>(), static_cast<int>(count), pooled.is(py::bool_(true))));
}

// (frames, columns) arrays: gain, gain_std, mean, bias, bias_std, flags.
py::tuple varying_tone_gain_arrays(const py::array& columns, const Camera& camera, double frequency, int degree,
                                   const std::string& waveform, double duty, const Doubles& background, int threads) {
  const AnyFramesView view = any_view(columns);
  const ToneGainOptions options{GainMethod::fit, waveform_shape(waveform), duty, span_of(background), 1.0, threads};
  const auto result = unlocked([&] { return varying_tone_gain(view, camera, frequency, degree, options); });
  const std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(result.frames),
                                       static_cast<py::ssize_t>(result.columns)};
  return py::make_tuple(array_of(result.gain, shape), array_of(result.gain_std, shape), array_of(result.mean, shape),
                        array_of(result.bias, shape), array_of(result.bias_std, shape), array_of(result.flags, shape));
}

RowWeights row_weights(const Doubles& weights, std::size_t rows, int row_group, int limbs) {
  require(weights.ndim() == 2, "weights", std::to_string(weights.ndim()) + " dimensions", "(outputs, groups)");
  const auto outputs = static_cast<std::size_t>(weights.shape(0));
  return {span_of(weights), outputs, rows, row_group, limbs};
}

// sums (outputs, columns), totals, squares and maximum (columns,) of one frame.
py::tuple project_frame(const py::array& columns, const RowWeights& weights) {
  require(columns.ndim() == 2, "columns", std::to_string(columns.ndim()) + " dimensions", "(rows, columns)");
  require(static_cast<std::size_t>(columns.shape(0)) == weights.rows(), "columns",
          std::to_string(columns.shape(0)) + " rows", "as many as the weights are for");
  const AnyFramesView view = any_view(columns);
  const auto count = static_cast<std::size_t>(columns.shape(1));
  const Projection result = unlocked([&] { return project(view, 0, 0, count, weights); });
  const py::ssize_t width = columns.shape(1);
  return py::make_tuple(array_of(result.sums, {static_cast<py::ssize_t>(weights.outputs()), width}),
                        array_of(result.totals, {width}), array_of(result.squares, {width}),
                        array_of(result.maximum, {width}));
}

py::tuple project_once(const py::array& columns, const Doubles& weights, int row_group, int limbs) {
  require(columns.ndim() == 2, "columns", std::to_string(columns.ndim()) + " dimensions", "(rows, columns)");
  return project_frame(columns, row_weights(weights, static_cast<std::size_t>(columns.shape(0)), row_group, limbs));
}

std::uint64_t read_array(const py::array_t<std::uint8_t>& array, int threads) {
  require((array.flags() & py::array::c_style) != 0, "array", "strides", "dense bytes");
  const auto bytes = span_of(array);
  return unlocked([&] { return read_bytes(bytes, threads); });
}

Harmonics harmonics_of(const std::string& waveform) {
  if (waveform == "auto") return Harmonics::automatic;
  if (waveform == "tone") return Harmonics::fundamental;
  if (waveform == "square") return Harmonics::all;
  refuse("waveform", waveform, "auto, tone or square");
}

py::tuple columns_as_arrays(const ToneColumns& columns) {
  py::array_t<bool> used(static_cast<py::ssize_t>(columns.used.size()));
  for (std::size_t i = 0; i < columns.used.size(); ++i)
    used.mutable_at(static_cast<py::ssize_t>(i)) = columns.used[i] != 0;
  return py::make_tuple(used, array_of(columns.strength), columns.saturated);
}

}  // namespace

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

py::tuple tuple_of(const FoundFrequency& found) {
  return py::make_tuple(found.frequency, found.frequency_std, found.snr, found.harmonics, found.flags,
                        columns_as_arrays(found.columns), found.may_be_texture);
}

namespace {

py::tuple find(const py::array& columns, const Camera& camera, const Bounds& bounds, const std::string& waveform,
               bool select_columns) {
  const AnyFramesView view = any_view(columns);
  FrequencySearch search = search_of(camera, bounds, waveform, select_columns);
  search.saturation = saturation_level(view, camera.tone_curve);
  return tuple_of(unlocked([&] { return find_frequency(view, search); }));
}

py::tuple columns_of_tone(const py::array& columns, const Camera& camera, double frequency) {
  const AnyFramesView view = any_view(columns);
  return columns_as_arrays(unlocked(
      [&] { return tone_columns(view, frequency * camera.row_time, saturation_level(view, camera.tone_curve)); }));
}

// (rows, columns)
py::array_t<double> design_of(std::size_t rows, const std::vector<double>& cycles_per_row, std::size_t trend_degree) {
  std::vector<double> matrix;
  append_trend(matrix, centred_rows(rows), trend_degree);
  append_tones(matrix, centred_rows(rows), cycles_per_row);
  py::array_t<double, py::array::f_style> out({rows, matrix.size() / rows});
  std::ranges::copy(matrix, out.mutable_data());
  return out;
}

py::array_t<double> matrix_of(const std::vector<double>& values, std::size_t rows) {
  py::array_t<double> out({rows, values.size() / rows});
  std::ranges::copy(values, out.mutable_data());
  return out;
}

// The product of two matrices in this thread: threads of NumPy's BLAS wait for each other in small ones, 40 times as
// long as the arithmetic.
py::array_t<double> product_of(const Doubles& a, const Doubles& b) {
  if (a.ndim() != 2 || b.ndim() != 2) refuse("product", "other shapes", "two matrices");
  const auto rows = static_cast<std::size_t>(a.shape(0)), columns = static_cast<std::size_t>(b.shape(1));
  return matrix_of(dense_product(span_of(a), rows, span_of(b), columns), rows);
}

// Pseudo-inverse (parameters, rows) of a design (rows, parameters), covariance of the parameters, and the condition.
py::tuple fit_of_design(const Doubles& design) {
  if (design.ndim() != 2) refuse("design", "another shape", "a matrix");
  std::vector<double> weights, covariance;
  const double condition = dense_fit(span_of(design), static_cast<std::size_t>(design.shape(0)), weights, covariance);
  const auto parameters = static_cast<std::size_t>(design.shape(1));
  return py::make_tuple(matrix_of(weights, parameters), matrix_of(covariance, parameters), condition);
}

EqualizerMethod equalizer_method(const std::string& name) {
  if (name == "inverse") return EqualizerMethod::inverse;
  if (name == "wiener") return EqualizerMethod::wiener;
  refuse("method", name, "inverse or wiener");
}

// (bands, 2): lowest and highest frequency
py::array_t<double> bands_array(const std::vector<Interval>& bands) {
  py::array_t<double> array({static_cast<py::ssize_t>(bands.size()), py::ssize_t{2}});
  auto values = array.mutable_unchecked<2>();
  for (py::ssize_t i = 0; i < values.shape(0); ++i) {
    values(i, 0) = bands[static_cast<std::size_t>(i)].low;
    values(i, 1) = bands[static_cast<std::size_t>(i)].high;
  }
  return array;
}

py::tuple run_equalize(const py::array& columns, const Camera& camera, const std::string& method, const Doubles& noise,
                       double max_boost, int threads, py::array out) {
  const AnyFramesView view = any_view(columns);
  const EqualizerSettings settings{equalizer_method(method), max_boost, span_of(noise), threads};
  const auto run = [&](const auto& result) {
    return unlocked([&] { return equalize(view, camera, settings, result); });
  };
  const EqualizerReport report = out.dtype().equal(py::dtype::of<float>())
                                     ? run(mutable_view<float>(out, "float32"))
                                     : run(mutable_view(out, "float32 or float64"));
  return py::make_tuple(bands_array(report.frequencies_lost), array_of(report.noise_gain), array_of(report.noise));
}

}  // namespace

void register_tones(py::module_& module) {
  using py::arg;
  module.def("tone_gain", &tone_gain_arrays, arg("columns"), arg("camera"), arg("frequencies"), arg("method"),
             arg("waveform"), arg("duty"), arg("background"), arg("efficiency"), arg("threads"), arg("pooled"));
  module.def("tone_gain_as_given", &tone_gain_as_given);
  module.def("lost_at_black", py::vectorize(lost_at_black), arg("level"), arg("deviation"), arg("off"));
  module.def(
      "folded_harmonics",
      [](std::size_t rows, double cycles_per_row, double duty, double exposure_cycles) {
        auto folded = folded_harmonics(rows, cycles_per_row, duty, exposure_cycles);
        return std::pair{std::move(folded.orders), folded.error};
      },
      arg("rows"), arg("cycles_per_row"), arg("duty"), arg("exposure_cycles"));
  module.def("square_wave_harmonics", &square_wave_harmonics, arg("cycles_per_row"), arg("duty"));
  module.def("varying_tone_gain", &varying_tone_gain_arrays, arg("columns"), arg("camera"), arg("frequency"),
             arg("degree"), arg("waveform"), arg("duty"), arg("background"), arg("threads"));
  py::class_<RowWeights>(module, "RowWeights")
      .def(py::init(&row_weights), arg("weights"), arg("rows"), arg("row_group"), arg("limbs"));
  module.def("project", &project_frame, arg("columns"), arg("weights"));
  module.def("project", &project_once, arg("columns"), arg("weights"), arg("row_group"), arg("limbs"));
  module.def("read_bytes", &read_array, arg("array").noconvert(), arg("threads") = 1);
  module.def("simd_target", &simd_target);
  module.def("simd_targets", &simd_targets);
  module.def("force_simd_target", &force_simd_target, arg("name"));
  module.def("find_frequency", &find, arg("columns"), arg("camera"), arg("bounds"), arg("waveform"),
             arg("select_columns"));
  module.def("tone_columns", &columns_of_tone, arg("columns"), arg("camera"), arg("frequency"));
  module.def(
      "amplitude_spectrum", [](const Doubles& signal) { return array_of(amplitude_spectrum(span_of(signal))); },
      arg("signal"));
  module.def("tone_design", &design_of, arg("rows"), arg("cycles_per_row"), arg("trend_degree"));
  module.def("product", &product_of, arg("a"), arg("b"));
  module.def("linear_fit", &fit_of_design, arg("design"));
  module.def("equalize", &run_equalize, arg("columns"), arg("camera"), arg("method"), arg("noise"), arg("max_boost"),
             arg("threads"), arg("out"));
  module.def(
      "lost_frequencies",
      [](const Camera& camera, double max_boost) { return bands_array(lost_frequencies(camera, max_boost)); },
      arg("camera"), arg("max_boost"));
}

}  // namespace ocisac::bindings
