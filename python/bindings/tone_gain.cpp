#include "ocisac/tones/tone_gain.hpp"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <string>

#include "arrays.hpp"
#include "ocisac/tones/varying_tone.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace {

using DoubleArray = py::array_t<double, py::array::c_style | py::array::forcecast>;

GainMethod gain_method(const std::string& name) {
  if (name == "fit") return GainMethod::fit;
  if (name == "dft") return GainMethod::dft;
  refuse("method", name, "fit or dft");
}

WaveformShape waveform_shape(const std::string& name) {
  if (name == "tone") return WaveformShape::tone;
  if (name == "square") return WaveformShape::square;
  refuse("waveform", name, "tone or square");
}

template <class T>
py::array_t<T> as_array(const std::vector<T>& values, const std::vector<py::ssize_t>& shape) {
  py::array_t<T> array(shape);
  std::ranges::copy(values, array.mutable_data());
  return array;
}

// The axis of the tones where there is one, then those of the columns without rows (and without columns, if pooled).
std::vector<py::ssize_t> result_shape(const DoubleArray& frequencies, const py::array& columns, bool pooled) {
  std::vector<py::ssize_t> shape(frequencies.shape(), frequencies.shape() + frequencies.ndim());
  if (columns.ndim() == 3) shape.push_back(columns.shape(0));
  if (columns.ndim() > 1 && !pooled) shape.push_back(columns.shape(columns.ndim() - 1));
  return shape;
}

template <class T>
std::span<T> span_of(py::array_t<T>& array) {
  return {array.mutable_data(), static_cast<std::size_t>(array.size())};
}

// gain, gain_std, phase, mean, snr, flags. frequencies: () or (tones,).
py::tuple tone_gain_arrays(const py::array& columns, const Camera& camera, const DoubleArray& frequencies,
                           const std::string& method, const std::string& waveform, double duty,
                           const DoubleArray& background, double efficiency, int threads, bool pooled) {
  const AnyFramesView view = any_view(columns);
  const std::span tones(frequencies.data(), static_cast<std::size_t>(frequencies.size()));
  const ToneGainOptions options{gain_method(method),
                                waveform_shape(waveform),
                                duty,
                                {background.data(), static_cast<std::size_t>(background.size())},
                                efficiency,
                                threads};
  const auto shape = result_shape(frequencies, columns, pooled);
  py::array_t<double> gain(shape), gain_std(shape), phase(shape), mean(shape), snr(shape);
  py::array_t<Flags> flags(shape);
  const ToneGainView result{span_of(gain), span_of(gain_std), span_of(phase),
                            span_of(mean), span_of(snr),      span_of(flags)};
  {
    const py::gil_scoped_release unlocked;
    if (pooled)
      pooled_tone_gain(view, camera, tones, options, result);
    else
      tone_gain(view, camera, tones, options, result);
  }
  return py::make_tuple(gain, gain_std, phase, mean, snr, flags);
}

// (frames, columns) arrays: gain, gain_std, mean, bias, bias_std, flags.
py::tuple varying_tone_gain_arrays(const py::array& columns, const Camera& camera, double frequency, int degree,
                                   const std::string& waveform, double duty, const DoubleArray& background,
                                   int threads) {
  const AnyFramesView view = any_view(columns);
  const VaryingToneOptions options{degree,
                                   waveform_shape(waveform),
                                   duty,
                                   {background.data(), static_cast<std::size_t>(background.size())},
                                   threads};
  VaryingToneGain result;
  {
    const py::gil_scoped_release unlocked;
    result = varying_tone_gain(view, camera, frequency, options);
  }
  const std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(result.frames),
                                       static_cast<py::ssize_t>(result.columns)};
  return py::make_tuple(as_array(result.gain, shape), as_array(result.gain_std, shape), as_array(result.mean, shape),
                        as_array(result.bias, shape), as_array(result.bias_std, shape), as_array(result.flags, shape));
}

}  // namespace

void register_tone_gain(py::module_& module) {
  module.def("flag_names", &flag_names, py::arg("flags"));
  module.def("tone_gain", &tone_gain_arrays, py::arg("columns"), py::arg("camera"), py::arg("frequencies"),
             py::arg("method"), py::arg("waveform"), py::arg("duty"), py::arg("background"), py::arg("efficiency"),
             py::arg("threads"), py::arg("pooled"));
  module.def("varying_tone_gain", &varying_tone_gain_arrays, py::arg("columns"), py::arg("camera"),
             py::arg("frequency"), py::arg("degree"), py::arg("waveform"), py::arg("duty"), py::arg("background"),
             py::arg("threads"));
}

}  // namespace ocisac::bindings
