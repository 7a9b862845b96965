// The assembler's decisions one by one: layout, headers, votes, places on the chip clock, reports.
#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <numeric>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "ocisac/packets/packets.hpp"

using ocisac::PacketAssembler;
using ocisac::PacketFormat;
using ocisac::StretchOutcome;

namespace {

using Bytes = std::vector<std::uint8_t>;
using Soft = std::vector<double>;

constexpr double kSure = 9;                                      // nats
constexpr std::size_t kPreamble = 14, kByte = 16, kBlock = 174;  // chips: of Manchester code and blocks of 8 bytes
constexpr std::size_t kHeader = 2 * kByte, kStart = kPreamble + kHeader;  // of a block before its bytes

PacketFormat format_of(const char* code = "manchester", std::size_t block_bytes = 8) {
  return {ocisac::LineCode::named(code), block_bytes, ocisac::Preamble::standard};
}

Bytes random_bytes(std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  Bytes bytes(count);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

// A packet that is sent repeatedly, in Manchester code with blocks of 8 bytes where no format is given.
struct Sender {
  PacketFormat format;
  Bytes payload;
  std::vector<std::uint8_t> chips;

  explicit Sender(std::size_t bytes = 20, unsigned number = 0, PacketFormat of = format_of())
      : format(of),
        payload(random_bytes(bytes, static_cast<unsigned>(100 * bytes + number))),
        chips(ocisac::packet_chips(payload, format, number)) {}

  [[nodiscard]] Soft soft(std::size_t first, std::size_t count, double llr = kSure) const {
    Soft result;
    for (std::size_t k = 0; k < count; ++k) result.push_back(chips[(first + k) % chips.size()] != 0 ? llr : -llr);
    return result;
  }
  [[nodiscard]] Soft blocks(std::size_t first, std::size_t count) const { return soft(first * kBlock, count * kBlock); }
};

std::ptrdiff_t place_of_block(std::size_t block) { return static_cast<std::ptrdiff_t>(block * kBlock); }

// An assembler that knows the layout and the clock, from the first blocks, of which it takes four.
PacketAssembler after_blocks(const Sender& sender, std::size_t count = 4, const ocisac::PlaceErrors& errors = {}) {
  PacketAssembler assembler(sender.format);
  for (std::size_t block = 0; block < count; ++block)
    assembler.push(place_of_block(block), sender.blocks(block, 1), errors);
  return assembler;
}

// Outcome of `count` chips from chip `first` on, after four blocks, `off` chips from their place.
ocisac::StretchReport report_of(const Sender& sender, std::size_t first, std::size_t count, std::ptrdiff_t off,
                                const ocisac::PlaceErrors& errors) {
  return after_blocks(sender).push(static_cast<std::ptrdiff_t>(first) + off, sender.soft(first, count), errors);
}

// Blocks are pushed one by one until the payload is there: how many it took; 0: not within `most`.
std::size_t blocks_needed(PacketAssembler& assembler, const Sender& sender, std::size_t begin, std::size_t most) {
  for (std::size_t k = begin; k < begin + most; ++k) {
    const auto report = assembler.push(place_of_block(k), sender.blocks(k, 1));
    if (report.payload) return report.payload->bytes == sender.payload ? k - begin + 1 : 0;
  }
  return 0;
}

// A new assembler gets frames from `push` until the sender's payload is there, without errors: how many it took.
template <class Push>
std::size_t frames_needed(const Sender& sender, std::size_t most, const Push& push) {
  PacketAssembler assembler(sender.format);
  std::optional<ocisac::Payload> payload;
  std::size_t frames = 0;
  while (frames < most && !payload) payload = push(assembler, frames++).payload;
  REQUIRE(payload);
  CHECK(payload->bytes == sender.payload);
  CHECK(payload->corrected == 0);
  return frames;
}

void flip(Soft& llr, std::size_t first, std::size_t count) {
  for (std::size_t k = first; k < first + count; ++k) llr[k] = -llr[k];
}

}  // namespace

TEST_CASE("layout: code words, their data and the blocks of a cycle") {
  struct Case {
    std::size_t payload, block_bytes, codewords, codeword_data, blocks;
  };
  for (const Case& of : {Case{1, 16, 1, 6, 16}, Case{80, 16, 1, 85, 16}, Case{81, 16, 2, 43, 32},
                         Case{165, 16, 2, 85, 32}, Case{166, 16, 3, 57, 48}, Case{1000, 16, 12, 84, 192},
                         Case{2715, 16, 16, 170, 255}, Case{165, 1, 1, 170, 255}, Case{4095, 255, 49, 84, 49}}) {
    CAPTURE(of.payload);
    const auto layout = ocisac::packet_layout(of.payload, format_of("manchester", of.block_bytes));
    CHECK(layout.payload_bytes == of.payload);
    CHECK(layout.codewords == of.codewords);
    CHECK(layout.codeword_data == of.codeword_data);
    CHECK(layout.blocks == of.blocks);
    CHECK(layout.coded_bytes() == 255 * of.codewords);
    CHECK(layout.block_chips == 14 + (2 + of.block_bytes) * 16);
    CHECK(layout.cycle_chips() == layout.blocks * layout.block_chips);
  }
  CHECK(ocisac::longest_payload(format_of("none", 1)) == 165);
  CHECK(ocisac::longest_payload(format_of("none", 16)) == 2715);
  CHECK(ocisac::longest_payload(format_of("none", 255)) == 4095);
}

TEST_CASE("blocks of every size send all four digits of the length, and the payload comes in one cycle") {
  for (std::size_t block_bytes = 1; block_bytes <= 255; ++block_bytes) {
    CAPTURE(block_bytes);
    const Sender sender(20, 3, format_of("none", block_bytes));
    const auto layout = ocisac::packet_layout(20, sender.format);
    REQUIRE(layout.blocks >= 4);
    REQUIRE(layout.blocks <= 256);
    REQUIRE(layout.blocks * block_bytes >= layout.coded_bytes());
    PacketAssembler assembler(sender.format);
    const auto report = assembler.push(0, sender.soft(0, sender.chips.size()));
    REQUIRE(report.payload);
    CHECK(report.payload->bytes == sender.payload);
  }
}

TEST_CASE("payloads, numbers and blocks beyond their bounds are refused") {
  const auto refused = [](std::size_t payload, unsigned number, std::size_t block_bytes) {
    CHECK_THROWS_AS((void)ocisac::packet_chips(Bytes(payload), format_of("none", block_bytes), number),
                    std::invalid_argument);
  };
  refused(0, 0, 16);
  refused(2716, 0, 16);
  refused(1, 256, 16);
  refused(1, 0, 0);
  refused(1, 0, 256);
  CHECK(ocisac::packet_chips(Bytes(2715), format_of("none", 16), 255).size() == 255 * (14 + 18 * 8));
}

TEST_CASE("each header names its block, the parity and a digit of the length") {
  const PacketFormat lengthened{ocisac::LineCode::named("8b10b"), 8, ocisac::Preamble::lengthened};
  for (const PacketFormat& format : {format_of(), lengthened}) {
    const Sender sender(01234, 5, format);  // octal digits 1, 2, 3, 4
    const std::size_t length = ocisac::block_chips(format), count = sender.chips.size() / length;
    const auto found = ocisac::find_blocks(sender.soft(0, sender.chips.size()), format);
    REQUIRE(found.size() == count);
    for (unsigned k = 0; k < count; ++k) {
      CHECK(found[k].chip == k * length);
      CHECK(found[k].block == k);
      CHECK(found[k].parity == 1);
      CHECK(found[k].digit == k % 4 + 1);
    }
    const auto later = ocisac::find_blocks(sender.soft(5, 3 * length), format);
    REQUIRE(later.size() == 2);
    CHECK(later[0].chip == length - 5);
    CHECK(later[0].block == 1);
  }
}

TEST_CASE("a block counts from the first to the last chip of preamble and header") {
  const Sender sender;
  const auto found = [&](const Soft& llr) { return ocisac::find_blocks(llr, sender.format).size(); };
  CHECK(found(sender.soft(0, kStart)) == 1);
  CHECK(found(sender.soft(0, kStart - 1)) == 0);
  CHECK(found(sender.soft(1, kStart)) == 0);
  CHECK(found(sender.soft(1, kBlock + kStart - 1)) == 1);
  CHECK(found({}) == 0);
}

TEST_CASE("a preamble that is not seen, or spoken against by three sure chips, is none") {
  const Sender sender;
  const auto found = [&](const Soft& llr) { return ocisac::find_blocks(llr, sender.format).size(); };
  auto llr = sender.soft(0, kStart);
  for (std::size_t chip = 0; chip < 3; ++chip) llr[chip] = 0;
  CHECK(found(llr) == 1);
  for (std::size_t chip = 3; chip < kPreamble; ++chip) llr[chip] = 0;
  CHECK(found(llr) == 0);  // bytes may have the words of a header
  for (std::size_t chip = 0; chip < kPreamble; ++chip) llr[chip] = sender.soft(chip, 1, 0.1)[0];
  CHECK(found(llr) == 0);

  llr = sender.soft(0, kStart);
  flip(llr, 5, 1);
  CHECK(found(llr) == 1);
  flip(llr, 6, 2);
  CHECK(found(llr) == 0);

  llr = sender.soft(0, kStart);
  for (std::size_t chip = 0; chip < kPreamble; ++chip) llr[chip] = llr[chip] > 0 ? 0.9 : -6;  // weak, but right
  CHECK(found(llr) == 1);
}

TEST_CASE("the checksum of a header settles a doubtful bit; five, or a sure bit that is wrong, make it none") {
  const Sender sender(01234, 5);
  const auto found = [&](const Soft& llr) { return ocisac::find_blocks(llr, sender.format); };
  const auto is_first = [&](const Soft& llr) {
    const auto blocks = found(llr);
    return blocks.size() == 1 && blocks[0].block == 0 && blocks[0].parity == 1 && blocks[0].digit == 1;
  };
  for (std::size_t bit = 0; bit < 16; ++bit) {
    CAPTURE(bit);
    const std::size_t chip = kPreamble + 2 * bit;
    auto llr = sender.soft(0, kStart);
    flip(llr, chip, 2);  // another bit
    CHECK(found(llr).empty());
    llr = sender.soft(0, kStart);
    flip(llr, chip, 1);  // two equal chips: no word
    CHECK(is_first(llr));
    llr[chip] = llr[chip + 1] = 0;
    CHECK(is_first(llr));
  }
  auto llr = sender.soft(0, kStart);
  for (std::size_t bit = 0; bit < 5; ++bit) llr[kPreamble + 2 * bit] = llr[kPreamble + 2 * bit + 1] = 0;
  CHECK(found(llr).empty());
}

namespace {

// ln of the likelihood of chips, as sure as 6 nats at most, over that of chips at random.
double chip_evidence(const Soft& llr, std::size_t first, const std::vector<int>& chips) {
  double sum = 0;
  for (std::size_t k = 0; k < chips.size(); ++k) {
    const double value = std::clamp(llr[first + k], -6.0, 6.0);
    sum += std::log(2 / (1 + std::exp(chips[k] != 0 ? -value : value)));
  }
  return sum;
}

double log_sum(double a, double b) { return std::max(a, b) + std::log1p(std::exp(-std::abs(a - b))); }

double manchester_evidence(const Soft& llr, std::size_t first) {
  double sum = 0;
  for (std::size_t chip = first; chip + 2 <= llr.size(); chip += 2)
    sum += log_sum(chip_evidence(llr, chip, {0, 1}), chip_evidence(llr, chip, {1, 0})) - std::log(2.0);
  return sum;
}

bool divides(unsigned header) {  // by x⁴ + x + 1
  for (unsigned bit = 15; bit >= 4; --bit)
    if ((header >> bit & 1U) != 0) header ^= 0x13U << (bit - 4);
  return header == 0;
}

struct BlockOdds {
  unsigned header = 0;     // the most probable one
  double probability = 0;  // of it among all headers
  double odds = 0;         // ln, of a block there
};

// By all headers in Manchester code.
BlockOdds odds_by_definition(const Soft& llr) {
  const std::vector<int> preamble{0, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 1};
  double all = -1e300, most = -1e300;
  BlockOdds result;
  for (unsigned header = 0; header < 0x10000; ++header) {
    if (!divides(header)) continue;
    double sum = 0;
    for (std::size_t bit = 0; bit < 16; ++bit) {
      const bool one = ((header ^ 0x5AA5U) >> (15 - bit) & 1U) != 0;
      const std::size_t chip = kPreamble + 2 * bit;
      sum += one ? chip_evidence(llr, chip, {1, 0}) : chip_evidence(llr, chip, {0, 1});
    }
    if (sum > most) {
      most = sum;
      result.header = header;
    }
    all = log_sum(all, sum);
  }
  const double elsewhere = std::max({0.0, manchester_evidence(llr, 0), manchester_evidence(llr, 1)});
  result.probability = std::exp(most - all);
  result.odds = chip_evidence(llr, 0, preamble) + all - std::log(4096.0) - std::log(double{kBlock}) - elsewhere;
  return result;
}

}  // namespace

TEST_CASE("blocks are found where their probability is 99 %, by all headers against bytes and random chips") {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::size_t sure = 0, unsure = 0;
  for (int trial = 0; trial < 150; ++trial) {
    CAPTURE(trial);
    const Sender sender(1 + random() % 500, random() % 4);
    const double mean = 0.5 + 0.04 * trial;  // nats
    auto llr = sender.soft(random() % 8 * kBlock, kStart, mean);
    for (double& value : llr) value = std::clamp(value + std::sqrt(2 * mean) * normal(random), -6.0, 6.0);
    const BlockOdds truth = odds_by_definition(llr);
    const auto found = ocisac::find_blocks(llr, sender.format);
    const auto probability = [&](double more) { return truth.probability / (1 + std::exp(-truth.odds - more)); };
    // The words' evidence is that of the best words: by a few nats too low where bits are in doubt. A bit is as sure as
    // a chip at most.
    if (probability(-4) > 0.995) {
      ++sure;
      REQUIRE(found.size() == 1);
      CHECK(found[0].block == truth.header >> 8U);
      CHECK((found[0].parity << 7U | found[0].digit << 4U) == (truth.header & 0xF0U));
    } else if (probability(1) < 0.98) {
      ++unsure;
      CHECK(found.empty());
    }
  }
  CHECK(sure > 30);
  CHECK(unsure > 30);
}

TEST_CASE("stretches that come again count alone, with the packet that headers told before") {
  const Sender sender(80);
  PacketAssembler assembler = after_blocks(sender);
  auto wrong = sender.blocks(4, 4);
  for (std::size_t block = 0; block < 4; ++block) flip(wrong, block * kBlock + kStart, kBlock - kStart);
  CHECK(assembler.push(place_of_block(4), wrong).bytes == 32);
  assembler.restart();
  const auto report = assembler.push(place_of_block(1), sender.blocks(3, 1));  // on another clock
  CHECK(report.outcome == StretchOutcome::placed);
  CHECK(report.share == doctest::Approx(8 / 85.0));
  for (std::size_t block = 4; block < 13; ++block)
    REQUIRE_FALSE(assembler.push(place_of_block(block - 2), sender.blocks(block, 1)).payload);
  const auto last = assembler.push(place_of_block(11), sender.blocks(13, 1)).payload;  // 88 bytes of 85
  REQUIRE(last);
  CHECK(last->bytes == sender.payload);
  CHECK(last->corrected == 0);
}

TEST_CASE("the length comes from its four digits, then a third of the bytes") {
  const Sender sender(80);  // 85 of 255 bytes are data: 11 blocks of 8
  for (const std::size_t begin : {0U, 3U, 30U}) {
    PacketAssembler assembler(sender.format);
    CHECK(blocks_needed(assembler, sender, begin, 40) == 11);
  }
}

TEST_CASE("the report counts bytes, parts and doubt, and the share of what is needed") {
  const Sender sender(80);
  PacketAssembler assembler(sender.format);
  for (std::size_t block = 0; block < 3; ++block) {
    const auto report = assembler.push(place_of_block(block), sender.blocks(block, 1));
    CHECK(report.outcome == StretchOutcome::waiting);
    CHECK(report.blocks == 1);
    CHECK(report.bytes == 0);
    CHECK(report.share == 0);
  }
  auto report = assembler.push(place_of_block(3), sender.blocks(3, 1));
  CHECK(report.outcome == StretchOutcome::placed);
  CHECK(report.bytes == 32);  // with those that waited
  CHECK(report.cut == 0);
  CHECK(report.doubtful == 0);
  CHECK(report.share == doctest::Approx(32 / 85.0));

  // Half of the first byte and the last chip of the last are not seen, the one before it hardly; a doubtful bit that is
  // no word.
  auto llr = sender.soft(4 * kBlock + kStart + 8, 4 * kByte - 9);
  llr.back() *= 0.01;
  llr[2 * kByte - 8] = llr[2 * kByte - 7] = 0.9;
  report = assembler.push(place_of_block(4) + static_cast<std::ptrdiff_t>(kStart + 8), llr);
  CHECK(report.outcome == StretchOutcome::placed);
  CHECK(report.blocks == 0);
  CHECK(report.cut == 2);
  CHECK(report.bytes + report.doubtful == 2);
  CHECK(report.doubtful == 1);
  CHECK(report.violations == 1);
  CHECK(report.share == doctest::Approx(33 / 85.0));
}

TEST_CASE("the payload comes with the byte that completes it, alone or beside a part of the next or a doubtful one") {
  for (const std::size_t seen : {kByte, kByte + kByte / 2, 2 * kByte}) {
    CAPTURE(seen);
    const Sender sender(20);  // 25 of 255 bytes are data
    PacketAssembler assembler = after_blocks(sender, 3);
    auto report = assembler.push(place_of_block(3), sender.soft(3 * kBlock, kStart));
    CHECK(report.share == doctest::Approx(24 / 25.0));
    CHECK(!report.payload);
    auto llr = sender.soft(3 * kBlock + kStart, seen);
    if (seen == 2 * kByte) llr[kByte] = llr[kByte + 1] = 0.9;  // no word
    report = assembler.push(place_of_block(3) + static_cast<std::ptrdiff_t>(kStart), llr);
    CHECK(report.bytes == 1);
    CHECK(report.cut == (seen == kByte + kByte / 2 ? 1 : 0));
    CHECK(report.doubtful == (seen == 2 * kByte ? 1 : 0));
    CHECK(report.share == 1);
    CHECK(report.payload.has_value());
  }
}

TEST_CASE("a word with more errors than the code corrects comes back without its least certain bytes") {
  const Sender sender(20);  // 230 of 255 bytes are redundancy
  PacketAssembler assembler(sender.format);
  // 19 of 32 blocks: 152 bytes are seen, 103 erased, 127 of redundancy are left, of which half are erased then. Four
  // bytes of each block are wrong: 76, more than 63.
  std::optional<ocisac::Payload> payload;
  for (std::size_t block = 0; block < 19; ++block) {
    auto llr = sender.blocks(block, 1);
    for (std::size_t byte = 0; byte < 4; ++byte)
      for (std::size_t chip = kStart + byte * kByte; chip < kStart + (byte + 1) * kByte; ++chip)
        llr[chip] *= (chip < kStart + byte * kByte + 2 ? -2 : 2) / kSure;  // 4 nats, and the first bit wrong
    const auto report = assembler.push(place_of_block(block), llr);
    if (report.payload) payload = report.payload;
  }
  REQUIRE(payload);
  CHECK(payload->bytes == sender.payload);
}

TEST_CASE("bytes that were read wrong are corrected and counted") {
  const Sender sender(20);  // 25 of 255 bytes are data
  PacketAssembler assembler(sender.format);
  for (std::size_t block = 0; block < 32; ++block) {
    auto llr = sender.blocks(block, 1);
    for (std::size_t byte = 0; byte < 2; ++byte) flip(llr, kStart + byte * kByte, 2);  // the first bit of each
    const auto report = assembler.push(place_of_block(block), llr);
    if (!report.payload) continue;
    CHECK(report.payload->bytes == sender.payload);
    CHECK(report.payload->corrected == 2 * (block + 1));
    return;
  }
  FAIL("no payload");
}

TEST_CASE("bits that come twice add up; the more certain reading decides") {
  const Sender sender(20);
  PacketAssembler assembler(sender.format);
  const std::size_t cycle = sender.chips.size() / kBlock;
  std::size_t payloads = 0;
  for (std::size_t block = 0; block < 2 * cycle && payloads == 0; ++block) {
    auto llr = sender.blocks(block, 1);
    for (std::size_t k = kStart; k < kBlock; ++k) llr[k] = block < cycle ? llr[k] / kSure * 0.9 : llr[k];
    payloads += assembler.push(place_of_block(block), llr).payload.has_value();
    if (block < cycle) REQUIRE(payloads == 0);
  }
  CHECK(payloads == 1);

  PacketAssembler again(sender.format);
  for (std::size_t block = 0; block < 2 * cycle; ++block) {
    auto llr = sender.blocks(block, 1);
    for (std::size_t k = kStart; k < kBlock; ++k) llr[k] *= (block < cycle ? -0.9 : 2.5) / kSure;  // −1.8 + 5 nats
    if (const auto report = again.push(place_of_block(block), llr); report.payload) {
      CHECK(report.payload->bytes == sender.payload);
      CHECK(report.payload->corrected == 0);
      return;
    }
  }
  FAIL("no payload");
}

TEST_CASE("after a payload the collection begins anew and the next cycle gives it again") {
  const Sender sender(80);
  PacketAssembler assembler(sender.format);
  REQUIRE(blocks_needed(assembler, sender, 0, 40) == 11);
  CHECK(blocks_needed(assembler, sender, 11, 40) == 11);
  CHECK(blocks_needed(assembler, sender, 22, 40) == 11);
}

TEST_CASE("a packet of another parity or length takes over at the second header that shows it") {
  const Sender first(80, 0), other(80, 1), longer(500, 2);
  PacketAssembler assembler = after_blocks(first, 8);
  CHECK(assembler.push(place_of_block(32), other.blocks(32, 1)).share > 0);  // of the first packet
  CHECK(assembler.push(place_of_block(33), other.blocks(33, 1)).share == 0);
  CHECK(blocks_needed(assembler, other, 34, 40) == 9);  // the first header waits for the second
  for (std::size_t block = 64; block < 70; ++block) assembler.push(place_of_block(block), other.blocks(block, 1));
  CHECK(blocks_needed(assembler, longer, 192, 200) > 0);
}

TEST_CASE("stretches of one instant tell no rate, and wait where they are") {
  const Sender sender(80);
  PacketAssembler assembler(sender.format);
  for (std::size_t block = 0; block < 2; ++block)
    assembler.push(place_of_block(block), sender.blocks(block, 1), {.time = 0.0});
  assembler.set_rate(kBlock);
  CHECK(blocks_needed(assembler, sender, 2, 40) == 9);
}

TEST_CASE("one header of another packet does no harm") {
  const Sender sender(80, 0), other(80, 1), longer(1300, 0);
  for (const Sender* stranger : {&other, &longer}) {
    PacketAssembler assembler = after_blocks(sender, 8);
    assembler.push(place_of_block(8), stranger->soft(8 * kBlock, kStart));
    CHECK(blocks_needed(assembler, sender, 9, 3) == 3);
  }
}

TEST_CASE("two packets of one parity and length are not mixed into a third") {
  const Sender first(80, 0);
  Sender second(80, 2);
  PacketAssembler assembler = after_blocks(first, 6);
  for (std::size_t block = 6; block < 150; ++block) {
    const auto report = assembler.push(place_of_block(block), second.blocks(block, 1));
    if (!report.payload) continue;
    CHECK(report.payload->bytes == second.payload);
    CHECK(report.payload->number == 2);
    return;
  }
  FAIL("no payload");
}

TEST_CASE("a stretch that begins before the end of the last one is left out") {
  const Sender sender(80);
  PacketAssembler assembler = after_blocks(sender);
  auto report = assembler.push(place_of_block(4) - 1, sender.soft(4 * kBlock - 1, 100));
  CHECK(report.outcome == StretchOutcome::repeated);
  CHECK(report.blocks == 0);
  CHECK(report.bytes + report.cut == 0);
  CHECK(report.share == doctest::Approx(32 / 85.0));
  // Within four standard errors it may well follow.
  report = assembler.push(place_of_block(4) - 3, sender.blocks(4, 1), {.offset = 0, .scatter = 0.6, .slip = 0.5});
  CHECK(report.outcome == StretchOutcome::placed);
  report = assembler.push(place_of_block(5) - 13, sender.blocks(5, 1), {.offset = 0, .scatter = 0.6, .slip = 0.5});
  CHECK(report.outcome == StretchOutcome::repeated);
}

TEST_CASE("chips that were not seen are unreadable, and no number is refused") {
  const Sender sender(80);
  PacketAssembler assembler(sender.format);
  CHECK(assembler.push(0, Soft(50)).outcome == StretchOutcome::unreadable);
  CHECK(assembler.push(50, Soft{}).outcome == StretchOutcome::unreadable);
  Soft llr(50);
  llr[49] = -3;
  CHECK(assembler.push(100, llr).outcome == StretchOutcome::waiting);
  llr[7] = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_AS((void)assembler.push(200, llr), std::invalid_argument);
  CHECK_THROWS_AS((void)assembler.push(200, Soft(9, 1.0), {.offset = 0, .scatter = -1, .slip = 0}),
                  std::invalid_argument);
  const std::array names{"placed", "waiting", "repeated", "unreadable"};
  for (int k = 0; k < 4; ++k)
    CHECK(ocisac::outcome_name(static_cast<StretchOutcome>(k)) == names[static_cast<std::size_t>(k)]);
}

TEST_CASE("a header across the border of two stretches counts where they follow each other") {
  const Sender sender(80);
  for (const std::size_t border : {1U, 7U, 14U, 45U}) {
    CAPTURE(border);
    PacketAssembler assembler(sender.format);
    auto report = assembler.push(0, sender.soft(0, 4 * kBlock + border));
    CHECK(report.blocks == 4);
    report = assembler.push(place_of_block(4) + static_cast<std::ptrdiff_t>(border),
                            sender.soft(4 * kBlock + border, kBlock - border));
    CHECK(report.blocks == 1);
    CHECK(report.share == doctest::Approx((40 - (border > kStart ? 1 : 0)) / 85.0));

    PacketAssembler apart(sender.format);
    apart.push(0, sender.soft(0, 4 * kBlock + border));
    report = apart.push(place_of_block(4) + static_cast<std::ptrdiff_t>(border) + 1,
                        sender.soft(4 * kBlock + border, kBlock - border));
    CHECK(report.blocks == 0);
  }
}

TEST_CASE("a header that ends with its stretch counts once") {
  const Sender sender(80);
  PacketAssembler assembler(sender.format);
  CHECK(assembler.push(0, sender.soft(0, kStart)).blocks == 1);
  CHECK(assembler.push(static_cast<std::ptrdiff_t>(kStart), sender.soft(kStart, kBlock - kStart)).blocks == 0);
}

TEST_CASE("stretches without a header have their place from the clock") {
  const Sender sender(80);
  PacketAssembler assembler = after_blocks(sender);
  std::size_t bytes = 32;
  for (std::size_t block = 4; block < 10; ++block) {
    const auto report = assembler.push(place_of_block(block) + static_cast<std::ptrdiff_t>(kStart),
                                       sender.soft(block * kBlock + kStart, 8 * kByte));
    CHECK(report.outcome == StretchOutcome::placed);
    CHECK(report.blocks == 0);
    bytes += report.bytes;
    CHECK(report.share == doctest::Approx(static_cast<double>(bytes) / 85));
  }
  CHECK(bytes == 80);
  CHECK(blocks_needed(assembler, sender, 10, 1) == 1);
}

TEST_CASE("the next header corrects a slip of two chips; of more, the second one that agrees") {
  const Sender sender(80);
  for (const std::ptrdiff_t slip : {-2, -1, 1, 2}) {
    CAPTURE(slip);
    PacketAssembler assembler(sender.format);
    for (std::size_t block = 0; block < 13; ++block) {  // seven bytes each: a slip makes no overlap
      const auto report =
          assembler.push(place_of_block(block) + (block < 6 ? 0 : slip), sender.soft(block * kBlock, kBlock - kByte));
      CHECK(report.outcome == (block < 3 ? StretchOutcome::waiting : StretchOutcome::placed));
      CHECK(report.payload.has_value() == (block == 12));
    }
  }
  for (const std::ptrdiff_t slip : {3, 50, 5000}) {
    CAPTURE(slip);
    PacketAssembler assembler = after_blocks(sender, 6);
    auto report = assembler.push(place_of_block(6) + slip, sender.blocks(6, 1));
    CHECK(report.outcome == StretchOutcome::waiting);
    CHECK(report.share == doctest::Approx(48 / 85.0));
    report = assembler.push(place_of_block(7) + slip, sender.blocks(7, 1));
    CHECK(report.outcome == StretchOutcome::placed);
    CHECK(report.share >= 56 / 85.0);
    for (std::size_t block = 8; block < 11; ++block)
      report = assembler.push(place_of_block(block) + slip, sender.blocks(block, 1));
    if (!report.payload) report = assembler.push(place_of_block(11) + slip, sender.blocks(11, 1));
    CHECK(report.payload.has_value());
  }
}

TEST_CASE("a lost clock keeps the symbols and waits for a header") {
  const Sender sender(80);
  PacketAssembler assembler = after_blocks(sender, 8);
  assembler.lose_clock();
  auto report = assembler.push(-70'000, sender.soft(8 * kBlock + kStart, 8 * kByte));
  CHECK(report.outcome == StretchOutcome::waiting);
  CHECK(report.share == doctest::Approx(64 / 85.0));
  report = assembler.push(-70'000 + 8 * 16, sender.blocks(9, 1));  // the bytes of block 8 wait for it
  CHECK(report.outcome == StretchOutcome::placed);
  CHECK(report.bytes == 16);
  assembler.lose_clock();
  report = assembler.push(5, sender.blocks(10, 1));
  CHECK(report.payload.has_value());

  PacketAssembler other(sender.format);  // what waited on the old clock has no place on the new one but by its headers
  other.push(place_of_block(0) - 1000, sender.soft(kStart, 8 * kByte));
  for (std::size_t block = 0; block < 3; ++block) other.push(place_of_block(block), sender.blocks(block, 1));
  other.lose_clock();
  report = other.push(0, sender.blocks(3, 1));
  CHECK(report.outcome == StretchOutcome::placed);
  CHECK(report.bytes == 32);
}

TEST_CASE("a header counts as far from its place as the clock may have jumped") {
  const Sender sender(80);
  for (const double slip : {3.0, 6.0, 12.0})
    for (const double errors : {3.0, 4.0, 5.0}) {  // of the jump's standard error
      CAPTURE(slip);
      CAPTURE(errors);
      const auto jump = static_cast<std::ptrdiff_t>(2 + errors * slip);  // two chips are no jump
      const auto report = report_of(sender, 4 * kBlock, kBlock, jump, {.offset = 0, .scatter = 0, .slip = slip});
      CHECK((report.outcome == StretchOutcome::placed) == (errors <= 4));
    }
}

TEST_CASE("the scatter of places is learned from headers") {
  const Sender sender(80);
  for (const std::ptrdiff_t jitter : {0, -2})
    for (const std::ptrdiff_t off : {5, 6}) {  // allowed: 2.5 chips and four standard errors of some 0.7
      CAPTURE(jitter);
      CAPTURE(off);
      PacketAssembler assembler(sender.format);
      const auto push = [&](std::size_t block, std::ptrdiff_t by) {
        return assembler.push(place_of_block(block) + by, sender.soft(block * kBlock, kBlock - 16)).outcome;
      };
      for (std::size_t block = 0; block < 8; ++block) push(block, block % 2 == 0 ? 0 : jitter);
      CHECK((push(8, off) == StretchOutcome::placed) == (jitter != 0 && off == 5));
    }
}

TEST_CASE("preamble, header and line code show the place of a stretch within four standard errors of the clock") {
  const Sender sender(80);
  const auto check = [&](std::size_t unseen, std::ptrdiff_t slip, double scatter) {
    CAPTURE(slip);
    const auto report =
        report_of(sender, 4 * kBlock + unseen, kBlock - unseen, slip, {.offset = 0, .scatter = scatter, .slip = 0});
    CHECK(report.blocks == 0);
    CHECK(report.outcome == StretchOutcome::placed);
    CHECK(report.bytes == 8);
    CHECK(report.cut == 0);
    CHECK(report.violations == 0);
    CHECK(report.share == doctest::Approx(40 / 85.0));
  };
  for (const std::ptrdiff_t slip : {-3, -1, 0, 1, 3}) check(4, slip, 1);
  for (const std::ptrdiff_t slip : {-11, 11}) check(12, slip, 3);
}

TEST_CASE("words from elsewhere that contradict the header expected there wait") {
  const Sender sender(80), other(80, 1);
  for (const std::size_t first : {0U, 1U}) {  // of the alignments of a word
    CAPTURE(first);
    PacketAssembler assembler = after_blocks(sender);
    const auto report = assembler.push(place_of_block(5) - 100 + static_cast<std::ptrdiff_t>(first),
                                       other.soft(7 * kBlock + kStart + first, kBlock - kStart - first),
                                       {.offset = 0, .scatter = 1, .slip = 0});
    CHECK(report.outcome == StretchOutcome::waiting);
    CHECK(report.share == doctest::Approx(32 / 85.0));
  }
}

TEST_CASE("a stretch that fits at several places waits, and eight of them at most") {
  const Sender sender(80);
  PacketAssembler assembler = after_blocks(sender);
  Soft alternating(40, kSure);  // words of the code, shifted by two chips as well
  for (std::size_t chip = 0; chip < alternating.size(); chip += 2) alternating[chip] = -kSure;
  for (std::size_t block = 4; block < 16; ++block) {
    const auto report = assembler.push(place_of_block(block) + static_cast<std::ptrdiff_t>(kStart), alternating,
                                       {.offset = 0, .scatter = 3, .slip = 0});
    CHECK(report.outcome == StretchOutcome::waiting);
    CHECK(report.share == doctest::Approx(32 / 85.0));
  }
  // A header of the sure clock comes through beside them.
  const auto report = assembler.push(place_of_block(16), sender.blocks(16, 1));
  CHECK(report.outcome == StretchOutcome::placed);
}

TEST_CASE("words without a header are placed while they belong there with 99 %") {
  // Two chips on, words of the code fit as well. With p(d) = e^(−d²/2σ²)/(σ√2π) + 10⁻⁴ (a slip) for a place d chips off
  // and 10⁻³ for one elsewhere, the probability p(0)/(p(0) + 2·p(2) + 10⁻³) is 0.9905 at σ = 0.6 and 0.9898 at 0.605.
  const Sender sender(80);
  for (const double scatter : {0.6, 0.605}) {
    CAPTURE(scatter);
    const auto report =
        report_of(sender, 4 * kBlock + kStart + 4, 6 * kByte, 0, {.offset = 0, .scatter = scatter, .slip = 0});
    CHECK((report.outcome == StretchOutcome::placed) == (scatter == 0.6));
  }
}

TEST_CASE("the first chip of a preamble is evidence of a place") {
  // As above at σ = 0.65: 0.9897 without the chip, 0.995 with it, which doubles the likelihood of the right place.
  const Sender sender(80);
  for (const std::size_t chips : {0U, 1U}) {  // of the next preamble
    CAPTURE(chips);
    const auto report = report_of(sender, 4 * kBlock + kStart + 4, kBlock - kStart - 4 + chips, 0,
                                  {.offset = 0, .scatter = 0.65, .slip = 0});
    CHECK((report.outcome == StretchOutcome::placed) == (chips == 1));
  }
}

TEST_CASE("a wrong bit of a header speaks against its place with twelve nats, a right one with ln 2 for it") {
  // The last bits of a header, one of them wrong, and the bytes after it: with n right bits the likelihood is
  // 2^(n + 1)·e^(−12) times that of words elsewhere, of probability 10⁻³; the place has the density 1/(σ√2π).
  struct Case {
    std::size_t right;
    double scatter, probability;
  };
  const Sender sender(80);
  for (const Case& of : {Case{10, 0.1, 0.980}, Case{11, 0.1, 0.9901}, Case{11, 0.103, 0.9898}, Case{12, 0.1, 0.995}}) {
    CAPTURE(of.right);
    CAPTURE(of.scatter);
    PacketAssembler assembler = after_blocks(sender);
    const std::size_t inside = kStart - 2 * (of.right + 1);
    auto llr = sender.soft(4 * kBlock + inside, kBlock - inside);
    flip(llr, 2 * of.right, 2);
    const auto report = assembler.push(place_of_block(4) + static_cast<std::ptrdiff_t>(inside), llr,
                                       {.offset = 0, .scatter = of.scatter, .slip = 0});
    CHECK((report.outcome == StretchOutcome::placed) == (of.probability > 0.99));
  }
}

TEST_CASE("the offset of a place counts as the clock does") {
  const Sender sender(80);
  const auto report = report_of(sender, 4 * kBlock + kStart, 8 * kByte, 6, {.offset = -6, .scatter = 0, .slip = 0});
  CHECK(report.outcome == StretchOutcome::placed);
  CHECK(report.bytes == 8);
  CHECK(report.violations == 0);
}

TEST_CASE("no more than 2^17 chips wait for the length") {
  const Sender sender(80);
  PacketAssembler assembler(sender.format);
  // Bytes without headers, then a cycle with them: only the last 2^17 chips, and of these eight stretches, can be
  // placed.
  std::ptrdiff_t first = 0;
  const std::size_t parts = 3 * 131'072 / kBlock;
  for (std::size_t k = 0; k < parts; ++k, first += static_cast<std::ptrdiff_t>(kBlock)) {
    auto llr = sender.blocks(k, 1);
    for (std::size_t chip = 0; chip < kStart; ++chip) llr[chip] = 0;
    CHECK(assembler.push(first, llr).outcome == StretchOutcome::waiting);
  }
  std::size_t placed = 0;
  for (std::size_t k = parts; k < parts + 4; ++k, first += static_cast<std::ptrdiff_t>(kBlock)) {
    const auto report = assembler.push(first, sender.blocks(k, 1));
    placed += report.bytes;
  }
  CHECK(placed > 0);
  CHECK(placed <= 8 * (131'072 / kBlock + 4));
}

TEST_CASE("the longest payload comes back") {
  const PacketFormat format = format_of("none", 1);
  const Sender sender(ocisac::longest_payload(format), 2, format);
  PacketAssembler assembler(format);
  const auto report = assembler.push(0, sender.soft(0, sender.chips.size()));
  REQUIRE(report.payload);
  CHECK(report.payload->bytes == sender.payload);
}

TEST_CASE("chips that look like a header by chance are outvoted by the headers of their stretch") {
  const PacketFormat format = format_of("none", 16);
  std::size_t cases = 0;
  for (std::size_t bytes = ocisac::longest_payload(format); cases < 3; --bytes) {  // about one in six
    CAPTURE(bytes);
    const Sender sender(bytes, 0, format);
    const std::size_t blocks = sender.chips.size() / ocisac::block_chips(format);
    const auto chips = sender.soft(0, sender.chips.size());
    if (ocisac::find_blocks(chips, format).size() == blocks) continue;
    ++cases;
    PacketAssembler assembler(format);
    const auto report = assembler.push(0, chips);
    CHECK(report.blocks == blocks);
    REQUIRE(report.payload);
    CHECK(report.payload->bytes == sender.payload);
  }
}

TEST_CASE("the errors of the first place belong to the clock") {
  // Four headers of standard error 3 leave 3/2 chips: 2.5 + 4·1.5 chips are allowed then.
  const Sender sender(80);
  for (const std::ptrdiff_t off : {8, 9}) {
    CAPTURE(off);
    PacketAssembler assembler = after_blocks(sender, 4, {.offset = 0, .scatter = 3, .slip = 0});
    const auto report = assembler.push(place_of_block(4) + off, sender.blocks(4, 1));
    CHECK((report.outcome == StretchOutcome::placed) == (off == 8));
  }
}

TEST_CASE("payloads of all lengths and numbers come back, whatever the format") {
  std::mt19937 random(21);
  for (int trial = 0; trial < 60; ++trial) {
    const std::array names{"none", "manchester", "4b6b", "8b10b"};
    const PacketFormat format{ocisac::LineCode::named(names[random() % 4]), 1 + random() % 255,
                              random() % 2 != 0 ? ocisac::Preamble::standard : ocisac::Preamble::lengthened};
    const std::size_t bytes = 1 + random() % std::min<std::size_t>(ocisac::longest_payload(format), 700);
    const unsigned number = random() % 256;
    const Sender sender(bytes, number, format);
    PacketAssembler assembler(format);
    const std::size_t begin = random() % sender.chips.size();
    CAPTURE(bytes);
    CAPTURE(format.block_bytes);
    std::optional<ocisac::Payload> payload;
    for (std::size_t at = begin; at < begin + 2 * sender.chips.size() && !payload; at += 600)
      payload = assembler.push(static_cast<std::ptrdiff_t>(at) - 1'000'000, sender.soft(at, 600)).payload;
    REQUIRE(payload);
    CHECK(payload->bytes == sender.payload);
    CHECK(payload->number == number);
    CHECK(payload->corrected == 0);
  }
}

TEST_CASE("frames of a wrong frame time, or of times that vary, are joined by their headers") {
  const Sender sender(80);
  const auto told = [](std::size_t frame) { return static_cast<std::ptrdiff_t>(200 * frame); };  // of 150 chips
  for (const double longer : {-0.25, -0.05, 0.001, 0.02, 0.25}) {
    CAPTURE(longer);
    const auto frames = frames_needed(sender, 24, [&](PacketAssembler& assembler, std::size_t frame) {
      const auto time = static_cast<double>(frame);
      const auto place = static_cast<std::size_t>(std::lround(200 * (1 + longer) * time));
      const auto report = assembler.push(told(frame), sender.soft(1000 + place, 150), {.time = time});
      CHECK(report.violations == 0);
      return report;
    });
    CHECK(frames <= 15);  // 13 with the right time
  }
  std::mt19937 random(5);
  for (const double walk : {3.0, 20.0, 40.0}) {
    CAPTURE(walk);
    double place = 1000;
    const auto frames = frames_needed(sender, 32, [&](PacketAssembler& assembler, std::size_t frame) {
      const auto seen = sender.soft(static_cast<std::size_t>(place), 150);
      place += 200 + std::uniform_real_distribution(0.0, walk)(random);
      return assembler.push(told(frame), seen);
    });
    CHECK(frames <= 28);
  }
}

TEST_CASE("pauses between blocks are learned, whatever they show") {
  const Sender sender(80);
  for (const std::size_t pause : {1U, 2U, 10U, 100U})
    for (const int shown : {0, 1, 2}) {  // dark, bright, toggling
      CAPTURE(pause);
      CAPTURE(shown);
      Soft cycle;
      for (std::size_t block = 0; block < sender.chips.size() / kBlock; ++block) {
        const auto chips = sender.blocks(block, 1);
        cycle.insert(cycle.end(), chips.begin(), chips.end());
        for (std::size_t k = 0; k < pause; ++k)
          cycle.push_back((shown == 2 ? k % 2 != 0 : shown == 1) ? kSure : -kSure);
      }
      const auto frames = frames_needed(sender, 30, [&](PacketAssembler& assembler, std::size_t frame) {
        Soft seen;
        for (std::size_t k = 0; k < 190; ++k) seen.push_back(cycle[(777 + 267 * frame + k) % cycle.size()]);
        return assembler.push(static_cast<std::ptrdiff_t>(267 * frame), seen);
      });
      CHECK(frames <= (pause == 100 ? 24 : 16));
    }
}

TEST_CASE("light that is dark for 1 is read as well, and said to be") {
  for (const char* code : {"none", "manchester", "4b6b", "8b10b"}) {
    CAPTURE(code);
    const Sender sender(80, 0, format_of(code));
    for (const bool inverted : {false, true})
      frames_needed(sender, 30, [&](PacketAssembler& assembler, std::size_t frame) {
        auto seen = sender.soft(267 * frame, 190);
        if (inverted) flip(seen, 0, seen.size());
        const auto report = assembler.push(static_cast<std::ptrdiff_t>(267 * frame), seen);
        CHECK((report.inverted == inverted || report.blocks == 0));
        return report;
      });
  }
}

TEST_CASE("chips that a clock placed, which a header contradicts, are taken back") {
  const Sender sender(80);
  PacketAssembler assembler = after_blocks(sender);
  // The sender has jumped by a block: words that are placed as those of block 4, and two headers that contradict.
  const auto words = sender.soft(5 * kBlock + kStart, 8 * kByte);
  auto report = assembler.push(place_of_block(4) + static_cast<std::ptrdiff_t>(kStart), words);
  CHECK(report.outcome == StretchOutcome::placed);
  CHECK(report.share == doctest::Approx(40 / 85.0));
  assembler.push(place_of_block(5), sender.blocks(6, 1));
  report = assembler.push(place_of_block(6), sender.blocks(7, 1));
  CHECK(report.share <= 48 / 85.0);
  for (std::size_t block = 8; block < 15 && !report.payload; ++block)
    report = assembler.push(place_of_block(block - 1), sender.blocks(block, 1));
  REQUIRE(report.payload);
  CHECK(report.payload->bytes == sender.payload);
  CHECK(report.payload->corrected == 0);
}

TEST_CASE("certain chips without a payload say what they lack") {
  using ocisac::Lack;
  std::mt19937 random(3);
  const auto lack_after = [&](const Sender& sender, auto&& chips) {
    PacketAssembler assembler(sender.format);
    Lack lack = Lack::none;
    for (std::size_t frame = 0; frame < 24; ++frame)
      lack = assembler.push(static_cast<std::ptrdiff_t>(267 * frame), chips(frame)).lack;
    return lack;
  };
  const Sender sender(80), other(80, 0, format_of("manchester", 4));
  const auto right = [&](std::size_t frame) { return sender.soft(267 * frame, 190); };
  CHECK(lack_after(sender, right) == Lack::none);
  const auto words = [&](std::size_t) {
    Soft chips;
    for (std::size_t k = 0; k < 190; ++k) chips.push_back(random() % 2 != 0 ? kSure : -kSure);
    return chips;
  };
  CHECK(lack_after(sender, words) == Lack::header);
  const auto doubtful = [&](std::size_t) { return Soft(190, 0.5); };
  CHECK(lack_after(sender, doubtful) == Lack::none);
  const auto one_block = [&](std::size_t) { return sender.soft(0, 150); };  // one digit of the length
  CHECK(lack_after(sender, one_block) == Lack::place);
}
