#include "receiver/reading_trust.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <numbers>
#include <span>
#include <utility>

#include "chips/channel_growth.hpp"
#include "columns/moving_mean.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"

namespace ocisac {

namespace {

// A wrong chip violates its word, but 01 for 10 does so only across two words: half of all wrong chips show.
constexpr double kWrongPerViolation = 2;
constexpr double kMaxErrors = 2e-3, kMaxErrorsIfEven = 0.08;  // expected error rate; detection in noise expects 1/5
constexpr double kMaxCorrelation = 0.3;                       // right frames have at most 0.07, wrong ones at least 0.7
constexpr double kChangedRows = 1.5;                          // chips, by one of them
constexpr double kExcessChips = 8;                            // either side, in which the residual is alike
constexpr double kExcessErrors = 5;                           // standard errors
// Chips, of edges off the clock: 0.2 where falls or rises are late by 0.4 chips, 0.25 on a clock of 3/2 of their rate.
constexpr double kMostSpread = 0.22;
constexpr double kSureErrors = 0.05;           // chips in a frame
constexpr double kTail = 2, kUnderstated = 6;  // (degrees of freedom + 1)/2 of Student's t; of the residual's squares

// A chip of this log-likelihood ratio is wrong at this rate.
double error_rate_of(double llr) { return 1 / (1 + std::exp(std::abs(llr))); }

// Words that violate the code, in each part at the place of words with the fewest.
double violations(std::span<const std::span<const double>> parts, const LineCode& code) {
  const std::size_t chips = code.chips_per_word();
  std::ptrdiff_t sum = 0;
  for (const auto part : parts) {
    std::ptrdiff_t fewest = std::ssize(part);
    for (std::size_t skipped = 0; skipped < std::min(chips, part.size()); ++skipped) {
      const auto words = part.subspan(skipped, (part.size() - skipped) / chips * chips);
      fewest = std::min(fewest, std::ranges::count(code.decode(words).violations, 1));
    }
    sum += fewest;
  }
  return static_cast<double>(sum);
}

// The chips that the whole exposure covers.
std::span<const double> inner_chips(std::span<const double> llr, const ChipClock& clock) {
  const auto edge = static_cast<std::size_t>(std::ceil(clock.exposure_rows / clock.rows_per_chip)) + 1;
  return llr.size() > 3 * edge ? llr.subspan(edge, llr.size() - 2 * edge) : std::span<const double>{};
}

// Correlation of the residual from row to row, −1 to 1.
double residual_correlation(std::span<const double> left, const FrameReading& reading) {
  const auto rows = left.subspan(reading.channel.rows.begin, reading.channel.rows.size());
  const double energy = product_at_lag(rows, 0);
  return energy > 0 ? product_at_lag(rows, 1) / energy : 0.0;
}

// Edges lie off the clock, each as the one before: correlation 0 where they jitter, above 0 where the clock is wrong.
double edge_correlation(std::span<const double> off) {
  double squares = 0, products = 0, before = 0;
  for (const double edge : off) {
    if (edge == 0) continue;
    squares += edge * edge;
    products += edge * std::exchange(before, edge);
  }
  return squares > 0 ? products / squares : 0.0;
}

// Edges of a clock of another rate lie anywhere: their spread is 1/√12 chips.
bool lie_anywhere(std::span<const double> off, double edge_std) {
  double squares = 0, edges = 0;
  for (const double edge : off) {
    squares += edge * edge;
    edges += edge != 0 ? 1 : 0;
  }
  return squares * edge_std * edge_std > kMostSpread * kMostSpread * edges;
}

// Mean squares of the residual about each chip, summed over the rows that a chip changes: a multiple of those of white
// noise, 1 where it is not significant. The variance of a log-likelihood ratio grows by as much.
std::vector<double> residual_excess(std::span<const double> left, const FrameReading& reading) {
  const ChannelEstimate& channel = reading.channel;
  const ChipClock& clock = channel.clock;
  std::vector<double> excess(reading.llr.size(), 1.0);
  const double rows = kChangedRows * clock.rows_per_chip;
  const auto width = std::max<std::size_t>(static_cast<std::size_t>(std::nearbyint(rows)), 1);
  if (left.size() < width || !(channel.noise > 0)) return excess;
  std::vector<double> sums{0.0};  // of squared sums over `width` rows, in variances of white noise
  double sum = 0;
  for (std::size_t n = 0; n < left.size(); ++n) {
    sum += left[n] - (n >= width ? left[n - width] : 0.0);
    if (n + 1 >= width)
      sums.push_back(sums.back() + sum * sum / (static_cast<double>(width) * channel.noise * channel.noise));
  }
  const double last = static_cast<double>(sums.size() - 1);
  const auto excess_of = [&](double begin, double end, double errors) {
    const double mean = (sums[static_cast<std::size_t>(end)] - sums[static_cast<std::size_t>(begin)]) / (end - begin);
    // Squares of sums that overlap: two thirds of the width are one independent value.
    const double values = 1 + 1.5 * (end - begin) / static_cast<double>(width);
    return mean > 1 + errors * std::sqrt(2 / values) ? mean : 1.0;
  };
  // Chips that are easily confused take up a part of what a wrong clock leaves: all rows tell.
  double frame = excess_of(0, last, kWeak);
  if (frame > 1 && !(closeness(channel, left.size()) < kCloseSequences)) frame = 1;
  const double reach = kExcessChips * clock.rows_per_chip + 0.5 * clock.exposure_rows;
  for (std::size_t k = 0; k < excess.size(); ++k) {
    const double middle = clock.phase +
                          (static_cast<double>(reading.first) + static_cast<double>(k) + 0.5) * clock.rows_per_chip -
                          0.5 * static_cast<double>(width);
    const double begin = std::clamp(std::floor(middle - reach), 0.0, last - 1),
                 end = std::clamp(std::ceil(middle + reach), begin + 1, last);
    excess[k] = std::max(excess_of(begin, end, kExcessErrors), frame);
  }
  return excess;
}

// Nearby edges lie off the clock by squares that are a multiple of their variance; the larger multiple counts.
void add_edge_excess(std::span<const double> off, std::vector<double>& excess) {
  const auto chips = static_cast<std::size_t>(kExcessChips);
  for (std::size_t k = 0; k < off.size(); ++k) {
    double squares = 0, edges = 0;
    for (std::size_t near = k - std::min(k, chips); near < std::min(k + chips + 1, off.size()); ++near) {
      squares += off[near] * off[near];
      edges += off[near] != 0 ? 1 : 0;
    }
    if (squares > edges + kExcessErrors * std::sqrt(2 * edges)) excess[k] = std::max(excess[k], squares / edges);
  }
}

// The chips explain more of the rows than a constant light does, which costs no bits: 2^(−bits) is the prior of one
// sequence. A periodic one near a null of the exposure shows nothing but noise, at any swing.
// light: (rows) the chips' response.
bool is_worth_its_bits(const FrameReading& reading, std::span<const double> light) {
  const ChannelEstimate& channel = reading.channel;
  const double mean = mean_of(light);
  double explained = 0;
  for (std::size_t n = 0; n < light.size(); ++n)
    explained += std::pow(channel.swing_at(static_cast<double>(n), light.size()) * (light[n] - mean), 2);
  const auto bits = static_cast<double>(reading.llr.size());
  return explained > 2 * std::numbers::ln2 * bits * channel.noise * channel.noise;
}

// Edges off the clock take up much of what is in no model, so that little left means nothing.
bool takes_up_misfits(const FrameReading& reading) { return reading.channel.clock.edge_std > 0; }

// More is left than white noise: log-likelihood ratios count correlated rows as independent ones.
bool is_correlated(const FrameReading& reading) {
  const bool rows_are = takes_up_misfits(reading) || reading.relative_noise > kNoResidual;
  return (reading.correlation > kMaxCorrelation && rows_are) || reading.edge_correlation > kMaxCorrelation;
}

}  // namespace

double expected_errors(std::span<const double> llr, double scale) {
  double sum = 0;
  for (const double value : llr) sum += error_rate_of(scale * value);
  return sum;
}

void judge(FrameReading& reading, std::span<const double> off) {
  const ChannelEstimate& channel = reading.channel;
  const auto bits = hard_chips(reading);
  std::vector<double> light(reading.rest.size());
  expose_chips({bits, reading.first}, channel.clock, light);
  const auto left = residual_beside(reading.rest, light, channel);
  reading.correlation = residual_correlation(left, reading);
  reading.edge_correlation = edge_correlation(off);
  reading.excess = residual_excess(left, reading);
  add_edge_excess(off, reading.excess);
  const auto inner = inner_chips(reading.llr, channel.clock);
  reading.error_rate = inner.empty() ? 1.0 : expected_errors(inner, 1) / static_cast<double>(inner.size());
  reading.clock_in_doubt = lie_anywhere(off, channel.clock.edge_std) ||
                           std::ranges::all_of(reading.excess, [](double excess) { return excess > 1; });
  const bool white = !is_correlated(reading);
  const bool even = !takes_up_misfits(reading) && is_even(residual_windows(left, channel), channel.clock);
  const bool has_clock =
      std::ranges::all_of(channel.errors.covariance, [](double value) { return std::isfinite(value); });
  if (!(has_clock && is_worth_its_bits(reading, light) && reading.relative_noise < kMaxRelativeNoise &&
        reading.error_rate < (even ? kMaxErrorsIfEven : kMaxErrors)))
    reading.trust = Trust::unsound;
  else if (white)
    reading.trust = Trust::fits;
  else
    reading.trust = expected_errors(inner_chips(reliable_llr(reading), channel.clock), 1) < kSureErrors ? Trust::sure
                                                                                                        : Trust::misfit;
}

bool fits_off_clock(const FrameReading& reading) {
  return reading.trust >= Trust::misfit && takes_up_misfits(reading) && reading.correlation <= kMaxCorrelation;
}

bool keeps_clock(const FrameReading& reading) {
  return reading.trust == Trust::fits || (reading.trust != Trust::unsound && reading.error_rate < kMaxErrors);
}

std::vector<double> reliable_llr(const FrameReading& reading) {
  std::vector<double> llr = reading.llr;
  const bool misfit = is_correlated(reading);
  for (std::size_t k = 0; k < llr.size(); ++k)
    if (misfit || reading.excess[k] > 1)
      llr[k] = std::copysign(kTail * std::log1p(std::abs(llr[k]) / (kUnderstated * reading.excess[k])), llr[k]);
  return llr;
}

std::vector<double> code_weights(const FrameReading& reading) {
  const double correlation = std::max(reading.correlation, reading.edge_correlation);
  const double independent = is_correlated(reading) ? (1 - correlation) / (1 + correlation) : 1.0;
  std::vector<double> weights = reading.llr;
  for (double& value : weights) value *= independent;
  return weights;
}

RowRange explained_chips(std::span<const double> llr) {
  const auto near = static_cast<std::size_t>(kExcessChips);
  std::vector<double> rates;
  for (const double value : llr) rates.push_back(error_rate_of(value));
  const auto nearby = moving_mean(rates, near);
  RowRange best{0, llr.size()};
  std::size_t edges = 0, most = 0;
  for (std::size_t begin = 0, k = 0; k < llr.size(); ++k) {
    if (nearby[std::min(k + near, llr.size() - 1)] > kMaxErrorsIfEven) {
      begin = k + 2 * near + 1;
      edges = 0;
      continue;
    }
    if (k > begin && (llr[k] > 0) != (llr[k - 1] > 0) && ++edges > most) {
      most = edges;
      best.begin = begin;
    }
    if (most > 0 && begin == best.begin) best.end = k + 1;
  }
  return best.size() < 4 * near ? RowRange{0, llr.size()} : best;
}

std::vector<std::span<const double>> coded_parts(std::span<const double> llr, const PacketFormat& format) {
  const auto preamble = preamble_chips(format.preamble);
  const auto is_preamble = [&](std::span<const double> chips) {
    const bool turned = (chips[0] > 0) != (preamble[0] != 0);
    return std::equal(chips.begin(), chips.end(), preamble.begin(),
                      [=](double value, std::uint8_t chip) { return (value > 0) != ((chip != 0) == turned); });
  };
  std::vector<std::span<const double>> parts;
  std::size_t begin = 0;
  for (std::size_t at = 0; at + preamble.size() <= llr.size(); ++at) {
    if (at < begin || !is_preamble(llr.subspan(at, preamble.size()))) continue;
    std::size_t end = at;
    while (end > begin && (llr[end - 1] > 0) == (llr[at - 1] > 0)) --end;
    parts.push_back(llr.subspan(begin, end - begin));
    begin = at + preamble.size();
  }
  parts.push_back(llr.subspan(begin));
  return parts;
}

bool agree_with_code(std::vector<double>& llr, const PacketFormat& format) {
  const LineCode& code = format.line_code;
  const std::size_t word = code.chips_per_word();
  if (code.bits_per_word() == word || llr.size() < 2 * word) return true;
  const std::size_t words_of_preamble = (preamble_chips(format.preamble).size() + word - 1) / word;
  const auto of_preamble = static_cast<double>(words_of_preamble);
  const double preambles = std::ceil(static_cast<double>(llr.size()) / static_cast<double>(block_chips(format)));
  const double expected = expected_errors(llr, 1) / kWrongPerViolation;
  const auto seen_in = [&](std::span<const double> chips) {
    const auto parts = coded_parts(chips, format);
    const double unseen = std::max(preambles + 1 - static_cast<double>(parts.size()), 0.0);
    return violations(parts, code) - unseen * of_preamble;
  };
  double seen = seen_in(llr);
  if (seen > 0) {
    std::vector<double> turned(llr.size());
    std::ranges::transform(llr, turned.begin(), std::negate{});
    seen = std::min(seen, seen_in(turned));  // the light may be dark for 1
  }
  if (seen <= expected + kWeak * std::sqrt(expected + 1)) return true;
  double low = 0, high = 1;
  for (int k = 0; k < kManyIterations; ++k) {
    const double scale = 0.5 * (low + high);
    (expected_errors(llr, scale) > kWrongPerViolation * seen ? low : high) = scale;
  }
  for (double& value : llr) value *= high;
  return false;
}

}  // namespace ocisac
