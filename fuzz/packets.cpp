// The assembler: stretches of a packet's chips, damaged and misplaced as the bytes say. A payload is the one that was
// sent, or there is none.
#include "ocisac/packets/packets.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <vector>

#include "fuzz.hpp"

using namespace ocisac;

namespace {

constexpr std::size_t kMaxStretch = 200;  // chips of a frame; longer ones cost time
constexpr int kMaxStretches = 12;         // of a run

struct Packet {
  PacketFormat format;
  std::vector<std::uint8_t> payload, cycle;
  unsigned number;
};

Packet make_packet(std::array<std::size_t, 5> choice) {
  constexpr std::array names{"none", "manchester", "4b6b", "8b10b"};
  constexpr std::array<std::size_t, 4> block_bytes{16, 1, 7, 120}, payload_bytes{4, 1, 60, 500};
  constexpr std::array<unsigned, 2> numbers{6, 255};
  const auto preamble = choice[1] % 2 == 0 ? Preamble::standard : Preamble::lengthened;
  Packet packet{{LineCode::named(names[choice[0]]), block_bytes[choice[2]], preamble}, {}, {}, numbers[choice[4] % 2]};
  packet.payload.resize(std::min(longest_payload(packet.format), payload_bytes[choice[3]]));
  for (std::size_t k = 0; k < packet.payload.size(); ++k) packet.payload[k] = static_cast<std::uint8_t>(37 * k);
  packet.cycle = packet_chips(packet.payload, packet.format, packet.number);
  return packet;
}

// Packets are kept: to encode one takes longer than the rest of a run.
const Packet& any_packet(FuzzedDataProvider& bytes) {
  static std::map<std::array<std::size_t, 5>, Packet> packets;
  std::array<std::size_t, 5> choice{};
  for (auto& value : choice) value = bytes.ConsumeIntegral<std::uint8_t>() % 4;
  if (!packets.contains(choice)) packets.emplace(choice, make_packet(choice));
  return packets.at(choice);
}

// Part of the endless repetition of the cycle; runs of chips are inverted, erased or replaced.
std::vector<double> stretch_of(const std::vector<std::uint8_t>& cycle, std::size_t begin, FuzzedDataProvider& bytes) {
  std::vector<double> llr(bytes.ConsumeIntegralInRange<std::size_t>(0, kMaxStretch));
  for (std::size_t k = 0; k < llr.size(); ++k) llr[k] = cycle[(begin + k) % cycle.size()] != 0 ? 8 : -8;
  for (unsigned runs = bytes.ConsumeIntegral<std::uint8_t>() % 16; runs > 0 && !llr.empty(); --runs) {
    const auto from = bytes.ConsumeIntegralInRange<std::size_t>(0, llr.size() - 1);
    const auto to = std::min(llr.size(), from + bytes.ConsumeIntegral<std::uint8_t>());
    const auto factor = bytes.PickValueInArray({-1.0, 0.0, 0.01, 1e300});
    const bool replaced = bytes.ConsumeBool();
    for (std::size_t k = from; k < to; ++k) llr[k] = replaced ? bytes.ConsumeIntegral<std::int8_t>() : factor * llr[k];
  }
  return llr;
}

void assemble(FuzzedDataProvider& bytes) {
  const auto& [format, payload, cycle, number] = any_packet(bytes);
  PacketAssembler assembler(format);
  std::size_t place = 0;
  for (int stretches = 0; stretches < kMaxStretches && bytes.remaining_bytes() > 0; ++stretches) {
    if (bytes.ConsumeIntegral<std::uint8_t>() == 1) assembler.lose_clock();
    place += bytes.ConsumeIntegral<std::uint16_t>();
    const auto slip = bytes.ConsumeBool() ? bytes.ConsumeIntegralInRange<std::ptrdiff_t>(-300, 300) : 0;
    const auto llr = stretch_of(cycle, place, bytes);
    const auto report = assembler.push(static_cast<std::ptrdiff_t>(place) + slip, llr);
    fuzz::claim(report.share >= 0);
    if (report.payload) fuzz::claim(report.payload->bytes == payload && report.payload->number == number);
    place += llr.size();
  }
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzedDataProvider bytes(data, size);
  fuzz::allow_refusal([&] { assemble(bytes); });
  return 0;
}
