#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "ocisac/receiver/packets.hpp"

namespace {

using Random = std::mt19937_64;
using Bytes = std::vector<std::uint8_t>;

// What was sent and what may be done to it: a sender's packet in a random format, and the receiver of it.
struct Link {
  ocisac::PacketFormat format;
  Bytes payload;
  unsigned number;
  std::vector<double> cycle;  // soft chips
  ocisac::PacketAssembler assembler;
  std::ptrdiff_t place;

  explicit Link(Random& random)
      : format{ocisac::LineCode::named(std::array{"none", "manchester", "4b6b", "8b10b"}[random() % 4]),
               8 + random() % 56, ocisac::Preamble::standard},
        payload(1 + random() % 80),
        number(static_cast<unsigned>(random() % 256)),
        assembler(format),
        place(static_cast<std::ptrdiff_t>(random() % 100'000)) {
    for (auto& byte : payload) byte = static_cast<std::uint8_t>(random());
    for (const auto chip : ocisac::packet_chips(payload, format, number)) cycle.push_back(chip ? 9.0 : -9.0);
  }

  [[nodiscard]] bool is_sent(const ocisac::Payload& got) const { return got.bytes == payload && got.number == number; }
};

// A part of the cycle with bursts turned, weakened, lost or made up, about as much as the code can just not correct;
// or chips that nobody sent; at its place, or at a wrong one.
std::vector<double> damaged(Link& link, Random& random, std::ptrdiff_t& first) {
  const std::size_t length = link.cycle.size();
  const std::size_t count = length / 3 + random() % (2 * length / 3), begin = random() % length;
  std::vector<double> llr(count);
  first = link.place + static_cast<std::ptrdiff_t>(begin);
  for (std::size_t k = 0; k < count; ++k) llr[k] = link.cycle[(begin + k) % length];
  link.place += static_cast<std::ptrdiff_t>(2 * length);
  if (random() % 8 == 0)
    for (double& chip : llr) chip = random() % 2 ? 9 : -9;
  if (random() % 8 == 0) first += static_cast<std::ptrdiff_t>(random() % length);
  const std::size_t bursts = random() % 40;
  for (std::size_t burst = 0; burst < bursts; ++burst) {
    const auto kind = random() % 4;
    const std::size_t from = random() % count, to = std::min(count, from + 1 + random() % 60);
    for (std::size_t k = from; k < to; ++k)
      llr[k] = kind == 0 ? -llr[k] : kind == 1 ? 0.1 * llr[k] : kind == 2 ? 0.0 : (random() % 2 ? 5.0 : -5.0);
  }
  return llr;
}

struct Tally {
  std::size_t wrong = 0, right = 0;
};

Tally try_links(std::size_t tries, std::uint64_t seed) {
  Random random(seed);
  Tally tally;
  for (std::size_t done = 0; done < tries;) {
    Link link(random);
    for (int stretch = 0; stretch < 20 && done < tries; ++stretch, ++done) {
      std::ptrdiff_t first = 0;
      const auto llr = damaged(link, random, first);
      const auto report = link.assembler.push(first, llr);
      if (report.payload) ++(link.is_sent(*report.payload) ? tally.right : tally.wrong);
    }
  }
  return tally;
}

}  // namespace

TEST_CASE("damaged packets and random chips: the payload that was sent, or none") {
  const Tally tally = try_links(2000, 1);
  CHECK(tally.wrong == 0);
  CHECK(tally.right > 300);
}

TEST_CASE("a million damaged packets: never a wrong payload" * doctest::skip()) {
  const Tally tally = try_links(1'000'000, 2);
  MESSAGE("payloads that came whole: " << tally.right);
  CHECK(tally.wrong == 0);
  CHECK(tally.right > 150'000);
}
