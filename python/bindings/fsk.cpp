#include "ocisac/receiver/fsk.hpp"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <optional>
#include <vector>

#include "arrays.hpp"
#include "packet_arguments.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace {

// In the order of ocisac_fast.fsk.FskSymbol.
py::tuple symbol_tuple(const FskSymbol& symbol) {
  return py::make_tuple(symbol.symbol, as_array(symbol.likelihoods), as_array(symbol.llr), symbol.snr,
                        symbol.error_rate, symbol.amplitude, symbol.noise);
}

py::tuple demodulate(const Camera& camera, const std::vector<double>& tones, const std::vector<double>& signal,
                     std::optional<double> amplitude) {
  return symbol_tuple(FskDemodulator(camera, tones, signal.size()).demodulate(signal, amplitude));
}

}  // namespace

void register_fsk(py::module_& module) {
  module.def("fsk_demodulate", &demodulate, py::arg("camera"), py::arg("tones"), py::arg("signal"),
             py::arg("amplitude"));
  module.def("fsk_symbol_error_rate", &fsk_symbol_error_rate, py::arg("tones"), py::arg("snr"));
}

}  // namespace ocisac::bindings
