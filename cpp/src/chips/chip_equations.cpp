#include "ocisac/chips/chip_equations.hpp"

#include <algorithm>
#include <cmath>

#include "chips/edge_places.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr double kPrior = 4;  // inverse prior variance of a chip

double length_of(const ChipClock& clock) {
  return std::max(clock.exposure_rows, kShortestExposure) / clock.rows_per_chip;
}

}  // namespace

void check(const ChipQuestion& question, double longest) {
  require_positive("rows_per_chip", question.clock.rows_per_chip);
  require_finite("phase", question.clock.phase);
  require(question.clock.exposure_rows >= 0 &&
              question.clock.exposure_rows <= (1 + kWholeChips) * longest * question.clock.rows_per_chip,
          "exposure_rows", question.clock.exposure_rows, "0 to " + shortest_text(longest) + " chips, in rows");
  require_positive("noise", question.noise);
  for (const double row : question.rows) require_finite("rows", row);
  require(question.row_noise.empty() || question.row_noise.size() == question.rows.size(), "row_noise",
          question.row_noise.size(), "as many as rows");
  for (const double noise : question.row_noise) require_positive("row_noise", noise);
}

std::optional<double> known_level(const ChipQuestion& question, std::size_t k) {
  const std::ptrdiff_t at = question.first + static_cast<std::ptrdiff_t>(k) - question.known.first;
  if (at < 0 || at >= static_cast<std::ptrdiff_t>(question.known.levels.size())) return std::nullopt;
  return question.known.levels[static_cast<std::size_t>(at)];
}

ChipEquations::ChipEquations(const ChipQuestion& question, double longest)
    : count_((check(question, longest), question.count)),
      seen_(static_cast<std::size_t>(std::ceil((1 - kWholeChips) * length_of(question.clock)))),
      band_(question.clock.edge_std > 0 ? std::max(std::min(2 * seen_ + 2, static_cast<std::size_t>(longest)), seen_)
                                        : seen_),
      normal_(count_ * (band_ + 1), 0.0),
      target_(count_, 0.0) {
  for (std::size_t chip = 0; chip < count_; ++chip) {
    const auto known = known_level(question, chip);
    normal_[chip * (band_ + 1)] = kPrior + (known ? kKnownPrecision : 0.0);
    if (known) target_[chip] = kKnownPrecision * (*known - 0.5);
  }
  if (count_ > 0) add_rows(question);
  factor_ = normal_;
  factor();
}

void ChipEquations::add_rows(const ChipQuestion& question) {
  const ChipClock& clock = question.clock;
  const double last = static_cast<double>(count_ - 1);
  std::vector<double> seen(seen_ + 1);  // [j]: weight of the chip j before the newest
  // Rows that begin or end between an edge's place and the clock's see a part of the displacement, not J·e: the mean
  // square of that for normal e, with an edge at 3 of 4 chips, is ½·E|e|³/length².
  const double curved = 0.8 * std::pow(clock.edge_std, 3) / std::pow(length_of(clock), 2);
  EdgeNoise edges(clock.edge_std > 0 ? count_ : 0, seen_, clock.edge_std);
  for (std::size_t row = 0; row < question.rows.size(); ++row) {
    const double length = length_of(clock) * clock.share_at(static_cast<std::ptrdiff_t>(row));
    const double scale = 1 / (question.noise_of(row) * question.noise_of(row) + curved);
    const double end = (clock.end_at(static_cast<std::ptrdiff_t>(row)) - clock.phase) / clock.rows_per_chip -
                       static_cast<double>(question.first);
    // The first and the last chip extend: a row beyond them by rounding belongs to them.
    const double newest = std::clamp(std::floor(end), 0.0, last), begin = end - length;
    const std::size_t chip = static_cast<std::size_t>(newest), chips = std::min(seen_, chip) + 1;
    for (std::size_t back = 0; back < chips; ++back) {
      const double from = newest - static_cast<double>(back);
      const double low = back + 1 == chips ? begin : std::max(begin, from);
      seen[back] = std::max((back == 0 ? end : std::min(end, from + 1)) - low, 0.0) / length;
    }
    const double value = scale * (question.rows[row] - 0.5);
    for (std::size_t i = 0; i < chips; ++i) {
      double* of_chip = &normal_[(chip - i) * (band_ + 1)];
      const double weight = scale * seen[i];
      for (std::size_t j = i; j < chips; ++j) of_chip[j - i] += weight * seen[j];
      target_[chip - i] += value * seen[i];
    }
    if (clock.edge_std > 0) edges.add_row(chip, std::span(seen).first(chips), 1 / length, scale, value);
  }
  if (clock.edge_std > 0) edges.take_off(band_, normal_, target_);
}

void ChipEquations::factor() {
  const std::size_t width = band_ + 1;
  for (std::size_t chip = count_; chip-- > 0;) {
    double* own = &factor_[chip * width];
    const double precision = own[0];
    const std::size_t reach = std::min(band_, chip);
    for (std::size_t back = 1; back <= reach; ++back) {
      double* of_chip = &factor_[(chip - back) * width];
      const double share = own[back] / precision;
      for (std::size_t further = back; further <= reach; ++further) of_chip[further - back] -= share * own[further];
      target_[chip - back] -= share * target_[chip];
    }
    for (std::size_t back = 1; back <= reach; ++back) own[back] /= precision;
    target_[chip] /= precision;
  }
}

// A⁻¹ within the band, from the first chip on (Takahashi et al. 1973).
std::vector<double> ChipEquations::variances() const {
  const std::size_t width = band_ + 1;
  std::vector<double> inverse(count_ * width, 0.0), result(count_);  // [k·width + j]: (A⁻¹)_(k, k − j)
  const auto at = [&](std::size_t a, std::size_t b) {
    return inverse[std::max(a, b) * width + (a > b ? a - b : b - a)];
  };
  for (std::size_t chip = 0; chip < count_; ++chip) {
    const double* shares = feedback(chip);
    const std::size_t reach = std::min(band_, chip);
    double* own = &inverse[chip * width];
    for (std::size_t back = 1; back <= reach; ++back)
      for (std::size_t other = 1; other <= reach; ++other) own[back] -= shares[other] * at(chip - back, chip - other);
    own[0] = 1 / precision(chip);
    for (std::size_t back = 1; back <= reach; ++back) own[0] -= shares[back] * own[back];
    result[chip] = own[0];
  }
  return result;
}

}  // namespace ocisac
