#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "ocisac/packets/line_codes.hpp"
#include "ocisac/packets/packets.hpp"

namespace {

std::vector<std::uint8_t> bits_of(const std::vector<unsigned>& bytes) {
  std::vector<std::uint8_t> bits;
  for (const unsigned byte : bytes)
    for (int bit = 7; bit >= 0; --bit) bits.push_back(static_cast<std::uint8_t>(byte >> bit & 1U));
  return bits;
}

std::string encoded(const char* code, const std::vector<unsigned>& bytes) {
  std::string chips;
  for (const auto chip : ocisac::LineCode::named(code).encode(bits_of(bytes))) chips += chip != 0 ? '1' : '0';
  return chips;
}

int disparity(const std::string& chips) {
  return static_cast<int>(2 * std::ranges::count(chips, '1')) - static_cast<int>(chips.size());
}

std::size_t longest_run(const std::string& chips) {
  std::size_t longest = 0, run = 0;
  for (std::size_t k = 0; k < chips.size(); ++k)
    longest = std::max(longest, run = k > 0 && chips[k] == chips[k - 1] ? run + 1 : 1);
  return longest;
}

}  // namespace

// D.x.y is the byte y·32 + x.
TEST_CASE("8b10b: words of the published tables") {
  const std::map<unsigned, std::string> at_minus{{0x00, "1001110100"}, {0xB5, "1010101010"}, {0x4A, "0101010101"},
                                                 {0xEB, "1101001110"}, {0xF1, "1000110111"}, {0xEE, "0111001110"},
                                                 {0xFF, "1010110001"}, {0xF4, "0010110111"}, {0xF2, "0100110111"},
                                                 {0xE3, "1100011110"}, {0x63, "1100011100"}, {0x67, "1110001100"}};
  for (const auto& entry : at_minus) {
    CAPTURE(entry.first);
    CHECK(encoded("8b10b", {entry.first}) == entry.second);
  }
  // D3.0 leaves the running disparity at +1.
  const std::map<unsigned, std::string> at_plus{
      {0xEB, "1101001000"}, {0xED, "1011001000"}, {0xEE, "0111001000"}, {0xE3, "1100010001"}, {0x67, "0001110011"}};
  const std::string before = encoded("8b10b", {0x03});
  REQUIRE(disparity(before) == 2);
  for (const auto& entry : at_plus) {
    CAPTURE(entry.first);
    CHECK(encoded("8b10b", {0x03, entry.first}).substr(10) == entry.second);
  }
}

TEST_CASE("8b10b: runs of five chips at most, running disparity within one, words of their own") {
  std::set<std::string> first;
  for (unsigned a = 0; a < 256; ++a) {
    first.insert(encoded("8b10b", {a}));
    for (unsigned b = 0; b < 256; ++b) {
      const std::string chips = encoded("8b10b", {a, b, a});
      REQUIRE(longest_run(chips) <= 5);
      for (std::size_t word = 10; word <= 30; word += 10) {
        const int sum = disparity(chips.substr(0, word));
        REQUIRE((sum == 0 || sum == 2));
      }
    }
  }
  CHECK(first.size() == 256);
}

TEST_CASE("no more chips than the longest run are equal") {
  CHECK(ocisac::LineCode::named("manchester").longest_run() == 2);
  CHECK(ocisac::LineCode::named("4b6b").longest_run() == 4);
  CHECK(ocisac::LineCode::named("8b10b").longest_run() >= 5);
  CHECK(ocisac::LineCode::named("8b10b").longest_run() <= 6);
  const std::array<std::string, 2> pulses = {"1000", "0010"};
  CHECK(ocisac::LineCode::of_table(pulses).longest_run() == 5);
  CHECK(ocisac::LineCode::named("none").longest_run() == std::numeric_limits<std::size_t>::max());
}

TEST_CASE("words that a code does not have are violations, however weak the light") {
  const auto code = ocisac::LineCode::named("manchester");
  for (const double llr : {1e-3, 0.5, 1.0, 40.0}) {
    CAPTURE(llr);
    const auto decoded = code.decode(std::vector<double>{-llr, llr, llr, -llr, llr, llr, -llr, -llr, 0, llr});
    CHECK(decoded.violations == std::vector<std::uint8_t>{0, 0, 1, 1, 0});
    CHECK(decoded.llr[0] == doctest::Approx(-2 * llr));
    CHECK(decoded.llr[1] == doctest::Approx(2 * llr));
  }
}

