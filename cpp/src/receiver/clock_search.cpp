#include "clock_search.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "ocisac/receiver/sequence_detector.hpp"

namespace ocisac {

namespace {

constexpr double kUnsureFrame = 0.3;     // chips; with a larger standard error at the frame's ends all rates are tried
constexpr double kCloseSequences = 3.5;  // half the distance of the closest pair over the noise
constexpr double kCertainExposure = 0.06;  // chips; with a larger standard error other exposures are tried
constexpr double kMostExposureMoved = 0.8;
constexpr double kRateStep = 0.3;  // chips at the farther end
constexpr double kMostRateSteps = 20;
constexpr std::size_t kClocksTried = 8;  // further, of those
constexpr int kClockRounds = 4;
constexpr double kExposureMove = 1.5;  // standard errors

// A start with rates within three standard errors, and exposures about it where that is not sure.
std::vector<ChannelEstimate> start_grid(const ChannelEstimate& start, std::size_t rows, bool exposure_known) {
  const ChipClock& clock = start.clock;
  const double middle = clock.phase + static_cast<double>(start.errors.chip) * clock.rows_per_chip;
  const double farthest = std::max(middle, static_cast<double>(rows) - middle) / clock.rows_per_chip;
  const double step = kRateStep * clock.rows_per_chip / farthest;
  const double steps = std::min(std::ceil(3 * start.errors.rows_per_chip_std() / step), kMostRateSteps);
  const double exposure_error = start.errors.exposure_std() / clock.rows_per_chip;
  std::vector<double> moves{0};
  if (!exposure_known && exposure_error > kCertainExposure)
    for (const double move : {-kExposureMove, kExposureMove})
      moves.push_back(move * std::min(exposure_error, kMostExposureMoved));
  std::vector<ChannelEstimate> grid;
  for (double k = -steps; k <= steps; ++k)
    for (const double move : moves) {
      ChannelEstimate channel = with_exposure_moved(start, move);
      channel.clock.rows_per_chip += k * step;
      channel.clock.phase -= k * step * static_cast<double>(start.errors.chip);
      grid.push_back(std::move(channel));
    }
  return grid;
}

}  // namespace

bool may_slip(const ChannelEstimate& start, std::size_t rows) {
  const ChipClock& clock = start.clock;
  const double noise = start.noise / std::max(start.swing_at(0.5 * static_cast<double>(rows), rows), 1e-300);
  return end_error(start, {0, rows}) > kUnsureFrame &&
         closest_pair_distance(clock.rows_per_chip, std::max(clock.exposure, kShortestExposure)) <
             2 * kCloseSequences * noise;
}

std::optional<ChannelEstimate> likeliest_clock(const TurnContext& context, const ChannelEstimate& start) {
  const auto turned = [&](const ChannelEstimate& channel) -> std::optional<ChannelEstimate> {
    auto turn = take_turn(context, channel, context.frame());
    if (!turn) return std::nullopt;
    return std::move(turn->channel);
  };
  std::vector<ChannelEstimate> found;
  for (const auto& channel : start_grid(start, context.signal.size(), context.options.exposure_known)) {
    if (context.is_used_up()) break;
    if (auto next = turned(channel)) found.push_back(std::move(*next));
  }
  std::ranges::stable_sort(found, {}, &ChannelEstimate::noise);
  found.resize(std::min(found.size(), kClocksTried));
  std::optional<ChannelEstimate> best;
  for (auto& channel : found)
    for (int round = 0; round < kClockRounds; ++round) {
      if (!best || channel.noise < best->noise) best = channel;
      if (context.is_used_up()) break;
      auto next = turned(channel);
      if (!next || !(next->noise < channel.noise)) break;
      channel = std::move(*next);
    }
  return best;
}

}  // namespace ocisac
