#include "chips/threshold_detectors.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

#include "ocisac/chips/error_rates.hpp"
#include "ocisac/tones/equalize.hpp"
#include "rows/exposed_chips.hpp"

namespace ocisac {

namespace {

constexpr double kMiddle = 0.4;    // half width about a chip's middle, relative to its part outside of the ramps
constexpr double kMinReach = 0.5;  // rows
// Number of chips averaged for an error rate, and their spacing, which covers the positions of chips relative to rows.
constexpr int kChips = 16, kApart = 67;

// Weights of neighbouring rows, sum 1: each the overlap of its interval (half a row to either side) with the reach
// around the centre. Empty if that is outside of the rows.
struct Weights {
  std::size_t begin = 0;
  std::vector<double> of_row{};

  Weights() = default;
  Weights(double centre, double reach, std::size_t rows) { set_around(centre, reach, rows); }
  void set_around(double centre, double reach, std::size_t rows) {
    of_row.clear();
    const double first = std::max(std::ceil(centre - reach - 0.5), 0.0);
    const double last = std::min(std::floor(centre + reach + 0.5), static_cast<double>(rows) - 1);
    if (!(first <= last)) return;
    begin = static_cast<std::size_t>(first);
    double sum = 0;
    for (double row = first; row <= last; ++row) {
      of_row.push_back(std::max(std::min(centre + reach, row + 0.5) - std::max(centre - reach, row - 0.5), 0.0));
      sum += of_row.back();
    }
    if (!(sum > 0)) of_row.clear();
    for (double& weight : of_row) weight /= sum;
  }
  [[nodiscard]] double sum_of(std::span<const double> rows) const { return sum_from(begin, rows); }
  [[nodiscard]] double sum_from(std::size_t row, std::span<const double> rows) const {
    double sum = 0;
    for (std::size_t n = 0; n < of_row.size(); ++n) sum += of_row[n] * rows[row + n];
    return sum;
  }
};

double middle_of(const ChipClock& clock, double chip) { return clock.phase + (chip + 0.5) * clock.rows_per_chip; }

// Weight of a chip in a row.
double share(double row, double chip, const ChipClock& clock) {
  const double begin = clock.phase + chip * clock.rows_per_chip, half = 0.5 * clock.exposure_rows;
  return std::max(std::min(row + half, begin + clock.rows_per_chip) - std::max(row - half, begin), 0.0) /
         clock.exposure_rows;
}

// Decision value: ½ + gain·x + Σ others·x + noise, x = ±½.
struct Response {
  double gain = 0;
  std::vector<double> others;
  double noise = 0;  // variance

