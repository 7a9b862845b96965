// Log-likelihood ratios against the line code.
#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "receiver/chip_reliability.hpp"

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

}  // namespace

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
