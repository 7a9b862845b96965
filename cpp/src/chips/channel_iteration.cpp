#include "chips/channel_iteration.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "chips/channel_equations.hpp"
#include "core/check_interrupt.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr double kFollowed = 0.25;         // fraction of the fitted rows over which a slope is extrapolated
constexpr double kMinSwing = 0.1;          // relative to the middle of those rows
constexpr double kCertainPhase = 0.04;     // chips; with a larger standard error other rates are tried
constexpr double kCertainExposure = 0.06;  // chips; with a larger standard error other exposures are tried
constexpr double kMaxExposureMove = 0.8;
constexpr double kMaxChips = 1e6;      // in a frame
constexpr double kStatesPerRow = 64;   // states of the trellis whose cost equals that of a row of a fit
constexpr double kMaxStateChips = 11;  // for longer exposures not all states are evaluated
constexpr double kLevelFits = 2;       // cost of the choice of levels, in fits of levels and clock

// The channel's levels, constant beyond a short extrapolation. ChipRows uses them unlimited: its channel is that of the
// whole frame, and a swing that falls to 0 there is an error of the caller.
struct HeldLevels {
  const ChannelEstimate& channel;
  std::size_t frame_rows;

  [[nodiscard]] double held(std::size_t row) const {
    const auto first = static_cast<double>(channel.rows.begin), last = static_cast<double>(channel.rows.end) - 1;
    const bool straight = channel.dark.size() <= 2 && channel.swing.size() <= 2;
    const double beyond = straight ? kFollowed * (last - first) : 0.0;
    return std::clamp(static_cast<double>(row), first - beyond, std::max(first, last) + beyond);
  }
  [[nodiscard]] double dark(std::size_t row) const { return channel.dark_at(held(row), frame_rows); }
  [[nodiscard]] double swing(std::size_t row) const {
    const double middle = 0.5 * static_cast<double>(channel.rows.begin + channel.rows.end);
    return std::max(channel.swing_at(held(row), frame_rows), kMinSwing * channel.swing_at(middle, frame_rows));
  }
};

void put_known(const KnownChips& known, FoundChips& chips) {
  for (std::size_t k = 0; k < known.levels.size(); ++k) {
    const std::ptrdiff_t at = known.first + static_cast<std::ptrdiff_t>(k) - chips.first;
    if (at >= 0 && at < static_cast<std::ptrdiff_t>(chips.levels.size()))
      chips.levels[static_cast<std::size_t>(at)] = known.levels[k];
  }
}

// Degrees of dark and swing that minimise Schwarz's criterion at a fixed clock. In a part of the frame, at most lines.
ChannelModel choose_levels(const IterationContext& context, const FoundChips& chips, const ChipClock& clock,
                           bool covers_frame) {
  const RefineOptions& options = context.options;
  ChannelModel best{0, 0, options.exposure_known};
  double lowest = std::numeric_limits<double>::infinity();
  const std::size_t highest = covers_frame ? options.highest_degree : std::min<std::size_t>(options.highest_degree, 1);
  ChannelEquations equations(context.signal, chips.known(), {highest, highest, true}, context.signal.size());
  const RowRange range = rows_of(chips.known(), with_min_exposure(clock), context.signal.size());
  if (range.size() > 0) equations.expose(moved_to(with_min_exposure(clock), equations.origin()), range);
  for (std::size_t degree = 0; degree <= highest; ++degree)
    for (const std::size_t swing_degree : {std::size_t{0}, degree}) {
      if (swing_degree == 0 && degree > 1) continue;  // a light with gradients also lights its surroundings
      if (range.size() <= degree + swing_degree + 2) return best;
      const auto levels = equations.fit_levels(degree + 1, swing_degree + 1);
      if (!levels) return best;
      const double squares = equations.squares_left(*levels, degree + 1);
      const auto count = static_cast<double>(range.size()), unknowns = static_cast<double>(degree + swing_degree);
      const double criterion = count * std::log(std::max(squares, 1e-300) / count) + unknowns * std::log(count);
      if (criterion < lowest) {
        lowest = criterion;
        best = {degree, swing_degree, options.exposure_known};
      }
    }
  return best;
}

}  // namespace

