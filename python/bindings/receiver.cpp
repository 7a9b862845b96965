#include "bindings.hpp"
#include "ocisac/receiver/fsk_receiver.hpp"
#include "ocisac/receiver/multi_receiver.hpp"
#include "ocisac/receiver/receive.hpp"
#include "ocisac/receiver/stream_receiver.hpp"
#include "packets.hpp"

namespace ocisac::bindings {

namespace {

// In the order of ocisac_fast.receiver.Received.
py::tuple as_tuple(const Received& received) {
  return py::make_tuple(received.frame, received.source, received.colour, received.bits, received.rows_per_chip,
                        received.rows_per_chip_std, received.phase, received.snr, array_of(received.detection.dark),
                        array_of(received.detection.bright), array_of(received.detection.soft),
                        array_of(received.weights), received.flags);
}

py::list receive_list(const std::vector<py::array>& colours, const Camera& camera, std::optional<double> chip_rate) {
  const auto views = views_of(colours);
  const auto results = unlocked([&] { return receive(views, camera, {chip_rate}); });
  py::list list;
  for (const auto& received : results) list.append(as_tuple(received));
  return list;
}

// In the order of ocisac_fast.receiver.ReceivedFrame.
py::tuple as_tuple(const ReceivedFrame& frame) {
  py::object stretch = py::none();
  if (frame.stretch) stretch = stretch_tuple(*frame.stretch);
  return py::make_tuple(frame.frame, std::string(outcome_name(frame.outcome)), frame.missing, frame.colour, frame.bits,
                        frame.phase, frame.rows_per_chip, frame.rows_per_chip_std, frame.exposure, frame.exposure_std,
                        frame.snr, frame.error_rate, array_of(frame.llr), stretch, frame.flags);
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

py::tuple push_fsk(FskReceiver& receiver, const std::vector<py::array>& colours, std::optional<std::int64_t> frame) {
  const auto views = views_of(colours);
  const FskFrame result = unlocked([&] { return receiver.push(views, frame); });
  py::object symbol = py::none(), stretch = py::none();
  if (result.symbol) symbol = symbol_tuple(*result.symbol);
  if (result.stretch) stretch = stretch_tuple(*result.stretch);
  return py::make_tuple(result.frame, std::string(outcome_name(result.outcome)), result.missing, result.colour, symbol,
                        stretch, result.flags);
}

}  // namespace

void register_receiver(py::module_& module) {
  using py::arg;
  module.def("receive", &receive_list, arg("colours"), arg("camera"), arg("chip_rate"));
  py::class_<Shared<Receiver>>(module, "Receiver")
      .def(py::init([](const Camera& camera, std::optional<double> chip_rate, const CodeName& line_code,
                       std::size_t block_bytes, const std::string& preamble, std::optional<double> search_passes) {
             return Shared(Receiver(camera, {chip_rate, format_of(line_code, block_bytes, preamble), search_passes}));
           }),
           arg("camera"), arg("chip_rate"), arg("line_code"), arg("block_bytes"), arg("preamble"), arg("search_passes"))
      .def(
          "push",
          [](Shared<Receiver>& receiver, const std::vector<py::array>& colours, std::optional<std::int64_t> frame) {
            const auto views = views_of(colours);
            return as_tuple(receiver.call([&](Receiver& alone) { return alone.push(views, frame); }));
          },
          arg("colours"), arg("frame"));
  py::class_<Shared<MultiReceiver>>(module, "MultiReceiver")
      .def(py::init(&multi_receiver), arg("camera"), arg("chip_rate"), arg("line_code"), arg("block_bytes"),
           arg("preamble"), arg("search_passes"), arg("regions"), arg("max_sources"))
      .def("push", &push_multi, arg("colours"), arg("frame"));
  py::class_<FskReceiver>(module, "FskReceiver")
      .def(py::init([](const Camera& camera, std::vector<double> tones, std::size_t block_bytes,
                       const std::string& preamble) {
             return FskReceiver(camera, std::move(tones), block_bytes, preamble_of(preamble));
           }),
           arg("camera"), arg("tones"), arg("block_bytes"), arg("preamble"))
      .def("push", &push_fsk, arg("colours"), arg("frame"));
}

}  // namespace ocisac::bindings
