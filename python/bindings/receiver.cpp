#include "ocisac/receiver/receiver.hpp"

#include "bindings.hpp"
#include "ocisac/receiver/fsk_receiver.hpp"
#include "ocisac/receiver/receive.hpp"
#include "packets.hpp"

namespace ocisac::bindings {

namespace {

using py::literals::operator""_a;

py::dict as_dict(const Received& received) {
  return py::dict(
      "frame"_a = received.frame, "source"_a = received.source, "colour"_a = received.colour, "bits"_a = received.bits,
      "rows_per_chip"_a = received.rows_per_chip, "rows_per_chip_std"_a = received.rows_per_chip_std,
      "phase"_a = received.phase, "snr"_a = received.snr, "dark"_a = array_of(received.detection.dark),
      "bright"_a = array_of(received.detection.bright),
      "relative_levels"_a = array_of(received.detection.relative_levels), "weights"_a = array_of(received.weights),
      "flags"_a = received.flags, "colour_weights"_a = array_of(received.colour_weights));
}

py::list receive_list(const std::vector<py::array>& colours, const Camera& camera, std::optional<double> chip_rate) {
  const auto views = views_of(colours);
  const auto results = unlocked([&] { return receive(views, camera, {chip_rate}); });
  py::list list;
  for (const auto& received : results) list.append(as_dict(received));
  return list;
}

// Frames of all receivers have these values.
template <typename Frame>
py::dict common_dict(const Frame& frame) {
  py::object stretch = py::none();
  if (frame.stretch) stretch = stretch_tuple(*frame.stretch);
  return py::dict("frame"_a = frame.frame, "outcome"_a = std::string(outcome_name(frame.outcome)),
                  "missing"_a = frame.missing, "colour"_a = frame.colour, "stretch"_a = stretch,
                  "flags"_a = frame.flags);
}

py::object as_dict(const std::optional<ReceivedFrame>& frame) {
  if (!frame) return py::none();
  return py::dict("bits"_a = frame->bits, "phase"_a = frame->phase, "rows_per_chip"_a = frame->rows_per_chip,
                  "rows_per_chip_std"_a = frame->rows_per_chip_std, "exposure"_a = frame->exposure,
                  "exposure_std"_a = frame->exposure_std, "snr"_a = frame->snr, "error_rate"_a = frame->error_rate,
                  "llr"_a = array_of(frame->llr), **common_dict(*frame));
}

// In the order of ocisac_fast.receiver.LightGain.
py::object as_tuple(const std::optional<LightGain>& gain) {
  if (!gain) return py::none();
  return py::make_tuple(gain->frequency, gain->frequency_std, gain->gain, gain->gain_std, gain->phase, gain->mean,
                        gain->snr, gain->flags);
}

py::object as_tuple(const std::optional<BestExposure>& suggestion) {
  if (!suggestion) return py::none();
  return py::make_tuple(suggestion->exposure, suggestion->objective);
}

Shared<Receiver> make_receiver(const Camera& camera, bool data, bool gain, std::optional<double> chip_rate,
                               const CodeName& line_code, std::size_t block_bytes, const std::string& preamble,
                               std::optional<double> search_passes, std::optional<double> frequency,
                               const std::string& waveform, double duty, double background,
                               std::optional<double> sense_frequency, bool whole_picture,
                               const std::vector<Region>& regions, std::size_t max_sources) {
  ReceiverOptions options{.regions = regions, .max_sources = max_sources, .whole_picture = whole_picture};
  options.light.data.reset();
  if (data) options.light.data = {chip_rate, format_of(line_code, block_bytes, preamble), search_passes};
  require(waveform == "tone" || waveform == "square", "waveform", '"' + waveform + '"', "tone, square");
  const WaveformShape shape = waveform == "square" ? WaveformShape::square : WaveformShape::tone;
  if (gain) options.light.gain = {frequency, shape, duty, background};
  options.light.sense_frequency = sense_frequency;
  return Shared(Receiver(camera, std::move(options)));
}

py::list push(Shared<Receiver>& receiver, const std::vector<py::array>& colours, std::optional<std::int64_t> number,
              std::optional<double> time, std::optional<double> exposure, std::optional<double> gain) {
  const auto views = views_of(colours);
  const FrameStamp stamp{number, time, exposure, gain};
  const auto results = receiver.call([&](Receiver& alone) { return alone.push(views, stamp); });
  py::list list;
  for (const auto& light : results)
    list.append(py::dict("frame"_a = light.frame, "source"_a = light.source, "region"_a = light.region,
                         "searched"_a = light.searched, "received"_a = as_dict(light.received),
                         "gain"_a = as_tuple(light.gain), "suggestion"_a = as_tuple(light.suggestion)));
  return list;
}

py::dict push_fsk(Shared<FskReceiver>& receiver, const std::vector<py::array>& colours,
                  std::optional<std::int64_t> frame) {
  const auto views = views_of(colours);
  const FskFrame result = receiver.call([&](FskReceiver& alone) { return alone.push(views, frame); });
  py::object symbol = py::none();
  if (result.symbol) symbol = symbol_tuple(*result.symbol);
  return py::dict("symbol"_a = symbol, **common_dict(result));
}

}  // namespace

void register_receiver(py::module_& module) {
  using py::arg;
  module.def("receive", &receive_list, arg("colours"), arg("camera"), arg("chip_rate"));
  py::class_<Shared<Receiver>>(module, "Receiver")
      .def(py::init(&make_receiver), py::kw_only(), arg("camera"), arg("data"), arg("gain"), arg("chip_rate"),
           arg("line_code"), arg("block_bytes"), arg("preamble"), arg("search_passes"), arg("frequency"),
           arg("waveform"), arg("duty"), arg("background"), arg("sense_frequency"), arg("whole_picture"),
           arg("regions"), arg("max_sources"))
      .def("push", &push, arg("colours"), arg("number"), arg("time"), arg("exposure"), arg("gain"));
  py::class_<Shared<FskReceiver>>(module, "FskReceiver")
      .def(py::init([](const Camera& camera, std::vector<double> tones, std::size_t block_bytes,
                       const std::string& preamble) {
             return Shared(FskReceiver(camera, std::move(tones), block_bytes, preamble_of(preamble)));
           }),
           arg("camera"), arg("tones"), arg("block_bytes"), arg("preamble"))
      .def("push", &push_fsk, arg("colours"), arg("frame"));
}

}  // namespace ocisac::bindings
