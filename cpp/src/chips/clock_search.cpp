#include "chips/clock_search.hpp"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>
#include <vector>

#include "chips/channel_growth.hpp"
#include "chips/frame_evenness.hpp"
#include "ocisac/chips/sequence_detector.hpp"

namespace ocisac {

namespace {

constexpr double kUnsureFrame = 0.3;   // chips; max standard error at the frame's ends without a comparison of clocks
constexpr double kExposureStep = 0.5;  // chips, step of the initial exposures
constexpr int kExposureSteps = 2;      // on either side
constexpr double kGrowth = 1.3;        // factor of the rows per round
constexpr double kMinMove = 0.25;      // chips at the rows' ends
constexpr std::size_t kMaxClocks = 8;  // max number kept
constexpr double kReach = 20;          // max cost above the best clock, nats
constexpr double kAlike = 0.12;        // chips, at the rows' ends and of exposure: closer clocks are equal
constexpr int kWholeRounds = 3;

// The rows extended on either side; at an end of the frame, on the other side instead.
RowRange longer(RowRange rows, std::size_t frame_rows) {
  const auto size =
      std::min(static_cast<std::size_t>(std::ceil(kGrowth * static_cast<double>(rows.size()))) + 1, frame_rows);
  const std::size_t before = std::min((size - rows.size()) / 2, rows.begin);
  const std::size_t begin = std::min(rows.begin - before, frame_rows - size);
  return {begin, begin + size};
}

// The start, and fits to the known chips (else clocks near the start) with longer and shorter exposures.
std::vector<ChannelEstimate> first_clocks(const IterationContext& context, const ChannelEstimate& start) {
  const RefineOptions& options = context.options;
  std::vector<ChannelEstimate> clocks{start};
  if (options.exposure_known) return clocks;
  for (int k = -kExposureSteps; k <= kExposureSteps; ++k) {
    if (k == 0) continue;
    ChannelEstimate moved = with_exposure_moved(start, k * kExposureStep);
    auto fitted = options.known.levels.empty()
                      ? std::nullopt
                      : fit_channel(context.signal, options.known, moved.clock, {1, 0, true}, options.effort);
    clocks.push_back(fitted && fitted->swing[0] > 0 ? std::move(*fitted) : std::move(moved));
  }
  return clocks;
}

double chips_apart(const ChipClock& a, const ChipClock& b, double row) {
  return std::abs((row - a.phase) / a.rows_per_chip - (row - b.phase) / b.rows_per_chip);
}

bool are_alike(const ChipClock& a, const ChipClock& b, RowRange rows) {
  return std::max({chips_apart(a, b, static_cast<double>(rows.begin)), chips_apart(a, b, static_cast<double>(rows.end)),
                   std::abs(a.exposure_rows - b.exposure_rows) / a.rows_per_chip}) < kAlike;
}

// The most likely of the distinct clocks, the best first.
std::vector<ChannelEstimate> most_likely(std::vector<ChannelEstimate> clocks, RowRange rows) {
  std::ranges::stable_sort(clocks, {}, &ChannelEstimate::noise);
  std::vector<ChannelEstimate> kept;
  for (auto& channel : clocks) {
    const double behind = static_cast<double>(rows.size()) * std::log(channel.noise / clocks.front().noise);
    if (!kept.empty() && (behind > kReach || kept.size() == kMaxClocks)) break;
    const auto is_like = [&](const ChannelEstimate& other) { return are_alike(channel.clock, other.clock, rows); };
    if (std::ranges::none_of(kept, is_like)) kept.push_back(channel);
  }
  return kept;
}

// One iteration on the rows from each clock, and from higher and lower rates.
std::vector<ChannelEstimate> iterate_each(const IterationContext& context, std::span<const ChannelEstimate> clocks,
                                          RowRange rows, bool with_rates) {
  std::vector<ChannelEstimate> iterated;
  for (const ChannelEstimate& channel : clocks) {
    const double move = std::clamp(kMovedErrors * end_error(channel, rows), kMinMove, kMaxMove);
    for (const double faster : {0.0, -1.0, 1.0}) {
      if (faster != 0 && !with_rates) continue;
      auto iteration = iterate(context, with_rate_moved(channel, rows, faster * move), rows);
      if (iteration) iterated.push_back(std::move(iteration->channel));
    }
  }
  return iterated;
}

// Tracks several clocks in parallel from some rows on; returns the one with the smallest residual over the frame.
std::optional<ChannelEstimate> most_likely_clock(const IterationContext& context, std::vector<ChannelEstimate> clocks,
                                                 RowRange rows) {
  if (clocks.empty()) return std::nullopt;
  for (int whole = 0; whole < kWholeRounds && !context.is_used_up(); whole += rows.size() == context.signal.size()) {
    rows = longer(rows, context.signal.size());
    auto iterated = iterate_each(context, clocks, rows, whole == 0);
    if (iterated.empty()) return std::nullopt;
    clocks = most_likely(std::move(iterated), rows);
  }
  return clocks.front();
}

}  // namespace

double closeness(const ChannelEstimate& channel, std::size_t frame_rows) {
  const ChipClock& clock = channel.clock;
  const double swing = channel.swing_at(0.5 * static_cast<double>(frame_rows), frame_rows);
  const double distance = closest_pair_distance(clock.rows_per_chip, std::max(clock.exposure_rows, kShortestExposure));
  return 0.5 * distance * swing / std::max(channel.noise, 1e-300);
}

std::optional<RefinedChannel> track_in_parallel(const IterationContext& context, std::vector<ChannelEstimate> clocks,
                                                RowRange rows) {
  const auto clock = most_likely_clock(context, std::move(clocks), rows);
  auto found = clock ? grow(context, *clock, kGrowth) : std::nullopt;
  if (!found) return found;
  const auto left = channel_residual(context.signal, {found->chips, found->first}, found->channel);
  found->even = is_even(residual_windows(left, found->channel), found->channel.clock);
  return found;
}

std::optional<RefinedChannel> resolve_slip(const IterationContext& context, const ChannelEstimate& start,
                                           std::optional<RefinedChannel> found) {
  const bool may_slip =
      end_error(start, context.frame()) > kUnsureFrame && closeness(start, context.signal.size()) < kCloseSequences;
  if (context.is_used_up() || !may_slip) return found;
  auto other = track_in_parallel(context, first_clocks(context, start), start.rows);
  if (!other || (found && found->channel.noise <= other->channel.noise)) return found;
  return other;
}

}  // namespace ocisac
