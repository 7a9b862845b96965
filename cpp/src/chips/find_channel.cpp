#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "chips/channel_equations.hpp"
#include "chips/channel_growth.hpp"
#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
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

// That of the rows' variance: an exposure of several chips seldom covers bright ones only.
double swing_of(std::span<const double> rows, const ChipClock& clock) {
  // Variance of the mean of L random chips: 1/(4L) for whole ones, reduced by the ramps of one chip.
  const double chips = clock.exposure_rows / clock.rows_per_chip;
  const double shrink = chips < 1 ? 1 - chips / 3 : (1 - 1 / (3 * chips)) / chips;
  return 2 * std::sqrt(variance_of(rows) / std::max(shrink, 1e-3));
}

// Initial channel with the levels of some rows; absent where they are steady.
std::optional<ChannelEstimate> first_channel(std::span<const double> rows, RowRange part, const ChipClock& clock) {
  const double swing = swing_of(rows, clock);
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

// A start scored by the residual of the best levels for its detected chips, without a fit of the clock. Chips are
// detected with the levels of the part, which has few of them, and of the frame, whose light may be uneven.
std::optional<Start> guess(const IterationContext& context, RowRange part, const ChipClock& clock) {
  check_interrupt();
  if (!context.may_try(part, clock, 1)) return std::nullopt;
  const auto signal = context.signal, part_rows = signal.subspan(part.begin, part.size());
  std::optional<Start> best;
  for (const auto level_rows : {part_rows, signal}) {
    const auto channel = first_channel(level_rows, part, clock);
    const auto chips = channel ? detect_rows(context, *channel, part) : std::nullopt;
    if (!chips) continue;
    ChannelEquations equations(signal, chips->inner(), {1, 0, true}, signal.size());
    const auto rows = static_cast<double>(equations.expose_known_rows(clock).size());
    const auto levels = rows > static_cast<double>(equations.level_size()) ? equations.fit_levels() : std::nullopt;
    if (!levels) continue;
    const double score = std::sqrt(equations.squares_left(*levels, 2) / rows) / swing_of(part_rows, clock);
    if (!best || score < best->score) best = Start{part, *channel, score};
  }
  return best;
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

// True if the edges of both clocks lie at the same rows of the part.
bool are_alike(const Start& a, const Start& b) {
  const auto apart = [&](std::size_t row) {
    const auto chips = [&](const ChipClock& clock) {
      return (static_cast<double>(row) - clock.phase) / clock.rows_per_chip;
    };
    return std::abs(std::remainder(chips(a.channel.clock) - chips(b.channel.clock), 1.0));
  };
  return a.part.begin == b.part.begin && std::max(apart(a.part.begin), apart(a.part.end)) < kSmallShare;
}

// Distinct starts in order of score.
std::vector<Start> find_starts(const IterationContext& context, const ChannelSearch& search) {
  std::vector<Start> starts;
  const std::size_t most = search.exposure_rows ? kGuessesTried : kGuessesOfUnknown;
  for (const double exposure_rows : exposures(search, context.signal.size())) {
    const auto guessed = guesses(context, search, exposure_rows);
    for (const Start& made : std::span(guessed).first(std::min(guessed.size(), most)))
      if (auto start = try_start(context, made)) starts.push_back(std::move(*start));
  }
  std::ranges::stable_sort(starts, {}, &Start::score);
  std::vector<Start> distinct;
  for (Start& start : starts)
    if (std::ranges::none_of(distinct, [&](const Start& other) { return are_alike(start, other); }))
      distinct.push_back(std::move(start));
  return distinct;
}

// Keeps the channel that leaves less of the frame.
void keep_better(std::optional<RefinedChannel> other, const ChannelSearch& search,
                 std::optional<RefinedChannel>& best) {
  if (!other || other->channel.has_other_rate(search.rows_per_chip, search.tolerance)) return;
  if (!best || other->channel.noise < best->channel.noise) best = std::move(other);
}

// True where chips are easily confused.
bool is_close(const RefinedChannel& found, std::size_t frame_rows) {
  return closeness(found.channel, frame_rows) < kCloseSequences;
}

// Tries the starts in order until the residual over the frame is as small as over the part; returns those left.
std::span<const Start> try_starts(const IterationContext& context, std::span<const Start> starts,
                                  const ChannelSearch& search, std::optional<RefinedChannel>& best) {
  while (!starts.empty()) {
    const Start& start = starts.front();
    starts = starts.subspan(1);
    auto grown = grow_to_frame(context, start.channel);
    const bool sure = grown && !grown->channel.has_other_rate(search.rows_per_chip, search.tolerance) &&
                      grown->settled &&
                      grown->channel.noise < (grown->even ? kEvenGrowth : kUnevenGrowth) * start.channel.noise;
    keep_better(std::move(grown), search, best);
    if (sure) break;
  }
  return starts;
}

// True if the residual over the frame exceeds that of the best part where chips are easily confused; false where no
// chips are detectable.
bool may_be_wrong(const RefinedChannel& found, double least_noise, std::size_t frame_rows) {
  return found.channel.noise > kSureGrowth * least_noise && is_close(found, frame_rows) &&
         closeness(found.channel, frame_rows) > kHopeless;
}

// Where chips are easily confused: tries the other starts, then compares those of each part while the current result
// may be wrong.
void compare_starts(const IterationContext& context, std::span<const Start> starts, std::span<const Start> untried,
                    const ChannelSearch& search, std::optional<RefinedChannel>& found) {
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
  while (!untried.empty() && !limited.is_used_up() && is_close(*found, context.signal.size()))
    untried = try_starts(limited, untried, search, found);
  for (auto& [part, clocks] : parts) {
    if (limited.is_used_up() || !may_be_wrong(*found, starts.front().channel.noise, context.signal.size())) break;
    keep_better(track_in_parallel(limited, std::move(clocks), part), search, found);
  }
  if (context.options.effort != nullptr) context.options.effort->rows = kept + share.rows;
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
  std::optional<RefinedChannel> found;
  const auto refined_starts = std::span(starts).first(std::min(starts.size(), kStartsRefined));
  const auto untried = try_starts(context, refined_starts, search, found);
  if (found && !options.warped) compare_starts(context, starts, untried, search, found);
  if (!found || options.exposure_known == fixed.exposure_known) return found;
  auto refined = grow_to_frame({signal, detect, options}, found->channel);
  return refined && !refined->channel.has_other_rate(search.rows_per_chip, search.tolerance) ? refined : found;
}

}  // namespace ocisac