std::optional<FoundChips> detect_rows(const IterationContext& context, const ChannelEstimate& channel, RowRange range) {
  const auto signal = context.signal;
  const HeldLevels levels{channel, signal.size()};
  std::vector<double> rows;
  for (std::size_t n = range.begin; n < range.end; ++n) {
    const double swing = levels.swing(n);
    rows.push_back((signal[n] - levels.dark(n)) / swing);
    if (!(swing > 0) || !std::isfinite(rows.back())) return std::nullopt;
  }
  ChipClock clock = channel.clock;
  clock.phase -= static_cast<double>(range.begin);
  if (!(clock.exposure_rows + static_cast<double>(range.size()) - 1 < kMaxChips * clock.rows_per_chip))
    return std::nullopt;
  const ChipGrid grid = affecting_chips(clock, range.size());
  const double middle = levels.swing((range.begin + range.end) / 2);
  FoundChips chips{context.detect({rows, clock, std::max(channel.noise / middle, kMinDetectorNoise), grid.first,
                                   grid.count, context.options.known}),
                   grid.first};
  put_known(context.options.known, chips);
  return chips;
}

FoundChips without_edges(const FoundChips& chips) {
  if (chips.levels.size() < 8) return chips;
  return {{chips.levels.begin() + 1, chips.levels.end() - 1}, chips.first + 1};
}

bool IterationContext::may_try(RowRange range, const ChipClock& clock, double fits) const {
  if (options.effort == nullptr) return true;
  const double rows = static_cast<double>(range.size());
  const double states = std::exp2(std::min(kMaxStateChips, std::ceil(clock.exposure_rows / clock.rows_per_chip)));
  return options.effort->take(rows * (fits + 1) + rows / clock.rows_per_chip * states / kStatesPerRow);
}

std::optional<Iteration> iterate(const IterationContext& context, const ChannelEstimate& channel, RowRange range) {
  check_interrupt();
  if (!context.may_try(range, channel.clock, kLevelFits)) return std::nullopt;
  auto chips = detect_rows(context, channel, range);
  if (!chips) return std::nullopt;
  const FoundChips kept = without_edges(*chips);
  const bool most = range.size() > context.signal.size() / 2;
  auto fitted = fit_channel(context.signal, kept.known(), channel.clock,
                            choose_levels(context, kept, channel.clock, most), context.options.effort);
  if (!fitted || !(fitted->swing[0] > 0)) return std::nullopt;
  return Iteration{std::move(*fitted), std::move(*chips)};
}

double end_error(const ChannelEstimate& channel, RowRange range) {
  const double begin = static_cast<double>(range.begin), end = static_cast<double>(range.end);
  const double error = std::max(channel.errors.phase_std(chip_at(begin, channel.clock)),
                                channel.errors.phase_std(chip_at(end, channel.clock)));
  return error / channel.clock.rows_per_chip;
}

ChannelEstimate with_rate_moved(ChannelEstimate channel, RowRange range, double chips) {
  ChipClock& clock = channel.clock;
  const auto middle = static_cast<double>(channel.errors.chip);
  const double reach = 0.5 * static_cast<double>(range.size()) / clock.rows_per_chip;
  const double change = chips * clock.rows_per_chip / reach;
  clock.rows_per_chip += change;
  clock.phase -= middle * change;
  return channel;
}

ChannelEstimate with_exposure_moved(ChannelEstimate channel, double chips) {
  channel.clock.exposure_rows =
      std::max(channel.clock.exposure_rows + chips * channel.clock.rows_per_chip, kShortestExposure);
  return channel;
}

std::optional<Iteration> iterate_best(const IterationContext& context, const ChannelEstimate& channel, RowRange range) {
  auto best = iterate(context, channel, range);
  const double error = end_error(channel, range);
  if (!(error > kCertainPhase)) return best;
  const double exposure_error = channel.errors.exposure_rows_std() / channel.clock.rows_per_chip;
  const double rate_move = std::min(kMovedErrors * error, kMaxMove);
  const double exposure_move = exposure_error > kCertainExposure ? std::min(4 * exposure_error, kMaxExposureMove) : 0.0;
  for (const double longer : {0.0, 1.0, -1.0}) {
    if (longer != 0 && (context.options.exposure_known || exposure_move == 0)) continue;
    for (const double faster : {0.0, -1.0, 1.0}) {
      if (longer == 0 && faster == 0) continue;  // the unmodified channel, already evaluated
      const ChannelEstimate moved =
          with_exposure_moved(with_rate_moved(channel, range, faster * rate_move), longer * exposure_move);
      if (!(moved.clock.rows_per_chip > 0.5 * channel.clock.rows_per_chip)) continue;  // for frames of a few rows
      auto other = iterate(context, moved, range);
      if (other && (!best || other->channel.noise < best->channel.noise)) best = std::move(other);
    }
  }
  return best;
}

}  // namespace ocisac
