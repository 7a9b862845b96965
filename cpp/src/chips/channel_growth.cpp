#include "chips/channel_growth.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "chips/frame_evenness.hpp"

namespace ocisac {

namespace {

constexpr double kSurePhase = 0.08;  // chips; max standard error for detection of rows
constexpr double kMaxGrowth = 2, kMaxWarpedGrowth = 1.15;
// Min growth factor of the rows per round, in up to three attempts.
constexpr std::array kGrowths{1.3, 1.2, 1.12};
constexpr std::array kWarpedGrowths{1.12, 1.06, 1.2};  // the warp beyond the rows is extrapolated
constexpr int kMaxRounds = 40;
constexpr int kSettlingRounds = 4;  // with all rows

// Rows extended on either side while the clock is certain, by at least the min growth.
RowRange grown(const ChannelEstimate& channel, std::size_t frame_rows, double min_growth, double max_growth) {
  const ChipClock& clock = channel.clock;
  const double middle = clock.phase + static_cast<double>(channel.errors.chip) * clock.rows_per_chip;
  const auto limit = static_cast<double>(frame_rows);
  const double min_reach = 0.5 * min_growth * static_cast<double>(channel.rows.size()) + clock.rows_per_chip;
  double sure = 0;
  while (sure < limit / clock.rows_per_chip &&
         channel.errors.phase_std(channel.errors.chip + static_cast<std::ptrdiff_t>(sure)) <
             kSurePhase * clock.rows_per_chip)
    sure += 2;
  const double centre = 0.5 * static_cast<double>(channel.rows.begin + channel.rows.end);
  const double max_reach = max_growth / 2 * static_cast<double>(channel.rows.size());
  const double begin = std::min(centre - min_reach, std::max(middle - sure * clock.rows_per_chip, centre - max_reach));
  const double end = std::max(centre + min_reach, std::min(middle + sure * clock.rows_per_chip, centre + max_reach));
  return {static_cast<std::size_t>(std::clamp(begin, 0.0, limit)),
          static_cast<std::size_t>(std::clamp(end, 0.0, limit))};
}

}  // namespace

std::optional<RefinedChannel> grow(const IterationContext& context, const ChannelEstimate& start, double min_growth) {
  ChannelEstimate channel = start;
  FoundChips last;
  RowWarp warp;
  const double max_growth = context.options.warped ? kMaxWarpedGrowth : kMaxGrowth;
  std::vector<double> even_rows;
  IterationContext even = context;
  int settling = 0;
  bool settled = false;
  for (int round = 0; round < kMaxRounds && settling < kSettlingRounds && !settled; ++round) {
    const RowRange range = grown(channel, context.signal.size(), min_growth, max_growth);
    if (context.options.warped) even.signal = even_rows = unwarped(context.signal, warp);
    auto iteration = iterate_best(even, channel, range);
    if (!iteration) return std::nullopt;
    const bool whole = range.size() == context.signal.size();
    settling += whole;
    settled = whole && iteration->chips == last;
    if (context.options.warped) {
      warp = fit_warp(even_rows, warp, iteration->chips.known(), iteration->channel);
      set_rate(start.clock.rows_per_chip, warp, iteration->channel.clock);
    }
    channel = std::move(iteration->channel);
    last = std::move(iteration->chips);
  }
  if (settling == 0) return std::nullopt;
  return RefinedChannel{std::move(channel), std::move(last.levels), last.first, settled, false, std::move(warp)};
}

std::optional<RefinedChannel> grow_to_frame(const IterationContext& context, const ChannelEstimate& start) {
  std::optional<RefinedChannel> best;
  std::optional<ChannelEstimate> from = start;
  for (const double growth : context.options.warped ? kWarpedGrowths : kGrowths) {
    auto tried = from ? grow(context, *from, growth) : std::nullopt;
    if (tried && (!best || tried->channel.noise < best->channel.noise)) best = std::move(tried);
    if (!best) continue;
    const auto rows = unwarped(context.signal, best->warp);
    const auto windows =
        residual_windows(channel_residual(rows, {best->chips, best->first}, best->channel), best->channel);
    best->even = is_even(windows, best->channel.clock);
    if (best->settled && best->even) break;
    from = channel_of_best_part(context, *best, windows);
  }
  return best;
}

}  // namespace ocisac