// A code uses 2^b of the 2^n patterns of n chips: a word has the likelihood ratio 2^(n − b) against random chips.
TEST_CASE("the evidence of words is their share of all patterns") {
  const std::map<const char*, double> bits{{"none", 0}, {"manchester", 1}, {"4b6b", 2}, {"8b10b", 2}};
  for (const auto& entry : bits) {
    CAPTURE(entry.first);
    const auto& [name, redundant] = entry;
    const auto code = ocisac::LineCode::named(name);
    std::vector<double> llr;
    for (const auto chip : code.encode(bits_of({0x2A}))) llr.push_back(chip != 0 ? 40 : -40);
    const auto words = static_cast<double>(llr.size() / code.chips_per_word());
    CHECK(code.evidence(llr) == doctest::Approx(words * redundant * std::numbers::ln2).epsilon(1e-12));
    for (double& chip : llr) chip = 0;
    CHECK(code.evidence(llr) == 0);
  }
}

TEST_CASE("tables of 2, 4, 16 and 256 different words of one length are codes, others are refused") {
  for (const std::size_t count : {1, 2, 3, 4, 8, 16, 32, 255, 256}) {
    CAPTURE(count);
    std::vector<std::string> words;
    for (std::size_t value = 0; value < count; ++value) {
      words.emplace_back();
      for (int chip = 9; chip >= 0; --chip) words.back() += (value >> chip & 1U) != 0 ? '1' : '0';
    }
    if (count != 2 && count != 4 && count != 16 && count != 256) {
      CHECK_THROWS_AS(ocisac::LineCode::of_table(words), std::invalid_argument);
      continue;
    }
    const auto code = ocisac::LineCode::of_table(words);
    CHECK(code.chips_per_word() == 10);
    CHECK((std::size_t{1} << code.bits_per_word()) == count);
    words[1] = words[0];
    CHECK_THROWS_AS(ocisac::LineCode::of_table(words), std::invalid_argument);
    words[1] = "01";
    CHECK_THROWS_AS(ocisac::LineCode::of_table(words), std::invalid_argument);
  }
}

TEST_CASE("words of up to 16 chips are codes") {
  for (const std::size_t chips : {16U, 17U}) {
    CAPTURE(chips);
    const std::vector<std::string> words{std::string(chips, '0'), std::string(chips, '1')};
    if (chips == 16)
      CHECK(ocisac::LineCode::of_table(words).chips_per_word() == chips);
    else
      CHECK_THROWS_AS(ocisac::LineCode::of_table(words), std::invalid_argument);
  }
}

// A receiver of today reads the packets of earlier senders: whitening, interleaver, headers and preambles stay.
TEST_CASE("the chips of a packet are those of the first release") {
  const std::map<std::string, std::uint32_t> checksums{
      {"none", 0x7E1483C3U}, {"manchester", 0x8733D08FU}, {"4b6b", 0x0F66620CU}, {"8b10b", 0xA5508360U}};
  std::vector<std::uint8_t> payload(300);
  for (std::size_t k = 0; k < payload.size(); ++k) payload[k] = static_cast<std::uint8_t>(k * k);
  for (const auto& entry : checksums) {
    CAPTURE(entry.first);
    const auto& [code, checksum] = entry;
    CHECK(ocisac::crc32(ocisac::packet_chips(payload, {ocisac::LineCode::named(code)}, 7)) == checksum);
  }
  std::string preamble;
  for (const auto chip : ocisac::preamble_chips(ocisac::Preamble::lengthened)) preamble += chip != 0 ? '1' : '0';
  CHECK(preamble == "011111100000011000000111111001111110000001");
}

TEST_CASE("bits other than 0 and 1, and parts of words, are refused") {
  const auto code = ocisac::LineCode::named("4b6b");
  CHECK_NOTHROW((void)code.encode(std::vector<std::uint8_t>{0, 1, 1, 0}));
  CHECK_THROWS_AS((void)code.encode(std::vector<std::uint8_t>{0, 1, 2, 0}), std::invalid_argument);
  CHECK_THROWS_AS((void)code.encode(std::vector<std::uint8_t>{0, 1, 1}), std::invalid_argument);
  CHECK_NOTHROW((void)code.decode(std::vector<double>(6, 1.0)));
  CHECK_THROWS_AS((void)code.decode(std::vector<double>(7, 1.0)), std::invalid_argument);
}

TEST_CASE("CRC-32 is that of IEEE 802.3") {
  const std::string text = "123456789";
  CHECK(ocisac::crc32(std::vector<std::uint8_t>(text.begin(), text.end())) == 0xCBF43926U);
}
