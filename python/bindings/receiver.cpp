#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <vector>

#include "arrays.hpp"
#include "ocisac/receiver/receive.hpp"
#include "register.hpp"

namespace ocisac::bindings {

namespace {

py::array_t<double> as_array(const std::vector<double>& values) {
  return py::array_t<double>(static_cast<py::ssize_t>(values.size()), values.data());
}

// In the order of ocisac_fast.receiver.Received.
py::tuple as_tuple(const Received& received) {
  return py::make_tuple(received.frame, received.source, received.colour, received.bits, received.rows_per_chip,
                        received.rows_per_chip_std, received.phase, received.snr, as_array(received.detection.dark),
                        as_array(received.detection.bright), as_array(received.detection.soft),
                        as_array(received.weights), received.flags);
}

py::list receive_list(const std::vector<py::array>& colours, const Camera& camera, std::optional<double> chip_rate) {
  std::vector<AnyFramesView> views;
  for (const auto& colour : colours) views.push_back(any_view(colour));
  std::vector<Received> results;
  {
    const py::gil_scoped_release unlocked;
    results = receive(views, camera, {chip_rate});
  }
  py::list list;
  for (const auto& received : results) list.append(as_tuple(received));
  return list;
}

}  // namespace

void register_receiver(py::module_& module) {
  module.def("receive", &receive_list, py::arg("colours"), py::arg("camera"), py::arg("chip_rate"));
}

}  // namespace ocisac::bindings