  void add(double part, bool own) {
    if (own)
      gain = part;
    else
      others.push_back(part);
  }
  [[nodiscard]] double llr(double value) const {
    double variance = noise;
    for (const double other : others) variance += 0.25 * other * other;
    return variance > 0 ? (value - 0.5) * gain / variance : 0.0;
  }
  [[nodiscard]] double error_rate() const { return sliced_error_rate(gain, others, std::sqrt(noise)); }
};

// ---- Slicer

double slicer_reach(const ChipClock& clock) {
  return std::max(kMiddle * (clock.rows_per_chip - clock.exposure_rows), kMinReach);
}

// Number of chips to either side with a possible effect on the rows around a chip's middle.
double chips_seen(const ChipClock& clock) {
  return std::ceil((0.5 * clock.exposure_rows + slicer_reach(clock) + 0.5) / clock.rows_per_chip - 0.5);
}

// Response of the decision value of `chip` to each chip, and to independent rows of the standard deviation
// noise_of(row); its memory is used again.
template <class NoiseOf>
void set_response(Response& response, const Weights& weights, double chip, const ChipClock& clock, NoiseOf noise_of) {
  response.others.clear();
  response.noise = 0;
  for (std::size_t n = 0; n < weights.of_row.size(); ++n)
    response.noise += std::pow(weights.of_row[n] * noise_of(weights.begin + n), 2);
  const double away = chips_seen(clock);
  for (double other = chip - away; other <= chip + away; ++other) {
    double sum = 0;
    for (std::size_t n = 0; n < weights.of_row.size(); ++n)
      sum += weights.of_row[n] * share(static_cast<double>(weights.begin + n), other, clock);
    response.add(sum, other == chip);
  }
}

// ---- Inverse

double inverse_reach(const ChipClock& clock) { return std::max(kMiddle * clock.rows_per_chip, kMinReach); }

// Row n of the output of equalize() is the light at the end of row n's exposure, half an exposure after its middle.
double inverse_middle(const ChipClock& clock, double chip) {
  return middle_of(clock, chip) - 0.5 * clock.exposure_rows;
}

std::vector<double> equalized(std::span<const double> rows, double exposure_rows) {
  std::vector<double> light(rows.size());
  const Camera camera{1, exposure_rows, {}, {}};
  equalize(dense_view(rows.data(), 1, rows.size(), 1), camera, {}, dense_view(light.data(), 1, light.size(), 1));
  return light;
}

// Response to one bright chip, and to noise in one row, in the middle of many rows: far from the ends the equaliser is
// shift-invariant.
Response inverse_response(ChipClock clock, double noise) {
  const double reach = inverse_reach(clock), length = 24 * clock.exposure_rows + 32 * clock.rows_per_chip + 128;
  const auto rows = static_cast<std::size_t>(length), middle = rows / 2;
  clock.phase += std::floor(0.5 * length - clock.phase - 0.5 * clock.rows_per_chip);  // moves chip 0 to the middle
  std::vector<double> values(rows);
  for (std::size_t n = 0; n < rows; ++n) values[n] = share(static_cast<double>(n), 0, clock);
  const auto chip = equalized(values, clock.exposure_rows);
  std::ranges::fill(values, 0.0);
  values[middle] = 1;
  const auto row = equalized(values, clock.exposure_rows);

  Response response;
  const double away = std::floor(0.4 * length / clock.rows_per_chip);
  for (double other = -away; other <= away; ++other) {
    response.add(Weights(inverse_middle(clock, other), reach, rows).sum_of(chip), other == 0);
  }
  const Weights weights(inverse_middle(clock, 0), reach, rows);
  for (std::size_t n = 0; n + weights.of_row.size() <= rows; ++n)
    response.noise += std::pow(noise * weights.sum_from(n, row), 2);
  return response;
}

}  // namespace

std::vector<double> slice_chips(const ChipQuestion& question) {
  const ChipClock clock = with_min_exposure(question.clock);
  std::vector<double> ratios(question.count);
  Weights weights;
  Response response;
  for (std::size_t k = 0; k < question.count; ++k) {
    const auto chip = static_cast<double>(question.first + static_cast<std::ptrdiff_t>(k));
    weights.set_around(middle_of(clock, chip), slicer_reach(clock), question.rows.size());
    if (weights.of_row.empty()) continue;
    set_response(response, weights, chip, clock, [&](std::size_t row) { return question.noise_of(row); });
    ratios[k] = response.llr(weights.sum_of(question.rows));
  }
  return ratios;
}

std::vector<double> invert_and_slice_chips(const ChipQuestion& question) {
  const ChipClock clock = with_min_exposure(question.clock);
  std::vector<double> ratios(question.count);
  if (question.rows.empty()) return ratios;
  const auto light = equalized(question.rows, clock.exposure_rows);
  const Response response = inverse_response(clock, question.noise);
  for (std::size_t k = 0; k < question.count; ++k) {
    const auto chip = static_cast<double>(question.first + static_cast<std::ptrdiff_t>(k));
    const Weights weights(inverse_middle(clock, chip), inverse_reach(clock), light.size());
    if (!weights.of_row.empty()) ratios[k] = response.llr(weights.sum_of(light));
  }
  return ratios;
}

double slicer_error_rate(const ChipClock& clock, double noise) {
  ChipClock used = with_min_exposure(clock);
  used.phase -= used.rows_per_chip * std::floor(used.phase / used.rows_per_chip);
  const double first = std::ceil((used.exposure_rows + 4) / used.rows_per_chip) + 2;
  double sum = 0;
  for (int k = 0; k < kChips; ++k) {
    const double chip = first + k * kApart;
    const double rows = middle_of(used, 2 * chip) + used.exposure_rows + 4;
    const Weights weights(middle_of(used, chip), slicer_reach(used), static_cast<std::size_t>(rows));
    Response response;
    set_response(response, weights, chip, used, [=](std::size_t) { return noise; });
    sum += response.error_rate();
  }
  return sum / kChips;
}

double inverse_error_rate(const ChipClock& clock, double noise) {
  return inverse_response(with_min_exposure(clock), noise).error_rate();
}

}  // namespace ocisac
