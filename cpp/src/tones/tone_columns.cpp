#include "ocisac/tones/tone_columns.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/levels.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

// Periodic share of each block's energy in all frames.
std::vector<double> periodic_shares(const ColumnBlocks& blocks, const PeriodicFit& fit) {
  std::vector<double> shares(blocks.blocks), energies(blocks.blocks);
  for (std::size_t signal = 0; signal < fit.residual_energy.size(); ++signal) {
    shares[signal % blocks.blocks] += fit.periodic_energy[signal];
    energies[signal % blocks.blocks] += fit.periodic_energy[signal] + fit.residual_energy[signal];
  }
  for (std::size_t b = 0; b < blocks.blocks; ++b) shares[b] = shares[b] > 0 ? shares[b] / energies[b] : 0;
  return shares;
}

// Ratio of periodic to other energy; a bound keeps signals without noise comparable.
double ratio_of(double share) { return share / (1 - share + 1e-6 * share); }

}  // namespace

std::vector<std::uint8_t> tone_blocks(const ColumnBlocks& blocks, const PeriodicFit& fit) {
  auto ratios = periodic_shares(blocks, fit);
  std::ranges::transform(ratios, ratios.begin(), ratio_of);
  double best = 0, best_clear = 0;
  for (std::size_t b = 0; b < blocks.blocks; ++b) {
    best = std::max(best, ratios[b]);
    if (blocks.saturated_share[b] <= kSmallShare) best_clear = std::max(best_clear, ratios[b]);
  }
  const bool clear_only = best_clear > 0 && best_clear >= kSmallShare * best;
  const double least = kSmallShare * (clear_only ? best_clear : best);
  std::vector<std::uint8_t> used(blocks.blocks);
  for (std::size_t b = 0; b < blocks.blocks; ++b)
    used[b] = ratios[b] >= least && (!clear_only || blocks.saturated_share[b] <= kSmallShare);
  return used;
}

ToneColumns spread_over_columns(const ColumnBlocks& blocks, const std::vector<std::uint8_t>& used_blocks,
                                const PeriodicFit& fit) {
  const auto shares = periodic_shares(blocks, fit);
  ToneColumns columns;
  double saturated = 0, used = 0;
  for (std::size_t column = 0; column < blocks.columns; ++column) {
    const std::size_t block = column / blocks.width;
    columns.used.push_back(used_blocks[block]);
    columns.strength.push_back(shares[block]);
    used += used_blocks[block];
    saturated += used_blocks[block] * blocks.saturated_share[block];
  }
  columns.saturated = saturated > kSmallShare * used;
  return columns;
}

ToneColumns tone_columns(const AnyFramesView& frames, double frequency, double saturation) {
  require_positive("frequency", frequency);
  ColumnBlocks blocks = column_blocks(frames, saturation);
  const auto rows = static_cast<double>(blocks.rows);
  // Keeps away from 0 and half the row rate, where a tone degenerates to a mean or an alternation.
  const double alias =
      std::clamp(std::abs(frequency - std::nearbyint(frequency)), std::min(0.1 / rows, 0.25), 0.5 - 0.05 / rows);
  const PeriodicModel model = periodic_model(alias, blocks.rows, kComparedHarmonics);
  if (blocks.rows <= model.parameters()) {
    return {std::vector<std::uint8_t>(blocks.columns, 1), std::vector<double>(blocks.columns), false};
  }
  const PeriodicFit fit = fit_periodic({std::move(blocks.signals), blocks.rows}, model, alias);
  return spread_over_columns(blocks, tone_blocks(blocks, fit), fit);
}

}  // namespace ocisac
