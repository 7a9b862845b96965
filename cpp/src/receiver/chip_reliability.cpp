#include "receiver/chip_reliability.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>

namespace ocisac {

namespace {

// A wrong chip violates its word, but 01 for 10 does so only across two words: half of all wrong chips show.
constexpr double kWrongPerViolation = 2;
constexpr double kMinDeviations = 3;  // standard deviations of the count of violations
constexpr int kHalvings = 30;
constexpr double kSureErrors = 0.05;           // chips in a frame
constexpr double kTail = 2, kUnderstated = 6;  // (degrees of freedom + 1)/2 of Student's t; of the residual's squares

double expected_wrong(std::span<const double> llr, double scale) {
  double sum = 0;
  for (const double value : llr) sum += 1 / (1 + std::exp(scale * std::abs(value)));
  return sum;
}

// Words that violate the code, at the place of words with the fewest.
double violations(std::span<const double> llr, const LineCode& code) {
  std::ptrdiff_t fewest = std::numeric_limits<std::ptrdiff_t>::max();
  const std::size_t chips = code.chips_per_word();
  for (std::size_t skipped = 0; skipped < chips; ++skipped) {
    const auto words = llr.subspan(skipped, (llr.size() - skipped) / chips * chips);
    fewest = std::min(fewest, std::ranges::count(code.decode(words).violations, 1));
  }
  return static_cast<double>(fewest);
}

}  // namespace

std::vector<double> reliable_llr(const FrameReading& reading) {
  std::vector<double> llr = reading.llr;
  const bool misfit = is_misfit(reading);
  for (std::size_t k = 0; k < llr.size(); ++k)
    if (misfit || reading.excess[k] > 1)
      llr[k] = std::copysign(kTail * std::log1p(std::abs(llr[k]) / (kUnderstated * reading.excess[k])), llr[k]);
  return llr;
}

bool is_sure(const FrameReading& reading) {
  const auto llr = reliable_llr(reading);
  const ChipClock& clock = reading.channel.clock;
  const auto edge = static_cast<std::size_t>(std::ceil(clock.exposure_rows / clock.rows_per_chip)) + 1;
  return llr.size() > 2 * edge && expected_wrong(std::span(llr).subspan(edge, llr.size() - 2 * edge), 1) < kSureErrors;
}

std::vector<double> code_weights(const FrameReading& reading) {
  const double independent = is_misfit(reading) ? (1 - reading.correlation) / (1 + reading.correlation) : 1.0;
  std::vector<double> weights = reading.llr;
  for (double& value : weights) value *= independent;
  return weights;
}

void agree_with_code(std::vector<double>& llr, const PacketFormat& format) {
  const LineCode& code = format.line_code;
  const std::size_t word = code.chips_per_word();
  if (code.bits_per_word() == word || llr.size() < 2 * word) return;
  const std::size_t words_of_preamble = (preamble_chips(format.preamble).size() + word - 1) / word;
  const auto per_preamble = static_cast<double>(words_of_preamble);
  const double preambles = std::ceil(static_cast<double>(llr.size()) / static_cast<double>(block_chips(format)));
  const double seen = violations(llr, code) - per_preamble * preambles;
  const double expected = expected_wrong(llr, 1) / kWrongPerViolation;
  if (seen <= expected + kMinDeviations * std::sqrt(expected + 1)) return;
  double low = 0, high = 1;
  for (int k = 0; k < kHalvings; ++k) {
    const double scale = 0.5 * (low + high);
    (expected_wrong(llr, scale) > kWrongPerViolation * seen ? low : high) = scale;
  }
  for (double& value : llr) value *= high;
}

}  // namespace ocisac
