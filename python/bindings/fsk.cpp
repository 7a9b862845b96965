#include "ocisac/packets/fsk.hpp"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "ocisac/receiver/fsk_receiver.hpp"
#include "packet_arguments.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace {

// In the order of ocisac_fast.packets.FskSymbol.
py::tuple symbol_tuple(const FskSymbol& symbol) {
  return py::make_tuple(symbol.symbol, as_array(symbol.log_likelihoods), as_array(symbol.llr), symbol.snr,
                        symbol.error_rate, symbol.amplitude, symbol.noise);
}

py::tuple demodulate(const Camera& camera, const std::vector<double>& tones, const std::vector<double>& signal,
                     std::optional<double> amplitude) {
  return symbol_tuple(FskDemodulator(camera, tones, signal.size()).demodulate(signal, amplitude));
}

py::tuple push(FskReceiver& receiver, const std::vector<py::array>& colours, std::optional<std::int64_t> frame) {
  std::vector<AnyFramesView> views;
  for (const auto& colour : colours) views.push_back(any_view(colour));
  FskFrame result;
  {
    const py::gil_scoped_release unlocked;
    result = receiver.push(views, frame);
  }
  py::object symbol = py::none(), stretch = py::none();
  if (result.symbol) symbol = symbol_tuple(*result.symbol);
  if (result.stretch) stretch = stretch_tuple(*result.stretch);
  return py::make_tuple(result.frame, std::string(outcome_name(result.outcome)), result.missing, result.colour, symbol,
                        stretch, result.flags);
}

}  // namespace

void register_fsk(py::module_& module) {
  module.def("fsk_demodulate", &demodulate, py::arg("camera"), py::arg("tones"), py::arg("signal"),
             py::arg("amplitude"));
  module.def("fsk_symbol_error_rate", &fsk_symbol_error_rate, py::arg("tones"), py::arg("snr"));
  py::class_<FskReceiver>(module, "FskReceiver")
      .def(py::init([](const Camera& camera, std::vector<double> tones, std::size_t block_bytes,
                       const std::string& preamble) {
             return FskReceiver(camera, std::move(tones), block_bytes,
                                format_of(std::string("none"), block_bytes, preamble).preamble);
           }),
           py::arg("camera"), py::arg("tones"), py::arg("block_bytes"), py::arg("preamble"))
      .def("push", &push, py::arg("colours"), py::arg("frame"));
}

}  // namespace ocisac::bindings
