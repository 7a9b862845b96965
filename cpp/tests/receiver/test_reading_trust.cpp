// Log-likelihood ratios against the line code.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "receiver/reading_trust.hpp"

namespace {

// Ratios of ±12 nats of a packet's chips, a share of them wrong.
std::vector<double> ratios(const ocisac::PacketFormat& format, double wrong, std::mt19937& random) {
  const std::vector<std::uint8_t> payload(40, 7);
  std::bernoulli_distribution flips(wrong);
  std::vector<double> llr;
  for (const auto chip : ocisac::packet_chips(payload, format))
    llr.push_back((chip != 0) != flips(random) ? 12.0 : -12.0);
  llr.resize(200);
  return llr;
}

double expected_wrong(const std::vector<double>& llr) {
  double sum = 0;
  for (const double value : llr) sum += 1 / (1 + std::exp(std::abs(value)));
  return sum / static_cast<double>(llr.size());
}

// A frame of 1080 rows: random bits in Manchester code, 5.63 rows a chip, an exposure of two chips, white noise of 1 %
// of the swing and a ripple of `ripple` times as much over the last 200 rows.
ocisac::FrameReading reading_with(double ripple, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1);
  std::vector<double> chips, signal(1080);
  for (int bit = 0; bit < 220; ++bit) {
    chips.push_back(static_cast<double>(random() & 1U));
    chips.push_back(1 - chips.back());
  }
  ocisac::ChannelEstimate channel;
  channel.clock = {5.63, -100.3, 11.26};
  channel.dark = {20};
  channel.swing = {100};
  channel.noise = 1;
  channel.rows = {0, 1080};
  ocisac::expose_chips({chips, 0}, channel.clock, signal);
  for (std::size_t n = 0; n < signal.size(); ++n)
    signal[n] =
        20 + 100 * signal[n] + noise(random) + (n < 880 ? 0.0 : ripple * std::sin(0.15 * static_cast<double>(n - 880)));
  const auto reading = ocisac::read_frame(signal, channel, true);
  REQUIRE(reading);
  return *reading;
}

}  // namespace

TEST_CASE("chips are sure where what is left could not change one") {
  for (unsigned seed = 0; seed < 10; ++seed) {
    CHECK(reading_with(0, seed).trust == ocisac::Trust::fits);
    CHECK(reading_with(30, seed).trust <= ocisac::Trust::misfit);
  }
}

TEST_CASE("white noise about a chip is no excess, a ripple is one where it is") {
  int frames = 0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    const auto clean = reading_with(0, seed);
    frames += std::ranges::any_of(clean.excess, [](double excess) { return excess > 1; });
    CHECK(clean.excess.size() == clean.llr.size());
    const auto rippled = reading_with(4, seed);
    CHECK(std::ranges::all_of(rippled.excess, [](double excess) { return excess >= 1; }));
    CHECK(rippled.excess[rippled.excess.size() - 15] > 4);  // 8 σ² over the mean of the frame, 2.5 σ²
    CHECK(std::ranges::count(rippled.excess, 1.0) > 120);
  }
  CHECK(frames <= 2);  // beyond five standard errors
}

TEST_CASE("ratios of chips in white noise stay, others are those of noise of unknown size") {
  auto reading = reading_with(0, 3);
  reading.excess.assign(reading.llr.size(), 1.0);
  CHECK(ocisac::reliable_llr(reading) == reading.llr);
  reading.excess[40] = 5;
  const auto local = ocisac::reliable_llr(reading);
  for (std::size_t k = 0; k < local.size(); ++k)
    CHECK(std::abs(local[k]) ==
          doctest::Approx(k == 40 ? 2 * std::log(1 + std::abs(reading.llr[k]) / 30) : std::abs(reading.llr[k])));
  reading.correlation = 0.8;
  const auto all = ocisac::reliable_llr(reading);
  for (std::size_t k = 0; k < all.size(); ++k) {
    CHECK(all[k] * reading.llr[k] >= 0);
    CHECK(std::abs(all[k]) <= std::abs(reading.llr[k]) / 5);
  }
}

TEST_CASE("right chips keep their ratios, preambles included") {
  std::mt19937 random(4);
  for (const std::string name : {"none", "manchester", "4b6b", "8b10b"})
    for (const std::size_t block : {4U, 16U}) {
      const ocisac::PacketFormat format{ocisac::LineCode::named(name), block, ocisac::Preamble::standard};
      const auto llr = ratios(format, 0, random);
      for (const std::ptrdiff_t skipped : {0, 1, 5}) {
        std::vector<double> part(llr.begin() + skipped, llr.end());
        const auto before = part;
        ocisac::agree_with_code(part, format);
        CHECK(part == before);
      }
    }
}

TEST_CASE("chips that violate the code are not certain, and keep their signs") {
  std::mt19937 random(5);
  const ocisac::PacketFormat format{};
  for (const double wrong : {0.3, 0.5}) {
    const auto before = ratios(format, wrong, random);
    auto llr = before;
    ocisac::agree_with_code(llr, format);
    CHECK(expected_wrong(before) < 1e-5);
    CHECK(expected_wrong(llr) > 0.1);
    for (std::size_t k = 0; k < llr.size(); ++k) CHECK(llr[k] * before[k] >= 0);
  }
}
