#include "ocisac/chips/refine_channel.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "chips/channel_equations.hpp"
#include "chips/channel_growth.hpp"
#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "ocisac/chips/chip_equations.hpp"
#include "ocisac/chips/sequence_detector.hpp"

namespace ocisac {

namespace {

constexpr double kFollowed = 0.25;                    // fraction of the fitted rows over which a slope is extrapolated
constexpr double kCertainPhase = 0.04;                // chips; with a larger standard error other rates are tried
constexpr double kCertainExposure = 0.06;             // chips; with a larger standard error other exposures are tried
constexpr double kMovedErrors = 1.5, kMaxMove = 0.4;  // of a clock at the rows' ends: standard errors, chips
constexpr double kMaxChips = 1e6;                     // in a frame
constexpr double kStatesPerRow = 64;                  // states of the trellis whose cost equals that of a row of a fit
constexpr double kMaxStateChips = 11;                 // for longer exposures not all states are evaluated
constexpr double kLevelFits = 2;                      // cost of the choice of levels, in fits of levels and clock
constexpr double kSurePhase = 0.08;                   // chips; max standard error for detection of rows
constexpr double kMaxGrowth = 2, kMaxWarpedGrowth = 1.15;
// Min growth factor of the rows per round, in up to three attempts.
constexpr std::array kGrowths{1.3, 1.2, 1.12};
constexpr std::array kWarpedGrowths{1.12, 1.06, 1.2};  // the warp beyond the rows is extrapolated
constexpr int kWholeRounds = 4;                        // with all rows
constexpr double kEven = 1.15, kEvenErrors = 6;  // ratio of the residuals of two parts of the frame; standard errors
constexpr double kSmoothRows = 4;
constexpr double kWindowChips = 30;   // length of a part, beside the exposure
constexpr double kUnsureFrame = 0.3;  // chips; max standard error at the frame's ends without a comparison of clocks
constexpr double kMinMove = 0.25;     // chips at the rows' ends
constexpr double kReach = 20;         // max cost above the best clock, nats

// Degrees of dark and swing that minimise Schwarz's criterion at a fixed clock. In a part of the frame, at most lines.
ChannelModel choose_levels(const IterationContext& context, const KnownChips& chips, const ChipClock& clock,
                           bool covers_frame) {
  const RefineOptions& options = context.options;
  ChannelModel best{0, 0, options.exposure_known};
  double lowest = std::numeric_limits<double>::infinity();
  const std::size_t highest = covers_frame ? options.highest_degree : std::min<std::size_t>(options.highest_degree, 1);
  ChannelEquations equations(context.signal, chips, {highest, highest, true}, context.signal.size());
  const RowRange range = equations.expose_known_rows(clock);
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
  // Levels are constant beyond a short extrapolation from the fitted rows. ChipRows uses them unlimited: its channel is
  // that of the whole frame, and a swing that falls to 0 there is an error of the caller.
  const auto first = static_cast<double>(channel.rows.begin), last = static_cast<double>(channel.rows.end) - 1;
  const double beyond = channel.dark.size() <= 2 ? kFollowed * (last - first) : 0.0;
  const auto held = [&](std::size_t row) {
    return std::clamp(static_cast<double>(row), first - beyond, std::max(first, last) + beyond);
  };
  const double least = kSmallShare * channel.swing_at(0.5 * (first + last + 1), signal.size());
  const auto swing_at = [&](std::size_t row) { return std::max(channel.swing_at(held(row), signal.size()), least); };
  std::vector<double> rows;
  for (std::size_t n = range.begin; n < range.end; ++n) {
    const double swing = swing_at(n);
    rows.push_back((signal[n] - channel.dark_at(held(n), signal.size())) / swing);
    if (!(swing > 0) || !std::isfinite(rows.back())) return std::nullopt;
  }
  const ChipClock clock = channel.clock.from_row(static_cast<std::ptrdiff_t>(range.begin));
  if (!(clock.exposure_rows + static_cast<double>(range.size()) - 1 < kMaxChips * clock.rows_per_chip))
    return std::nullopt;
  const ChipGrid grid = affecting_chips(clock, range.size());
  const double middle = swing_at((range.begin + range.end) / 2);
  const ChipQuestion question{.rows = rows,
                              .clock = clock,
                              .noise = std::max(channel.noise / middle, kMinDetectorNoise),
                              .first = grid.first,
                              .count = grid.count,
                              .known = context.options.known,
                              .effort = context.options.effort};
  FoundChips chips{context.detect(question), grid.first};
  for (std::size_t k = 0; k < grid.count; ++k) chips.levels[k] = known_level(question, k).value_or(chips.levels[k]);
  return chips;
}

KnownChips FoundChips::inner() const {
  if (levels.size() < 8) return known();
  return {std::span(levels).subspan(1, levels.size() - 2), first + 1};
}

bool IterationContext::may_try(RowRange range, const ChipClock& clock, double fits) const {
  if (options.effort == nullptr) return true;
  const double rows = static_cast<double>(range.size());
  const double states = std::exp2(std::min(kMaxStateChips, std::ceil(clock.exposure_rows / clock.rows_per_chip)));
  return options.effort->take(rows * (fits + 1) + rows / clock.rows_per_chip * states / kStatesPerRow);
}

std::optional<RefinedChannel> iterate(const IterationContext& context, const ChannelEstimate& channel, RowRange range) {
  check_interrupt();
  if (!context.may_try(range, channel.clock, kLevelFits)) return std::nullopt;
  auto chips = detect_rows(context, channel, range);
  if (!chips) return std::nullopt;
  const KnownChips inner = chips->inner();
  const bool most = range.size() > context.signal.size() / 2;
  auto fitted = fit_channel(context.signal, inner, channel.clock, choose_levels(context, inner, channel.clock, most),
                            context.options.effort);
  if (!fitted || !(fitted->swing[0] > 0)) return std::nullopt;
  return RefinedChannel{std::move(*fitted), std::move(chips->levels), chips->first};
}

std::vector<ResidualWindow> residual_windows(std::span<const double> left, const ChannelEstimate& channel) {
  const double length = kWindowChips * channel.clock.rows_per_chip + channel.clock.exposure_rows;
  std::vector<ResidualWindow> windows;
  const std::size_t size = std::min(static_cast<std::size_t>(length), channel.rows.size());
  for (std::size_t begin = channel.rows.begin; begin + size <= channel.rows.end;
       begin += std::max<std::size_t>(size / 2, 1)) {
    double squares = 0, changes = 0;
    for (std::size_t n = begin; n < begin + size; ++n) {
      squares += left[n] * left[n];
      if (n > begin) changes += 0.5 * (left[n] - left[n - 1]) * (left[n] - left[n - 1]);
    }
    const auto count = static_cast<double>(size);
    windows.push_back(
        {{begin, begin + size}, std::sqrt(squares / count), std::sqrt(changes / std::max(count - 1, 1.0))});
  }
  return windows;
}

bool is_even(std::span<const ResidualWindow> windows, const ChipClock& clock) {
  if (windows.empty()) return true;
  const double lowest = std::ranges::min_element(windows, {}, &ResidualWindow::left)->left;
  const bool tells_noise = std::max(clock.exposure_rows, clock.rows_per_chip) >= kSmoothRows;
  return std::ranges::all_of(windows, [&](const ResidualWindow& window) {
    const double by_chance = kEvenErrors / std::sqrt(2 * static_cast<double>(window.rows.size()));
    return window.left <= (kEven + by_chance) * std::max(lowest, tells_noise ? window.as_noise : 0.0);
  });
}

double closeness(const ChannelEstimate& channel, std::size_t frame_rows) {
  const ChipClock& clock = channel.clock;
  const double swing = channel.swing_at(0.5 * static_cast<double>(frame_rows), frame_rows);
  const double distance = closest_pair_distance(clock.rows_per_chip, std::max(clock.exposure_rows, kShortestExposure));
  return 0.5 * distance * swing / std::max(channel.noise, 1e-300);
}

namespace {

// Standard error of the clock at the farther end of the rows, chips.
double end_error(const ChannelEstimate& channel, RowRange range) {
  const double begin = static_cast<double>(range.begin), end = static_cast<double>(range.end);
  const double error = std::max(channel.errors.phase_std(chip_at(begin, channel.clock)),
                                channel.errors.phase_std(chip_at(end, channel.clock)));
  return error / channel.clock.rows_per_chip;
}

// The clock with a rate that moves the ends of the rows by `chips`, if they lie about the chips of the fit.
ChannelEstimate with_rate_moved(ChannelEstimate channel, RowRange range, double chips) {
  ChipClock& clock = channel.clock;
  const auto middle = static_cast<double>(channel.errors.chip);
  const double reach = 0.5 * static_cast<double>(range.size()) / clock.rows_per_chip;
  const double change = chips * clock.rows_per_chip / reach;
  clock.rows_per_chip += change;
  clock.phase -= middle * change;
  return channel;
}

ChannelEstimate with_exposure_moved(ChannelEstimate channel, double rows) {
  channel.clock.exposure_rows = std::max(channel.clock.exposure_rows + rows, kShortestExposure);
  return channel;
}

// The best of several iterations by residual: where the clock is uncertain at the ends of the rows, also with a higher
// and a lower rate; where the exposure is uncertain, also with a longer and a shorter one.
std::optional<RefinedChannel> iterate_best(const IterationContext& context, const ChannelEstimate& channel,
                                           RowRange range) {
  auto best = iterate(context, channel, range);
  const double error = end_error(channel, range);
  if (!(error > kCertainPhase)) return best;
  const double exposure_error = channel.errors.exposure_rows_std() / channel.clock.rows_per_chip;
  const double rate_move = std::min(kMovedErrors * error, kMaxMove);
  const double exposure_move = 4 * exposure_error * channel.clock.rows_per_chip;
  for (const double longer : {0.0, 1.0, -1.0}) {
    if (longer != 0 && (context.options.exposure_known || !(exposure_error > kCertainExposure))) continue;
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

// Channel of the part of the frame with the smallest residual, for a restart.
std::optional<ChannelEstimate> channel_of_best_part(const IterationContext& context, const RefinedChannel& found,
                                                    std::span<const ResidualWindow> windows) {
  const ChipClock& clock = found.channel.clock;
  const RowRange rows = std::ranges::min_element(windows, {}, &ResidualWindow::left)->rows;
  const double half = 0.5 * clock.exposure_rows;
  const std::ptrdiff_t first = std::max(chip_at(static_cast<double>(rows.begin) - half, clock), found.first);
  const std::ptrdiff_t last = std::min(chip_at(static_cast<double>(rows.end) + half, clock),
                                       found.first + static_cast<std::ptrdiff_t>(found.chips.size()) - 1);
  if (last <= first) return std::nullopt;
  const std::span<const double> part(found.chips.data() + (first - found.first),
                                     static_cast<std::size_t>(last - first + 1));
  return fit_channel(context.signal, {part, first}, clock, {1, 0, context.options.exposure_known});
}

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

std::optional<RefinedChannel> grow(const IterationContext& context, const ChannelEstimate& start, double min_growth) {
  RefinedChannel now{start, {}};
  const double max_growth = context.options.warped ? kMaxWarpedGrowth : kMaxGrowth;
  std::vector<double> even_rows;
  IterationContext even = context;
  int settling = 0;
  for (int round = 0; round < kManyIterations && settling < kWholeRounds && !now.settled; ++round) {
    const RowRange range = grown(now.channel, context.signal.size(), min_growth, max_growth);
    if (context.options.warped) even.signal = even_rows = unwarped(context.signal, now.warp);
    auto next = iterate_best(even, now.channel, range);
    if (!next) return std::nullopt;
    const bool whole = range.size() == context.signal.size();
    settling += whole;
    next->settled = whole && next->first == now.first && next->chips == now.chips;
    if (context.options.warped) {
      next->warp = fit_warp(even_rows, now.warp, {next->chips, next->first}, next->channel);
      set_rate(start.clock.rows_per_chip, next->warp, next->channel.clock);
    }
    now = std::move(*next);
  }
  return settling > 0 ? std::optional(std::move(now)) : std::nullopt;
}

}  // namespace

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

namespace {

// The rows extended on either side; at an end of the frame, on the other side instead.
RowRange longer(RowRange rows, std::size_t frame_rows) {
  const auto size = std::min(
      static_cast<std::size_t>(std::ceil(kGrowths.front() * static_cast<double>(rows.size()))) + 1, frame_rows);
  const std::size_t before = std::min((size - rows.size()) / 2, rows.begin);
  const std::size_t begin = std::min(rows.begin - before, frame_rows - size);
  return {begin, begin + size};
}

// The start, and fits to the known chips (else clocks near the start) with longer and shorter exposures.
std::vector<ChannelEstimate> first_clocks(const IterationContext& context, const ChannelEstimate& start) {
  const RefineOptions& options = context.options;
  std::vector<ChannelEstimate> clocks{start};
  if (options.exposure_known) return clocks;
  for (const double longer : {-1.0, -0.5, 0.5, 1.0}) {
    ChannelEstimate moved = with_exposure_moved(start, longer * start.clock.rows_per_chip);
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
                   std::abs(a.exposure_rows - b.exposure_rows) / a.rows_per_chip}) < kSmallShare;
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

std::optional<RefinedChannel> track_in_parallel(const IterationContext& context, std::vector<ChannelEstimate> clocks,
                                                RowRange rows) {
  const auto clock = most_likely_clock(context, std::move(clocks), rows);
  auto found = clock ? grow(context, *clock, kGrowths.front()) : std::nullopt;
  if (!found) return found;
  const auto left = channel_residual(context.signal, {found->chips, found->first}, found->channel);
  found->even = is_even(residual_windows(left, found->channel), found->channel.clock);
  return found;
}

std::optional<RefinedChannel> refine_channel(std::span<const double> signal, const ChannelEstimate& start,
                                             const DetectChips& detect, const RefineOptions& options) {
  const IterationContext context{signal, detect, options};
  auto found = grow_to_frame(context, start);
  // Step-by-step growth may slip a chip and still seem plausible if the start's clock is uncertain at the frame's ends
  // and chips are easily confused. In that case clocks of other rates are tracked in parallel.
  const bool may_slip =
      end_error(start, {0, signal.size()}) > kUnsureFrame && closeness(start, signal.size()) < kCloseSequences;
  if (options.warped || context.is_used_up() || !may_slip) return found;
  auto other = track_in_parallel(context, first_clocks(context, start), start.rows);
  if (!other || (found && found->channel.noise <= other->channel.noise)) return found;
  return other;
}

}  // namespace ocisac
