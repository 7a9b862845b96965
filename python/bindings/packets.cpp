#include "packets.hpp"

namespace ocisac::bindings {

namespace {

using Bytes = py::array_t<std::uint8_t, py::array::c_style>;
py::bytes as_bytes(const std::vector<std::uint8_t>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

py::tuple layout_tuple(const PacketLayout& layout) {
  return py::make_tuple(layout.codewords, layout.codeword_data, layout.blocks, layout.block_chips);
}

py::tuple transmit_tuple(const Bytes& payload, const CodeName& line_code, std::size_t block_bytes,
                         const std::string& preamble, unsigned number) {
  const auto format = format_of(line_code, block_bytes, preamble);
  const auto bytes = span_of(payload);
  const auto chips = unlocked([&] { return packet_chips(bytes, format, number); });
  return py::make_tuple(array_of(chips), layout_tuple(packet_layout(bytes.size(), format)));
}

py::tuple decode_tuple(const Doubles& llr, const CodeName& line_code) {
  const auto code = line_code_of(line_code);
  const auto chips = span_of(llr);
  const auto decoded = unlocked([&] { return code.decode(chips); });
  return py::make_tuple(array_of(decoded.llr), array_of(decoded.violations));
}

py::tuple demodulate(const Camera& camera, const std::vector<double>& tones, const std::vector<double>& signal,
                     std::optional<double> amplitude) {
  return symbol_tuple(FskDemodulator(camera, tones, signal.size()).demodulate(signal, amplitude));
}

}  // namespace

LineCode line_code_of(const CodeName& name) {
  if (const auto* words = std::get_if<std::vector<std::string>>(&name)) return LineCode::of_table(*words);
  return LineCode::named(std::get<std::string>(name));
}

Preamble preamble_of(const std::string& name) {
  if (name == "standard") return Preamble::standard;
  if (name == "lengthened") return Preamble::lengthened;
  refuse("preamble", '"' + name + '"', "standard, lengthened");
}

PacketFormat format_of(const CodeName& line_code, std::size_t block_bytes, const std::string& preamble) {
  return {line_code_of(line_code), block_bytes, preamble_of(preamble)};
}

py::tuple stretch_tuple(const StretchReport& report) {
  py::object payload = py::none();
  if (report.payload)
    payload = py::make_tuple(as_bytes(report.payload->bytes), report.payload->number, report.payload->corrected);
  return py::make_tuple(std::string(outcome_name(report.outcome)), report.blocks, report.bytes, report.cut,
                        report.doubtful, report.violations, report.share, payload, report.inverted,
                        std::string(lack_name(report.lack)));
}

py::tuple symbol_tuple(const FskSymbol& symbol) {
  return py::make_tuple(symbol.symbol, array_of(symbol.log_likelihoods), array_of(symbol.llr), symbol.snr,
                        symbol.error_rate, symbol.amplitude, symbol.noise);
}

void register_packets(py::module_& module) {
  using py::arg;
  module.def(
      "encode_line_code",
      [](const Bytes& bits, const CodeName& line_code) {
        return array_of(line_code_of(line_code).encode(span_of(bits)));
      },
      arg("bits"), arg("line_code"));
  module.def("decode_line_code", &decode_tuple, arg("llr"), arg("line_code"));
  module.def("transmit", &transmit_tuple, arg("payload"), arg("line_code"), arg("block_bytes"), arg("preamble"),
             arg("number"));
  module.def(
      "longest_payload",
      [](const CodeName& line_code, std::size_t block_bytes, const std::string& preamble) {
        return longest_payload(format_of(line_code, block_bytes, preamble));
      },
      arg("line_code"), arg("block_bytes"), arg("preamble"));
  module.def("fsk_demodulate", &demodulate, arg("camera"), arg("tones"), arg("signal"), arg("amplitude"));
  module.def("fsk_symbol_error_rate", &fsk_symbol_error_rate, arg("tones"), arg("snr"));
  py::class_<Shared<PacketAssembler>>(module, "PacketAssembler")
      .def(py::init([](const CodeName& line_code, std::size_t block_bytes, const std::string& preamble) {
             return Shared(PacketAssembler(format_of(line_code, block_bytes, preamble)));
           }),
           arg("line_code"), arg("block_bytes"), arg("preamble"))
      .def(
          "push",
          [](Shared<PacketAssembler>& assembler, std::ptrdiff_t first, const Doubles& llr, double scatter) {
            const auto values = span_of(llr);
            return stretch_tuple(assembler.call(
                [&](PacketAssembler& alone) { return alone.push(first, values, {.scatter = scatter}); }));
          },
          arg("first"), arg("llr"), arg("scatter"))
      .def("lose_clock", [](Shared<PacketAssembler>& assembler) {
        assembler.call([](PacketAssembler& alone) { alone.lose_clock(); });
      });
}

}  // namespace ocisac::bindings
