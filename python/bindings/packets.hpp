// Arguments and results of packets that the bindings of receivers use too.
#pragma once

#include <string>
#include <variant>
#include <vector>

#include "bindings.hpp"
#include "ocisac/packets/fsk.hpp"
#include "ocisac/packets/line_codes.hpp"
#include "ocisac/packets/packets.hpp"

namespace ocisac::bindings {

using CodeName = std::variant<std::string, std::vector<std::string>>;

LineCode line_code_of(const CodeName& name);
PacketFormat format_of(const CodeName& line_code, std::size_t block_bytes, const std::string& preamble);
Preamble preamble_of(const std::string& name);
py::tuple stretch_tuple(const StretchReport& report);  // in the order of ocisac_fast.packets.Stretch
py::tuple symbol_tuple(const FskSymbol& symbol);       // in the order of ocisac_fast.packets.FskSymbol

}  // namespace ocisac::bindings
