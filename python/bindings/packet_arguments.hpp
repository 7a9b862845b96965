// Arguments and results that the packets' bindings share.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "ocisac/core/require.hpp"
#include "ocisac/packets/line_codes.hpp"
#include "ocisac/packets/packets.hpp"

namespace ocisac::bindings {

namespace py = pybind11;

using CodeName = std::variant<std::string, std::vector<std::string>>;

inline LineCode line_code_of(const CodeName& name) {
  if (const auto* words = std::get_if<std::vector<std::string>>(&name)) return LineCode::of_table(*words);
  return LineCode::named(std::get<std::string>(name));
}

inline PacketFormat format_of(const CodeName& line_code, std::size_t block_bytes, const std::string& preamble) {
  require(preamble == "standard" || preamble == "lengthened", "preamble", '"' + preamble + '"', "standard, lengthened");
  return {line_code_of(line_code), block_bytes, preamble == "standard" ? Preamble::standard : Preamble::lengthened};
}

template <class T>
py::array_t<T> as_array(const std::vector<T>& values) {
  return py::array_t<T>(static_cast<py::ssize_t>(values.size()), values.data());
}

inline py::bytes as_bytes(const std::vector<std::uint8_t>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

inline std::string name_of(StretchOutcome outcome) {
  switch (outcome) {
    case StretchOutcome::placed: return "placed";
    case StretchOutcome::waiting: return "waiting";
    case StretchOutcome::repeated: return "repeated";
    case StretchOutcome::unreadable: break;
  }
  return "unreadable";
}

// In the order of ocisac_fast.packets.Stretch.
inline py::tuple stretch_tuple(const StretchReport& report) {
  py::object payload = py::none();
  if (report.payload)
    payload = py::make_tuple(as_bytes(report.payload->bytes), report.payload->number, report.payload->corrected);
  return py::make_tuple(name_of(report.outcome), report.blocks, report.bytes, report.cut, report.doubtful,
                        report.violations, report.share, payload);
}

}  // namespace ocisac::bindings
