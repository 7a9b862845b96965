#include "ocisac/receiver/stream_receiver.hpp"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "ocisac/receiver/multi_receiver.hpp"
#include "packet_arguments.hpp"
#include "register.hpp"
#include "shared.hpp"

namespace ocisac::bindings {

namespace {

// In the order of ocisac_fast.receiver.ReceivedFrame.
py::tuple as_tuple(const ReceivedFrame& frame) {
  py::object stretch = py::none();
  if (frame.stretch) stretch = stretch_tuple(*frame.stretch);
  return py::make_tuple(frame.frame, std::string(outcome_name(frame.outcome)), frame.missing, frame.colour, frame.bits,
                        frame.phase, frame.rows_per_chip, frame.rows_per_chip_std, frame.exposure, frame.exposure_std,
                        frame.snr, frame.error_rate, as_array(frame.llr), stretch, frame.flags);
}

using Box = std::tuple<std::size_t, std::size_t, std::size_t, std::size_t>;

Shared<MultiReceiver> multi_receiver(const Camera& camera, std::optional<double> chip_rate, const CodeName& line_code,
                                     std::size_t block_bytes, const std::string& preamble,
                                     std::optional<double> search_passes, const std::vector<Box>& regions,
                                     std::size_t max_sources) {
  MultiReceiverOptions options{
      {chip_rate, format_of(line_code, block_bytes, preamble), search_passes}, {}, max_sources};
  for (const auto& [x, y, width, height] : regions) options.regions.push_back({x, y, width, height});
  return Shared(MultiReceiver(camera, std::move(options)));
}

std::vector<AnyFramesView> views_of(const std::vector<py::array>& colours) {
  std::vector<AnyFramesView> views;
  for (const auto& colour : colours) views.push_back(any_view(colour));
  return views;
}

py::list push_multi(Shared<MultiReceiver>& receiver, const std::vector<py::array>& colours,
                    std::optional<std::int64_t> frame) {
  const auto views = views_of(colours);
  const auto results = receiver.call([&](MultiReceiver& alone) { return alone.push(views, frame); });
  py::list list;
  for (const auto& [source, region, received] : results)
    list.append(
        py::make_tuple(source, py::make_tuple(region.x, region.y, region.width, region.height), as_tuple(received)));
  return list;
}

}  // namespace

void register_stream_receiver(py::module_& module) {
  py::class_<Shared<Receiver>>(module, "Receiver")
      .def(py::init([](const Camera& camera, std::optional<double> chip_rate, const CodeName& line_code,
                       std::size_t block_bytes, const std::string& preamble, std::optional<double> search_passes) {
             return Shared(Receiver(camera, {chip_rate, format_of(line_code, block_bytes, preamble), search_passes}));
           }),
           py::arg("camera"), py::arg("chip_rate"), py::arg("line_code"), py::arg("block_bytes"), py::arg("preamble"),
           py::arg("search_passes"))
      .def(
          "push",
          [](Shared<Receiver>& receiver, const std::vector<py::array>& colours, std::optional<std::int64_t> frame) {
            const auto views = views_of(colours);
            return as_tuple(receiver.call([&](Receiver& alone) { return alone.push(views, frame); }));
          },
          py::arg("colours"), py::arg("frame"));
  py::class_<Shared<MultiReceiver>>(module, "MultiReceiver")
      .def(py::init(&multi_receiver), py::arg("camera"), py::arg("chip_rate"), py::arg("line_code"),
           py::arg("block_bytes"), py::arg("preamble"), py::arg("search_passes"), py::arg("regions"),
           py::arg("max_sources"))
      .def("push", &push_multi, py::arg("colours"), py::arg("frame"));
}

}  // namespace ocisac::bindings
