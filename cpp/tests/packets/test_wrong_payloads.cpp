#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "ocisac/packets/packets.hpp"

namespace {

using Random = std::mt19937_64;
using Bytes = std::vector<std::uint8_t>;

// A transmission and its damage: a packet in a random format, another of the same length with the same headers, and the
// receiver of both.
struct Link {
  ocisac::PacketFormat format;
  std::array<Bytes, 2> payloads;
  std::array<unsigned, 2> numbers;
  std::array<std::vector<double>, 2> cycles;  // soft chips
  ocisac::PacketAssembler assembler;
  std::ptrdiff_t place;

  explicit Link(Random& random)
      : format{ocisac::LineCode::named(std::array{"none", "manchester", "4b6b", "8b10b"}[random() % 4]),
               8 + random() % 56, ocisac::Preamble::standard},
        numbers{static_cast<unsigned>(random() % 256), 0},
        assembler(format),
        place(static_cast<std::ptrdiff_t>(random() % 100'000)) {
    numbers[1] = (numbers[0] + 2) % 256;
    payloads[0].resize(1 + random() % 80);
    for (auto& byte : payloads[0]) byte = static_cast<std::uint8_t>(random());
    payloads[1] = payloads[0];
    for (std::size_t changed = 0; changed <= random() % 8; ++changed)
      payloads[1][random() % payloads[1].size()] ^= static_cast<std::uint8_t>(1U << random() % 8);
    for (std::size_t k = 0; k < 2; ++k)
      for (const auto chip : ocisac::packet_chips(payloads[k], format, numbers[k]))
        cycles[k].push_back(chip ? 9.0 : -9.0);
  }

  [[nodiscard]] bool is_sent(const ocisac::Payload& got) const {
    return (got.bytes == payloads[0] && got.number == numbers[0]) ||
           (got.bytes == payloads[1] && got.number == numbers[1]);
  }
};

// Bursts inverted, weakened, erased or invented.
void damage_bursts(std::vector<double>& llr, Random& random) {
  const std::size_t bursts = random() % 40;
  for (std::size_t burst = 0; burst < bursts; ++burst) {
    const auto kind = random() % 4;
    const std::size_t from = random() % llr.size(), to = std::min(llr.size(), from + 1 + random() % 60);
    for (std::size_t k = from; k < to; ++k)
      llr[k] = kind == 0 ? -llr[k] : kind == 1 ? 0.1 * llr[k] : kind == 2 ? 0.0 : (random() % 2 ? 5.0 : -5.0);
  }
}

// One chip in so many inverted or erased: wrong and erased bytes near the limit of the code's correction.
void damage_chips(std::vector<double>& llr, Random& random) {
  const std::uint64_t one_in = 4 + random() % 60;
  const bool lost = random() % 2 != 0;
  for (double& chip : llr)
    if (random() % one_in == 0) chip = lost ? 0.0 : -chip;
}

// A damaged part of the cycle, or random chips; optionally continued by the other packet; at the right or a wrong
// place.
std::vector<double> damaged(Link& link, Random& random, std::ptrdiff_t& first) {
  const std::size_t length = link.cycles[0].size();
  const std::size_t count = length / 3 + random() % (2 * length / 3), begin = random() % length;
  const std::size_t splice = random() % 3 == 0 ? random() % count : count;
  std::vector<double> llr(count);
  first = link.place + static_cast<std::ptrdiff_t>(begin);
  for (std::size_t k = 0; k < count; ++k) llr[k] = link.cycles[k < splice ? 0 : 1][(begin + k) % length];
  link.place += static_cast<std::ptrdiff_t>(2 * length);
  if (random() % 8 == 0)
    for (double& chip : llr) chip = random() % 2 ? 9 : -9;
  if (random() % 8 == 0) first += static_cast<std::ptrdiff_t>(random() % length);
  if (random() % 3 == 0)
    damage_chips(llr, random);
  else
    damage_bursts(llr, random);
  return llr;
}

struct Tally {
  std::size_t wrong = 0, right = 0;
};

constexpr std::size_t kTriesPerMessage = 100'000;  // tries between two progress messages

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
      if ((done + 1) % kTriesPerMessage == 0) MESSAGE((done + 1) << " tries, " << tally.wrong << " wrong");
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
