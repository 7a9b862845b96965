#include "ocisac/packets/packets.hpp"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "arrays.hpp"
#include "ocisac/packets/line_codes.hpp"
#include "packet_arguments.hpp"
#include "register.hpp"
#include "shared.hpp"

namespace ocisac::bindings {

namespace {

using Bytes = py::array_t<std::uint8_t, py::array::c_style>;
using Ratios = py::array_t<double, py::array::c_style>;
template <class T>
std::span<const T> values_of(const py::array_t<T, py::array::c_style>& array) {
  return {array.data(), static_cast<std::size_t>(array.size())};
}

py::tuple layout_tuple(const PacketLayout& layout) {
  return py::make_tuple(layout.codewords, layout.codeword_data, layout.blocks, layout.block_chips);
}

py::tuple transmit_tuple(const Bytes& payload, const CodeName& line_code, std::size_t block_bytes,
                         const std::string& preamble, unsigned number) {
  const auto format = format_of(line_code, block_bytes, preamble);
  const auto bytes = values_of(payload);
  std::vector<std::uint8_t> chips;
  {
    const py::gil_scoped_release unlocked;
    chips = packet_chips(bytes, format, number);
  }
  return py::make_tuple(as_array(chips), layout_tuple(packet_layout(bytes.size(), format)));
}

py::tuple decode_tuple(const Ratios& llr, const CodeName& line_code) {
  const auto decoded = line_code_of(line_code).decode(values_of(llr));
  return py::make_tuple(as_array(decoded.llr), as_array(decoded.violations));
}

}  // namespace

void register_packets(py::module_& module) {
  module.def(
      "encode_line_code",
      [](const Bytes& bits, const CodeName& line_code) {
        return as_array(line_code_of(line_code).encode(values_of(bits)));
      },
      py::arg("bits"), py::arg("line_code"));
  module.def("decode_line_code", &decode_tuple, py::arg("llr"), py::arg("line_code"));
  module.def("transmit", &transmit_tuple, py::arg("payload"), py::arg("line_code"), py::arg("block_bytes"),
             py::arg("preamble"), py::arg("number"));
  module.def(
      "longest_payload",
      [](const CodeName& line_code, std::size_t block_bytes, const std::string& preamble) {
        return longest_payload(format_of(line_code, block_bytes, preamble));
      },
      py::arg("line_code"), py::arg("block_bytes"), py::arg("preamble"));
  py::class_<Shared<PacketAssembler>>(module, "PacketAssembler")
      .def(py::init([](const CodeName& line_code, std::size_t block_bytes, const std::string& preamble) {
             return Shared(PacketAssembler(format_of(line_code, block_bytes, preamble)));
           }),
           py::arg("line_code"), py::arg("block_bytes"), py::arg("preamble"))
      .def(
          "push",
          [](Shared<PacketAssembler>& assembler, std::ptrdiff_t first, const Ratios& llr) {
            const auto values = values_of(llr);
            return stretch_tuple(assembler.call([&](PacketAssembler& alone) { return alone.push(first, values); }));
          },
          py::arg("first"), py::arg("llr"))
      .def("lose_clock", [](Shared<PacketAssembler>& assembler) {
        assembler.call([](PacketAssembler& alone) { alone.lose_clock(); });
      });
}

}  // namespace ocisac::bindings
