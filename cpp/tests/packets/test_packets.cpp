#include <doctest/doctest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "ocisac/packets/line_codes.hpp"
#include "ocisac/packets/packets.hpp"

namespace {

std::vector<double> soft(const std::vector<std::uint8_t>& chips, std::size_t first, std::size_t count) {
  std::vector<double> llr;
  for (std::size_t k = 0; k < count; ++k) llr.push_back(chips[(first + k) % chips.size()] ? 12.0 : -12.0);
  return llr;
}

}  // namespace

TEST_CASE("blocks are found where they begin") {
  const std::vector<std::uint8_t> payload{1, 2, 3};
  const ocisac::PacketFormat format{ocisac::LineCode::named("8b10b"), 8, ocisac::Preamble::lengthened};
  const auto chips = ocisac::packet_chips(payload, format, 1);
  const auto found = ocisac::find_blocks(soft(chips, 5, 3 * ocisac::block_chips(format)), format);
  REQUIRE(found.size() == 2);
  CHECK(found[0].chip == ocisac::block_chips(format) - 5);
  CHECK(found[0].block == 1);
  CHECK(found[1].block == 2);
  CHECK(found[1].parity == 1);
}

TEST_CASE("CRC-32 is that of IEEE 802.3") {
  const std::string text = "123456789";
  CHECK(ocisac::crc32(std::vector<std::uint8_t>(text.begin(), text.end())) == 0xCBF43926U);
}
