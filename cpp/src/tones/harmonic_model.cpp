#include "tones/harmonic_model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/levels.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// True if the tone's sines or cosines vanish on every row: at multiples of half the row rate, up to the rounding of
// f·T_r.
bool at_multiple_of_half_row_rate(double cycles_per_row) {
  const double halves = 2 * cycles_per_row;
  return std::abs(halves - std::nearbyint(halves)) <= 4 * std::numeric_limits<double>::epsilon() * halves;
}

Flags frequency_flags(double cycles_per_row, std::size_t rows) {
  Flags flags = 0;
  if (cycles_per_row * static_cast<double>(rows) < 1 - kEqual) flags |= flag::few_cycles;
  if (cycles_per_row > 0.5) flags |= flag::aliased;
  if (at_multiple_of_half_row_rate(cycles_per_row)) flags |= flag::unresolvable;
  return flags;
}

struct Oscillation {
  std::size_t tone;
  double cycles_per_row;
};

// Oscillations that the rows determine: the fundamentals, then harmonics in ascending order until half of the degrees
// of freedom are used, without those within a quarter of a bin of another tone's fundamental.
std::vector<Oscillation> usable_oscillations(std::span<const ModelTone> tones, std::size_t rows,
                                             std::span<Flags> flags) {
  std::vector<Oscillation> usable, harmonics;
  for (std::size_t k = 0; k < tones.size(); ++k) {
    if (flags[k] & flag::unresolvable) continue;
    usable.push_back({k, tones[k].cycles_per_row});
    for (const int h : tones[k].harmonics)
      if (h > 1) harmonics.push_back({k, h * tones[k].cycles_per_row});
  }
  std::ranges::stable_sort(harmonics, {}, &Oscillation::cycles_per_row);
  const double quarter_bin = 0.25 / static_cast<double>(rows);
  for (const Oscillation& harmonic : harmonics) {
    const bool taken = std::ranges::any_of(usable, [&](const Oscillation& other) {
      return std::abs(other.cycles_per_row - harmonic.cycles_per_row) < quarter_bin;
    });
    const bool rows_left = 2 * (2 * usable.size() + 3) <= rows + 2;
    if (taken || !rows_left || at_multiple_of_half_row_rate(harmonic.cycles_per_row))
      flags[harmonic.tone] |= flag::harmonics_dropped;
    else
      usable.push_back(harmonic);
  }
  return usable;
}

// Rows u and −u enter a symmetric block only by (y(u) + y(−u))/√2, an antisymmetric one by the difference: the rows
// with u ≥ 0, orthonormally.
RowSampling folded_rows(std::size_t rows) {
  RowSampling half = centred_rows(rows);
  half.times.erase(half.times.begin(), half.times.begin() + static_cast<std::ptrdiff_t>(rows / 2));
  half.weights.assign(half.times.size(), std::numbers::sqrt2);
  if (rows % 2 == 1) half.weights[0] = 1;
  return half;
}

// Expands folded columns to full ones: symmetric (sign = 1) or antisymmetric (sign = −1).
MatrixXd unfolded(const MatrixXd& folded, const RowSampling& half, double sign, Index rows) {
  if (folded.cols() == 0) return {rows, 0};
  const MatrixXd upper = folded.array().colwise() / vector_of(half.weights).array();
  MatrixXd full(rows, folded.cols());
  full << sign * upper.bottomRows(rows / 2).colwise().reverse(), upper;
  return full;
}

// Adds the solution of a block to the model; `places`: indices of its estimates in the model.
void add_block(const LinearFit& block, const RowSampling& half, double sign, const std::vector<Index>& places,
               HarmonicModel& model) {
  const auto rows = static_cast<Index>(model.rows), size = block.basis.cols();
  model.parameters += static_cast<std::size_t>(size);
  model.basis.conservativeResize(rows, static_cast<Index>(model.parameters));
  model.basis.rightCols(size) = unfolded(block.basis, half, sign, rows);
  model.weights(Eigen::all, places) = unfolded(block.weights, half, sign, rows);
  model.covariance(places, places) = block.covariance;
}

}  // namespace

HarmonicModel harmonic_model(std::size_t rows, std::span<const ModelTone> tones) {
  require(rows > 0, "rows", rows, "at least 1");
  HarmonicModel model;
  model.rows = rows;
  model.middle = (static_cast<double>(rows) - 1) / 2;
  model.estimates = 1 + 2 * tones.size();
  const auto estimates = static_cast<Index>(model.estimates);
  model.weights.setZero(static_cast<Index>(rows), estimates);
  model.covariance.setZero(estimates, estimates);
  model.covariance.diagonal().tail(estimates - 1).setConstant(kInfinity);
  for (const ModelTone& tone : tones) {
    require_positive("frequency", tone.cycles_per_row);
    const Flags too_few_rows =
        flag_if(rows <= model.estimates, flag::unresolvable);  // one additional row for the noise
    model.tone_flags.push_back(frequency_flags(tone.cycles_per_row, rows) | too_few_rows);
  }

  const auto oscillations = usable_oscillations(tones, rows, model.tone_flags);
  const RowSampling half = folded_rows(rows);
  const auto wanted = std::ranges::count_if(model.tone_flags, [](Flags f) { return !(f & flag::unresolvable); });
  std::vector<Index> even_places{0}, odd_places;
  for (std::size_t k = 0; k < static_cast<std::size_t>(wanted); ++k) {
    even_places.push_back(2 * static_cast<Index>(oscillations[k].tone) + 1);
    odd_places.push_back(even_places.back() + 1);
  }
  std::vector<double> frequencies;
  for (const Oscillation& oscillation : oscillations) frequencies.push_back(oscillation.cycles_per_row);
  const MatrixXd design = tone_design(half, frequencies);
  const Index count = std::ssize(frequencies);
  MatrixXd cosines(design.rows(), count + 1);  // symmetric columns; the sines are antisymmetric
  cosines << design.col(0), design(Eigen::all, Eigen::seqN(1, count, 2));
  const MatrixXd sines = design(Eigen::all, Eigen::seqN(2, count, 2));
  const LinearFit even = linear_fit(cosines, wanted + 1), odd = linear_fit(sines, wanted);
  add_block(even, half, 1, even_places, model);
  add_block(odd, half, -1, odd_places, model);

  const double condition = std::max(even.condition, odd.condition);
  for (Flags& flags : model.tone_flags) {
    if (condition > kIllConditioned) flags |= flag::ill_conditioned;
    if (condition == kInfinity) flags |= flag::unresolvable;
  }
  return model;
}

}  // namespace ocisac
