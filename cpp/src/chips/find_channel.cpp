#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "chips/channel_equations.hpp"
#include "chips/channel_growth.hpp"
#include "core/check_interrupt.hpp"
#include "core/statistics.hpp"
#include "ocisac/chips/reduced_search.hpp"
#include "ocisac/chips/refine_channel.hpp"
#include "ocisac/core/require.hpp"
#include "rows/exposed_chips.hpp"

namespace ocisac {

namespace {

constexpr double kSearchChips = 36;    // length of the searched part of the frame, beside the exposure
constexpr double kSearchSlack = 0.15;  // max error of the grid of starts, chips
constexpr int kSearchRounds = 4;
constexpr std::size_t kSearchParts = 3;                           // parts of the frame
constexpr std::size_t kGuessesTried = 18, kGuessesOfUnknown = 6;  // for a known exposure; per exposure if unknown
constexpr std::size_t kStartsRefined = 3;                         // best starts over all parts and exposures
constexpr double kHopeless = 1.5;     // half the distance of the closest pair over the noise
constexpr double kFirstNoise = 0.05;  // relative to the swing
constexpr double kSureGrowth = 1.35;  // of the residual, from the best part to the whole frame
// Growth of the residual from a part to the whole frame: of an even one, and of others.
constexpr double kEvenGrowth = 1.8, kUnevenGrowth = 1.3;

struct Start {
  RowRange part;
  ChannelEstimate channel;
  double score = std::numeric_limits<double>::infinity();  // residual over swing
};

// Where rows are displaced, those in the middle of the picture are so least.
std::vector<RowRange> search_parts(std::span<const double> signal, double length, bool warped) {
  const auto size = std::min(static_cast<std::size_t>(length), signal.size());
  std::vector<std::pair<double, RowRange>> parts;
  for (std::size_t begin = 0; begin + size <= signal.size(); begin += std::max<std::size_t>(size / 2, 1)) {
    double change = 0;
    for (std::size_t n = begin + 1; n < begin + size; ++n) change += std::pow(signal[n] - signal[n - 1], 2);
    const double off = std::abs(static_cast<double>(begin) + 0.5 * static_cast<double>(size) -
                                0.5 * static_cast<double>(signal.size()));
    parts.push_back({warped ? off : -change, {begin, begin + size}});
  }
  std::ranges::stable_sort(parts, {}, [](const auto& part) { return part.first; });
  std::vector<RowRange> best;
  for (const auto& part : parts)
    if (best.size() < kSearchParts) best.push_back(part.second);
  return best;
}

// Initial channel; absent where the part is steady. An exposure of several chips seldom covers bright ones only: the
// swing is that of the rows' variance.
std::optional<ChannelEstimate> first_channel(std::span<const double> signal, RowRange part, const ChipClock& clock) {
  const auto rows = signal.subspan(part.begin, part.size());
  // Variance of the mean of L random chips: 1/(4L) for whole ones, reduced by the ramps of one chip.
  const double chips = clock.exposure_rows / clock.rows_per_chip;
  const double shrink = chips < 1 ? 1 - chips / 3 : (1 - 1 / (3 * chips)) / chips;
  const double variance = variance_of(rows);
  const double swing = 2 * std::sqrt(variance / std::max(shrink, 1e-3));
  if (!(swing > 0)) return std::nullopt;
  return ChannelEstimate{clock, {}, {mean_of(rows) - 0.5 * swing}, {swing}, kFirstNoise * swing, part, false};
}

std::optional<Start> try_start(const IterationContext& context, const Start& guessed) {
  Start best{guessed.part, guessed.channel};
  for (int round = 0; round < kSearchRounds; ++round) {
    auto iteration = iterate(context, best.channel, best.part);
    if (!iteration) break;
    const double score = iteration->channel.noise / iteration->channel.swing[0];
    if (!(score < 0.999 * best.score)) break;
    best = {best.part, std::move(iteration->channel), score};
  }
  if (!std::isfinite(best.score)) return std::nullopt;
  return best;
}

// A start scored by the residual of the best levels for its detected chips, without a fit of the clock.
std::optional<Start> guess(const IterationContext& context, RowRange part, const ChipClock& clock) {
  check_interrupt();
  if (!context.may_try(part, clock, 1)) return std::nullopt;
  const auto channel = first_channel(context.signal, part, clock);
  const auto chips = channel ? detect_rows(context, *channel, part) : std::nullopt;
  if (!chips) return std::nullopt;
  ChannelEquations equations(context.signal, chips->inner(), {1, 0, true}, context.signal.size());
  const auto rows = static_cast<double>(equations.expose_known_rows(clock).size());
  const auto levels = rows > static_cast<double>(equations.level_size()) ? equations.fit_levels() : std::nullopt;
  if (!levels) return std::nullopt;
  return Start{part, *channel, std::sqrt(equations.squares_left(*levels, 2) / rows) / channel->swing[0]};
}

// Guesses over parts of the frame, rates and phases, in order of score.
std::vector<Start> guesses(const IterationContext& context, const ChannelSearch& search, double exposure_rows) {
  const double chips = kSearchChips + exposure_rows / search.rows_per_chip;
  const auto rates = rates_within(search.rows_per_chip, search.tolerance, chips, kSearchSlack);
  const double phases = std::ceil(0.5 / kSearchSlack);
  std::vector<Start> found;
  for (const RowRange& part : search_parts(context.signal, chips * search.rows_per_chip, context.options.warped))
    for (const double period : rates)
      for (double j = 0; j < phases; ++j) {
        const double middle = 0.5 * static_cast<double>(part.begin + part.end);
        const ChipClock clock{period, middle + (j / phases - std::floor(0.5 * chips)) * period,
                              std::max(exposure_rows, kShortestExposure)};
        if (const auto made = guess(context, part, clock)) found.push_back(*made);
      }
  std::ranges::stable_sort(found, {}, &Start::score);
  return found;
}

std::vector<double> exposures(const ChannelSearch& search, std::size_t rows) {
  if (search.exposure_rows) return {*search.exposure_rows};
  const double max_chips = std::min(search.max_exposure_chips, static_cast<double>(rows) / search.rows_per_chip);
  return exposures_up_to(max_chips, search.rows_per_chip);
}

// Starts in order of score.
std::vector<Start> find_starts(const IterationContext& context, const ChannelSearch& search) {
  std::vector<Start> starts;
  const std::size_t most = search.exposure_rows ? kGuessesTried : kGuessesOfUnknown;
  for (const double exposure_rows : exposures(search, context.signal.size())) {
    const auto guessed = guesses(context, search, exposure_rows);
    for (const Start& made : std::span(guessed).first(std::min(guessed.size(), most)))
      if (auto start = try_start(context, made)) starts.push_back(std::move(*start));
  }
  std::ranges::stable_sort(starts, {}, &Start::score);
  return starts;
}

// Residual relative to the swing.
double score_of(const RefinedChannel& found) { return found.channel.noise / found.channel.swing[0]; }

// Tries the starts in order until the residual over the frame is as small as over the part.
std::optional<RefinedChannel> try_starts(const IterationContext& context, std::span<const Start> starts,
                                         const ChannelSearch& search) {
  std::optional<RefinedChannel> best;
  for (const Start& start : starts) {
    auto grown = grow_to_frame(context, start.channel);
    if (!grown || grown->channel.has_other_rate(search.rows_per_chip, search.tolerance)) continue;
    const bool sure = grown->settled && score_of(*grown) < (grown->even ? kEvenGrowth : kUnevenGrowth) * start.score;
    if (!best || score_of(*grown) < score_of(*best)) best = std::move(grown);
    if (sure) break;
  }
  return best;
}

// True if the residual over the frame exceeds that of the best part where chips are easily confused; false where no
// chips are detectable.
bool may_be_wrong(const RefinedChannel& found, double min_score, std::size_t frame_rows) {
  const double close = closeness(found.channel, frame_rows);
  return score_of(found) > kSureGrowth * min_score && close < kCloseSequences && close > kHopeless;
}

// Compares the starts of each part while the current result may be wrong.
std::optional<RefinedChannel> compare_starts(const IterationContext& context, std::span<const Start> starts,
                                             const ChannelSearch& search, std::optional<RefinedChannel> found) {
  std::vector<std::pair<RowRange, std::vector<ChannelEstimate>>> parts;
  for (const Start& start : starts) {
    auto part = std::ranges::find(parts, start.part.begin, [](const auto& known) { return known.first.begin; });
    if (part == parts.end()) part = parts.insert(part, {start.part, {}});
    if (part->second.size() < kMaxClocks) part->second.push_back(start.channel);
  }
  // Uses half of the remaining effort, to keep the rest for the final detection.
  RefineOptions options = context.options;
  const double kept = options.effort == nullptr ? 0.0 : 0.5 * options.effort->rows;
  SearchEffort share{kept};
  if (options.effort != nullptr) options.effort = &share;
  const IterationContext limited{context.signal, context.detect, options};
  for (auto& [part, clocks] : parts) {
    if (limited.is_used_up() || !may_be_wrong(*found, starts.front().score, context.signal.size())) break;
    auto other = track_in_parallel(limited, std::move(clocks), part);
    if (!other || other->channel.has_other_rate(search.rows_per_chip, search.tolerance)) continue;
    if (score_of(*other) < score_of(*found)) found = std::move(other);
  }
  if (context.options.effort != nullptr) context.options.effort->rows = kept + share.rows;
  return found;
}

}  // namespace

std::vector<double> exposures_up_to(double longest, double rows_per_chip) {
  std::vector<double> result;
  for (double length = 0.5; length <= longest; length += length < 2 ? 0.5 : 1) result.push_back(length * rows_per_chip);
  return result;
}

std::vector<double> rates_within(double rows_per_chip, double tolerance, double chips, double slack) {
  const double steps = std::ceil(std::max(0.5 * chips * tolerance / slack, 1.0));
  std::vector<double> result;
  for (double k = 0; k < steps; ++k) result.push_back(rows_per_chip * (1 + tolerance * ((2 * k + 1) / steps - 1)));
  return result;
}

std::optional<RefinedChannel> find_channel(std::span<const double> signal, const ChannelSearch& search,
                                           const DetectChips& detect, const RefineOptions& options) {
  check_rows_per_chip(search.rows_per_chip);
  require(search.tolerance >= 0 && search.tolerance < 0.5, "tolerance", search.tolerance, "0 to 0.5");
  if (search.exposure_rows) require_not_negative("exposure_rows", *search.exposure_rows);
  require(search.max_exposure_chips >= 0 && search.max_exposure_chips <= kLongestReducedExposure, "max_exposure_chips",
          search.max_exposure_chips, "0 to 24");
  for (double value : signal) require_finite("signal", value);
  // Every row covers all chips of the frame, which cannot be separated.
  if (search.exposure_rows && *search.exposure_rows >= static_cast<double>(signal.size())) return std::nullopt;
  RefineOptions fixed = options;
  fixed.exposure_known = options.exposure_known || search.exposure_rows.has_value();
  const IterationContext context{signal, detect, fixed};
  const auto starts = find_starts(context, search);
  auto found = try_starts(context, std::span(starts).first(std::min(starts.size(), kStartsRefined)), search);
  if (found && !options.warped) found = compare_starts(context, starts, search, std::move(found));
  if (!found || options.exposure_known == fixed.exposure_known) return found;
  auto refined = grow_to_frame({signal, detect, options}, found->channel);
  return refined && !refined->channel.has_other_rate(search.rows_per_chip, search.tolerance) ? refined : found;
}

}  // namespace ocisac
