#include "ocisac/packets/fsk.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "ocisac/rows/tone_search.hpp"
#include "rows/fit.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr double kMinResponse = 1e-3;  // below: a tone in a null of the exposure
constexpr std::size_t kMinRows = 8;
constexpr double kAsymptotic = 20;

// ln I₀(x), x ≥ 0: its power series, or the asymptotic one, which loses no more than 10⁻⁹ beyond.
double log_bessel_i0(double x) {
  const bool is_large = x > kAsymptotic;
  double sum = 1, term = 1;
  for (double k = 1; term > kEqual * sum; ++k) {
    term *= is_large ? (2 * k - 1) * (2 * k - 1) / (8 * k * x) : x * x / (4 * k * k);
    sum += term;
  }
  return std::log(sum) + (is_large ? x - 0.5 * std::log(kTwoPi * x) : 0.0);
}

// Mean, slope and a tone of these cycles per row, orthonormal.
Eigen::MatrixXd basis_of(double cycles, std::size_t rows) {
  return orthogonal_factors(tone_design(centred_rows(rows), std::array{cycles}, 1)).basis;
}

// Power by which other light would look like a tone of the set, in units of white noise in a row. Its spectrum is that
// of the rows without the tone and falls as that of a square wave or a texture: from a third of the tone on, where the
// odd harmonic before it lies, and as far below it as the nearest other tone.
double power_of_other_light(std::span<const double> signal, double tone, std::span<const double> cycles) {
  double apart = 0.5;
  for (const double other : cycles)
    if (other != tone) apart = std::min(apart, std::abs(other - tone));
  const std::size_t rows = signal.size(), length = padded_length(rows);
  const Eigen::MatrixXd rest = beside(basis_of(tone, rows), vector_of(signal));
  const std::vector<double> power = periodogram(span_of(rest), rows, length);
  const double least = chance_energy(2) / 2 * noise_floor(power), bins = static_cast<double>(length);
  double most = 0;
  for (std::size_t k = 0; k < power.size(); ++k)
    if (const double at = static_cast<double>(k) / bins;
        power[k] > least && at >= tone / 3 - 1 / static_cast<double>(rows) && at <= tone - apart)
      most = std::max(most, power[k] * std::pow(at / tone, 2));
  return most;
}

// (2·tones) × rows: each tone's cosine and sine, orthonormal to mean, slope and each other.
std::vector<double> directions_of(const Camera& camera, std::span<const double> tones, std::size_t rows) {
  std::vector<double> weights;
  for (const double tone : tones) {
    const Eigen::MatrixXd basis = basis_of(tone * camera.row_time, rows);
    weights.insert(weights.end(), basis.col(2).data(), basis.data() + basis.size());
  }
  return weights;
}

RowWeights weights_of(const Camera& camera, std::span<const double> tones, std::size_t rows) {
  check_tones(camera, tones);
  require(rows >= kMinRows && static_cast<double>(rows) * camera.row_time * *std::ranges::min_element(tones) >= 1,
          "rows", rows, "8 or more, and a cycle of the slowest tone");
  return {directions_of(camera, tones, rows), 2 * tones.size(), rows, 1, 3};
}

// Max-log ratio: the best symbol with the bit at 1 against the best with the bit at 0.
std::vector<double> soft_bits(std::span<const double> log_likelihoods, std::size_t bits) {
  std::vector<double> llr(bits);
  for (std::size_t bit = 0; bit < bits; ++bit) {
    double best[2] = {-1e300, -1e300};
    for (std::size_t symbol = 0; symbol < log_likelihoods.size(); ++symbol) {
      double& of_value = best[symbol >> (bits - 1 - bit) & 1U];
      of_value = std::max(of_value, log_likelihoods[symbol]);
    }
    llr[bit] = best[1] - best[0];
  }
  return llr;
}

}  // namespace

void check_tones(const Camera& camera, std::span<const double> tones) {
  check(camera);
  require(tones.size() >= 2 && tones.size() <= kMaxTones && std::has_single_bit(tones.size()), "tones",
          std::to_string(tones.size()) + " tones", "2, 4, 8, … 256 tones");
  for (std::size_t m = 0; m < tones.size(); ++m) {
    require_positive("tones", tones[m]);
    require(tones[m] * camera.row_time < 0.5, "tones", tones[m], "frequencies below half the row rate");
    for (std::size_t k = 0; k < m; ++k) require(tones[k] != tones[m], "tones", tones[m], "each tone once");
  }
}

FskDemodulator::FskDemodulator(const Camera& camera, std::span<const double> tones, std::size_t rows)
    : bits_(static_cast<std::size_t>(std::countr_zero(tones.size()))), weights_(weights_of(camera, tones, rows)) {
  for (const double tone : tones) {
    cycles_.push_back(tone * camera.row_time);
    responses_.push_back(std::max(camera.exposure ? std::abs(sinc(tone * *camera.exposure)) : 1.0, kMinResponse));
  }
}

FskSymbol FskDemodulator::demodulate(std::span<const double> signal, std::optional<double> amplitude) const {
  require(signal.size() == weights_.rows(), "signal", signal.size(), std::to_string(weights_.rows()) + " rows");
  for (const double value : signal) require(std::abs(value) <= kMaxLevel, "signal", value, "numbers of at most 1e100");
  if (amplitude) require(*amplitude >= 0 && *amplitude <= kMaxLevel, "amplitude", *amplitude, "0 to 1e100");
  std::vector<double> rest(signal.begin(), signal.end());
  remove_line(rest);
  const AnyFramesView view = dense_view<const double>(rest.data(), 1, rest.size(), 1);
  const Projection seen = project(view, 0, 0, 1, weights_);

  const std::size_t tones = responses_.size();
  std::vector<double> lengths(tones);
  for (std::size_t m = 0; m < tones; ++m) lengths[m] = std::hypot(seen.sums[2 * m], seen.sums[2 * m + 1]);
  const auto longest = static_cast<std::size_t>(std::ranges::max_element(lengths) - lengths.begin());
  const auto rows = static_cast<double>(signal.size());
  const double left = seen.squares[0] - lengths[longest] * lengths[longest];
  const double white = std::max(left / (rows - 4), 1e-24 * seen.squares[0] + 1e-300),
               variance = std::max(white, power_of_other_light(signal, cycles_[longest], cycles_));
  const double scale = std::sqrt(rows / 2);
  const auto amplitude_of = [&](std::size_t m) {
    return std::sqrt(std::max(lengths[m] * lengths[m] - 2 * white, 0.0)) / scale;
  };
  const double light = amplitude.value_or(amplitude_of(longest) / responses_[longest]);

  FskSymbol result;
  for (std::size_t m = 0; m < tones; ++m) {
    const double expected = light * responses_[m] * scale;
    result.log_likelihoods.push_back(log_bessel_i0(expected * lengths[m] / variance) -
                                     expected * expected / (2 * variance));
  }
  const auto best = std::ranges::max_element(result.log_likelihoods);
  result.symbol = static_cast<std::size_t>(best - result.log_likelihoods.begin());
  const double highest = *best;
  for (double& value : result.log_likelihoods) value -= highest;
  result.llr = soft_bits(result.log_likelihoods, bits_);
  result.snr = std::max(std::pow(lengths[result.symbol], 2) / (2 * variance) - 1, 0.0);
  result.error_rate = fsk_symbol_error_rate(tones, result.snr);
  result.amplitude = amplitude_of(result.symbol);
  result.noise = std::sqrt(white);
  return result;
}

// Integral over the amplitude of the sent tone (Rice distribution) of the probability that another tone is larger; u²:
// energy over noise density.
double fsk_symbol_error_rate(std::size_t tones, double snr) {
  require(tones >= 2, "tones", tones, "2 or more");
  require_not_negative("snr", snr);
  constexpr int kSteps = 400;  // even: Simpson's rule
  const double root = std::sqrt(snr), low = std::max(0.0, 0.5 * root - 8), high = root + 8;
  const double step = (high - low) / kSteps;
  double sum = 0;
  for (int k = 0; k <= kSteps; ++k) {
    const double u = low + k * step;
    if (u == 0) continue;
    const double another = -std::expm1(static_cast<double>(tones - 1) * std::log1p(-std::exp(-u * u)));
    const double density = 2 * u * std::exp(log_bessel_i0(2 * root * u) - u * u - snr);
    sum += another * density * (k == 0 || k == kSteps ? 1 : k % 2 == 1 ? 4 : 2);
  }
  return std::min(sum * step / 3, 1.0);
}

}  // namespace ocisac
