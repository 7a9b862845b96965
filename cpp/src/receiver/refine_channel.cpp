#include "ocisac/receiver/refine_channel.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "ocisac/receiver/sequence_detector.hpp"
#include "ocisac/require.hpp"

namespace ocisac {

namespace {

constexpr double kFollowed = 0.25;         // of the rows that told levels: so far beyond them a slope is believed
constexpr double kLeastSwing = 0.1;        // of that in the middle of those rows
constexpr double kSurePhase = 0.08;        // chips; standard error up to which rows are detected
constexpr double kCertainPhase = 0.04;     // chips; with a larger standard error other rates are tried
constexpr double kCertainExposure = 0.06;  // chips; with a larger standard error other exposures are tried
constexpr double kMostExposureMoved = 0.8;
constexpr double kMovedErrors = 1.5, kMostMoved = 0.4;  // standard errors, chips
constexpr double kMostGrowth = 2;
constexpr std::array kGrowths{1.3, 1.2,
                              1.12};  // least growth of the rows from one round to the next, in up to three tries
constexpr double kEven = 1.15, kEvenErrors = 6;  // of the residuals of two parts of the frame; standard errors
constexpr double kSmoothRows = 4;
constexpr double kWindowChips = 30;      // length of such a part, beside the exposure
constexpr double kUnsureFrame = 0.3;     // chips; with a larger standard error at the frame's ends all rates are tried
constexpr double kCloseSequences = 3.5;  // half the distance of the closest pair over the noise
constexpr double kRateStep = 0.3;        // chips at the farther end
constexpr double kMostRateSteps = 20;
constexpr std::size_t kClocksTried = 8;  // further, of those
constexpr int kClockRounds = 4;
constexpr double kExposureMove = 1.5;  // standard errors
constexpr int kMostRounds = 40;
constexpr int kSettlingRounds = 4;     // once all rows are in
constexpr double kLeastNoise = 1e-4;   // of the swing, for the detector
constexpr double kMostChips = 1e6;     // in a frame
constexpr double kSearchChips = 36;    // in the part of the frame searched, beside the exposure
constexpr double kSearchSlack = 0.15;  // chips by which the grid of starts may miss
constexpr int kSearchRounds = 4;
constexpr double kRateErrors = 3, kMostRateError = 0.01;  // standard errors, share
constexpr std::size_t kSearchParts = 3;                   // parts of the frame that are tried
constexpr std::size_t kGuessesTried = 6;                  // of an exposure
constexpr std::size_t kStartsRefined = 10;                // the best of all parts and exposures
constexpr double kStatesPerRow = 64;                      // of the trellis, that take as long as a row of a fit
constexpr double kMostStateChips = 11;                    // with longer exposures not all of the states are looked at
constexpr double kLevelFits = 2;                          // to choose the levels of a turn, in fits of levels and clock
constexpr double kEvenGrowth = 1.8, kUnevenGrowth = 1.3;  // of the residual, from a part to the whole frame

// The channel's levels, held a little beyond the rows that told them.
struct Levels {
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
    return std::max(channel.swing_at(held(row), frame_rows), kLeastSwing * channel.swing_at(middle, frame_rows));
  }
};

struct Chips {
  std::vector<double> levels;
  std::ptrdiff_t first = 0;
  [[nodiscard]] KnownChips known() const { return {levels, first}; }
};

std::ptrdiff_t chip_at(double row, const ChipClock& clock) {
  return static_cast<std::ptrdiff_t>(std::floor((row - clock.phase) / clock.rows_per_chip));
}

void put_known(const KnownChips& known, Chips& chips) {
  for (std::size_t k = 0; k < known.levels.size(); ++k) {
    const std::ptrdiff_t at = known.first + static_cast<std::ptrdiff_t>(k) - chips.first;
    if (at >= 0 && at < static_cast<std::ptrdiff_t>(chips.levels.size()))
      chips.levels[static_cast<std::size_t>(at)] = known.levels[k];
  }
}

// All chips that the rows see.
std::optional<Chips> detect_rows(std::span<const double> signal, const ChannelEstimate& channel, RowRange range,
                                 const DetectChips& detect, const KnownChips& known) {
  const Levels levels{channel, signal.size()};
  double least = std::numeric_limits<double>::infinity();
  std::vector<double> rows;
  for (std::size_t n = range.begin; n < range.end; ++n) {
    const double swing = levels.swing(n);
    least = std::min(least, swing);
    rows.push_back((signal[n] - levels.dark(n)) / swing);
  }
  if (!(least > 0)) return std::nullopt;
  ChipClock clock = channel.clock;
  clock.phase -= static_cast<double>(range.begin);
  const double half = 0.5 * clock.exposure, last_row = static_cast<double>(range.size()) - 1;
  if (!(clock.exposure + last_row < kMostChips * clock.rows_per_chip)) return std::nullopt;
  const std::ptrdiff_t first = chip_at(-half, clock), last = chip_at(last_row + half, clock);
  const double middle = levels.swing((range.begin + range.end) / 2);
  Chips chips{detect({rows, clock, std::max(channel.noise / middle, kLeastNoise), first,
                      static_cast<std::size_t>(last - first + 1)}),
              first};
  put_known(known, chips);
  return chips;
}

// Rows on either side as far as the clock is sure, at least the least growth.
RowRange grown(const ChannelEstimate& channel, std::size_t frame_rows, double least_growth) {
  const ChipClock& clock = channel.clock;
  const double middle = clock.phase + static_cast<double>(channel.errors.chip) * clock.rows_per_chip;
  const auto limit = static_cast<double>(frame_rows);
  const double least = 0.5 * least_growth * static_cast<double>(channel.rows.size()) + clock.rows_per_chip;
  double sure = 0;
  while (sure < limit / clock.rows_per_chip &&
         channel.errors.phase_std(channel.errors.chip + static_cast<std::ptrdiff_t>(sure)) <
             kSurePhase * clock.rows_per_chip)
    sure += 2;
  const double centre = 0.5 * static_cast<double>(channel.rows.begin + channel.rows.end);
  const double most = kMostGrowth / 2 * static_cast<double>(channel.rows.size());
  const double begin = std::min(centre - least, std::max(middle - sure * clock.rows_per_chip, centre - most));
  const double end = std::max(centre + least, std::min(middle + sure * clock.rows_per_chip, centre + most));
  return {static_cast<std::size_t>(std::clamp(begin, 0.0, limit)),
          static_cast<std::size_t>(std::clamp(end, 0.0, limit))};
}

// Degrees of dark and swing: the smallest of Schwarz's criterion at a fixed clock. In a part of the frame at most
// lines.
ChannelModel choose_levels(std::span<const double> signal, const Chips& chips, const ChannelEstimate& channel,
                           const RefineOptions& options, bool most_of_frame) {
  ChannelModel best{0, 0, options.exposure_known};
  double least = std::numeric_limits<double>::infinity();
  const std::size_t highest = most_of_frame ? options.highest_degree : std::min<std::size_t>(options.highest_degree, 1);
  for (std::size_t degree = 0; degree <= highest; ++degree)
    for (const std::size_t swing_degree : {std::size_t{0}, degree}) {
      if (swing_degree == 0 && degree > 1) continue;  // a light that varies takes its surroundings along
      const ChannelModel model{degree, swing_degree, options.exposure_known};
      const auto left = level_squares(signal, chips.known(), channel.clock, model);
      if (!left) return best;
      const auto count = static_cast<double>(left->rows), unknowns = static_cast<double>(degree + swing_degree);
      const double criterion = count * std::log(std::max(left->squares, 1e-300) / count) + unknowns * std::log(count);
      if (criterion < least) {
        least = criterion;
        best = model;
      }
    }
  return best;
}

// Edge chips are seen by a few rows only: those do not count.
Chips without_edges(const Chips& chips) {
  if (chips.levels.size() < 8) return chips;
  return {{chips.levels.begin() + 1, chips.levels.end() - 1}, chips.first + 1};
}

bool same(const Chips& a, const Chips& b) { return a.first == b.first && a.levels == b.levels; }

// Whether there is effort left to detect the rows' chips and to fit levels `fits` times.
bool may_try(const RefineOptions& options, RowRange range, const ChipClock& clock, double fits) {
  if (options.effort == nullptr) return true;
  const double rows = static_cast<double>(range.size());
  const double states = std::exp2(std::min(kMostStateChips, std::ceil(clock.exposure / clock.rows_per_chip)));
  return options.effort->take(rows * (fits + 1) + rows / clock.rows_per_chip * states / kStatesPerRow);
}

// Detection and least squares on a range of rows, once.
struct Turn {
  ChannelEstimate channel;
  Chips chips;
};

std::optional<Turn> take_turn(std::span<const double> signal, const ChannelEstimate& channel, RowRange range,
                              const DetectChips& detect, const RefineOptions& options) {
  if (!may_try(options, range, channel.clock, kLevelFits)) return std::nullopt;
  auto chips = detect_rows(signal, channel, range, detect, options.known);
  if (!chips) return std::nullopt;
  const Chips kept = without_edges(*chips);
  const bool most = range.size() > signal.size() / 2;
  auto fitted = fit_channel(signal, kept.known(), channel.clock, choose_levels(signal, kept, channel, options, most),
                            options.effort);
  if (!fitted) return std::nullopt;
  return Turn{std::move(*fitted), std::move(*chips)};
}

// Standard error of the clock at the farther end of the rows, chips.
double end_error(const ChannelEstimate& channel, RowRange range) {
  const double begin = static_cast<double>(range.begin), end = static_cast<double>(range.end);
  const double error = std::max(channel.errors.phase_std(chip_at(begin, channel.clock)),
                                channel.errors.phase_std(chip_at(end, channel.clock)));
  return error / channel.clock.rows_per_chip;
}

// The clock with a rate that moves the ends of the rows by `chips`.
ChannelEstimate with_rate_moved(ChannelEstimate channel, RowRange range, double chips) {
  ChipClock& clock = channel.clock;
  const auto middle = static_cast<double>(channel.errors.chip);
  const double reach = 0.5 * static_cast<double>(range.size()) / clock.rows_per_chip;
  const double change = chips * clock.rows_per_chip / reach;
  clock.rows_per_chip += change;
  clock.phase -= middle * change;
  return channel;
}

// The clock with a longer or shorter exposure.
ChannelEstimate with_exposure_moved(ChannelEstimate channel, double chips) {
  channel.clock.exposure = std::max(channel.clock.exposure + chips * channel.clock.rows_per_chip, kShortestExposure);
  return channel;
}

// A turn; where the clock is not sure at the ends of the rows, also from a higher and a lower rate, and where the
// exposure is not sure either, from a longer and a shorter one: the one that leaves least.
std::optional<Turn> take_best_turn(std::span<const double> signal, const ChannelEstimate& channel, RowRange range,
                                   const DetectChips& detect, const RefineOptions& options) {
  auto best = take_turn(signal, channel, range, detect, options);
  const double error = end_error(channel, range);
  if (!(error > kCertainPhase)) return best;
  const double exposure_error = channel.errors.exposure_std() / channel.clock.rows_per_chip;
  const double rate_move = std::min(kMovedErrors * error, kMostMoved);
  const double exposure_move =
      exposure_error > kCertainExposure ? std::min(4 * exposure_error, kMostExposureMoved) : 0.0;
  for (const double longer : {0.0, 1.0, -1.0}) {
    if (longer != 0 && (options.exposure_known || exposure_move == 0)) continue;
    for (const double faster : {0.0, -1.0, 1.0}) {
      if (longer == 0 && faster == 0) continue;  // taken
      const ChannelEstimate moved =
          with_exposure_moved(with_rate_moved(channel, range, faster * rate_move), longer * exposure_move);
      if (!(moved.clock.rows_per_chip > 0.5 * channel.clock.rows_per_chip)) continue;  // of a frame of a few rows
      auto other = take_turn(signal, moved, range, detect, options);
      if (other && other->channel.swing[0] > 0 && (!best || other->channel.noise < best->channel.noise))
        best = std::move(other);
    }
  }
  return best;
}

}  // namespace

namespace {

std::optional<RefinedChannel> grow(std::span<const double> signal, const ChannelEstimate& start,
                                   const DetectChips& detect, const RefineOptions& options, double least_growth) {
  ChannelEstimate channel = start;
  Chips last;
  int settling = 0;
  bool settled = false;
  for (int round = 0; round < kMostRounds && settling < kSettlingRounds && !settled; ++round) {
    const RowRange range = grown(channel, signal.size(), least_growth);
    auto turn = take_best_turn(signal, channel, range, detect, options);
    if (!turn || !(turn->channel.swing[0] > 0)) return std::nullopt;
    const bool whole = range.begin == 0 && range.end == signal.size();
    settling += whole;
    settled = whole && same(turn->chips, last);
    channel = std::move(turn->channel);
    last = std::move(turn->chips);
  }
  if (settling == 0) return std::nullopt;
  return RefinedChannel{std::move(channel), std::move(last.levels), last.first, settled};
}

// Root mean square of what the channel leaves of the rows it used, over windows of `length` rows, half overlapping; and
// of what of that changes from row to row as noise does.
struct Window {
  RowRange rows;
  double left, as_noise;
};

std::vector<Window> residual_windows(std::span<const double> signal, const RefinedChannel& found, std::size_t length) {
  const ChannelEstimate& channel = found.channel;
  std::vector<double> left(signal.size());
  expose_chips({found.chips, found.first}, channel.clock, left);
  for (std::size_t n = 0; n < left.size(); ++n) {
    const auto row = static_cast<double>(n);
    left[n] = signal[n] - channel.dark_at(row, signal.size()) - channel.swing_at(row, signal.size()) * left[n];
  }
  std::vector<Window> windows;
  const std::size_t size = std::min(length, channel.rows.size());
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

// The clock lost in a part of the frame leaves more there than elsewhere. So does more noise (of more light, say);
// where chips or exposures are several rows long, wrong chips leave what hardly changes from row to row, and noise
// does.
bool is_even(std::span<const Window> windows, const ChipClock& clock) {
  if (windows.empty()) return true;
  const double least = std::ranges::min_element(windows, {}, &Window::left)->left;
  const bool tells_noise = std::max(clock.exposure, clock.rows_per_chip) >= kSmoothRows;
  return std::ranges::all_of(windows, [&](const Window& window) {
    const double by_chance = kEvenErrors / std::sqrt(2 * static_cast<double>(window.rows.size()));
    return window.left <= (kEven + by_chance) * std::max(least, tells_noise ? window.as_noise : 0.0);
  });
}

// The channel of the part of the frame that is explained best, to begin from again.
std::optional<ChannelEstimate> channel_of_best_part(std::span<const double> signal, const RefinedChannel& found,
                                                    std::span<const Window> windows, const RefineOptions& options) {
  const ChipClock& clock = found.channel.clock;
  const RowRange rows = std::ranges::min_element(windows, {}, &Window::left)->rows;
  const double half = 0.5 * clock.exposure;
  const std::ptrdiff_t first = std::max(chip_at(static_cast<double>(rows.begin) - half, clock), found.first);
  const std::ptrdiff_t last = std::min(chip_at(static_cast<double>(rows.end) + half, clock),
                                       found.first + static_cast<std::ptrdiff_t>(found.chips.size()) - 1);
  if (last <= first) return std::nullopt;
  const std::span<const double> part(found.chips.data() + (first - found.first),
                                     static_cast<std::size_t>(last - first + 1));
  return fit_channel(signal, {part, first}, clock, {1, 0, options.exposure_known});
}

}  // namespace

namespace {

bool is_used_up(const RefineOptions& options) { return options.effort != nullptr && !(options.effort->rows > 0); }

// Whether the clock may slip a chip unseen: not sure at the frame's ends, and chips easily taken for others.
bool may_slip(const ChannelEstimate& start, std::size_t rows) {
  const ChipClock& clock = start.clock;
  const double noise = start.noise / std::max(start.swing_at(0.5 * static_cast<double>(rows), rows), 1e-300);
  return end_error(start, {0, rows}) > kUnsureFrame &&
         closest_pair_distance(clock.rows_per_chip, std::max(clock.exposure, kShortestExposure)) <
             2 * kCloseSequences * noise;
}

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

// Of a start whose clock is not sure at the frame's ends, the clock near it whose chips of the whole frame leave least.
// What is grown step by step may have slipped a chip and be plausible all the same.
std::optional<ChannelEstimate> likeliest_clock(std::span<const double> signal, const ChannelEstimate& start,
                                               const DetectChips& detect, const RefineOptions& options) {
  const auto turned = [&](const ChannelEstimate& channel) -> std::optional<ChannelEstimate> {
    auto turn = take_turn(signal, channel, {0, signal.size()}, detect, options);
    if (!turn || !(turn->channel.swing[0] > 0)) return std::nullopt;
    return std::move(turn->channel);
  };
  std::vector<ChannelEstimate> found;
  for (const auto& channel : start_grid(start, signal.size(), options.exposure_known)) {
    if (is_used_up(options)) break;
    if (auto next = turned(channel)) found.push_back(std::move(*next));
  }
  std::ranges::stable_sort(found, {}, &ChannelEstimate::noise);
  found.resize(std::min(found.size(), kClocksTried));
  std::optional<ChannelEstimate> best;
  for (auto& channel : found)
    for (int round = 0; round < kClockRounds; ++round) {
      if (!best || channel.noise < best->noise) best = channel;
      if (is_used_up(options)) break;
      auto next = turned(channel);
      if (!next || !(next->noise < channel.noise)) break;
      channel = std::move(*next);
    }
  return best;
}

}  // namespace

std::optional<RefinedChannel> refine_channel(std::span<const double> signal, const ChannelEstimate& start,
                                             const DetectChips& detect, const RefineOptions& options) {
  std::optional<RefinedChannel> best;
  std::optional<ChannelEstimate> from = start;
  for (const double growth : kGrowths) {
    auto tried = from ? grow(signal, *from, detect, options, growth) : std::nullopt;
    if (tried && (!best || tried->channel.noise < best->channel.noise)) best = std::move(tried);
    if (!best) continue;
    const ChipClock& clock = best->channel.clock;
    const double length = kWindowChips * clock.rows_per_chip + clock.exposure;
    const auto windows = residual_windows(signal, *best, static_cast<std::size_t>(length));
    best->even = is_even(windows, clock);
    if (best->settled && best->even) break;
    from = channel_of_best_part(signal, *best, windows, options);
  }
  if (is_used_up(options) || !may_slip(start, signal.size())) return best;
  if (const auto other = likeliest_clock(signal, start, detect, options)) {
    auto tried = grow(signal, *other, detect, options, kGrowths.front());
    if (tried && (!best || tried->channel.noise < best->channel.noise)) {
      const ChipClock& clock = tried->channel.clock;
      const double length = kWindowChips * clock.rows_per_chip + clock.exposure;
      tried->even = is_even(residual_windows(signal, *tried, static_cast<std::size_t>(length)), clock);
      best = std::move(tried);
    }
  }
  return best;
}

namespace {

struct Start {
  ChannelEstimate channel;
  double score = std::numeric_limits<double>::infinity();  // residual over swing
};

// The darkest and the brightest rows of a part as the levels to begin with: an exposure of several chips seldom sees
// only bright ones, so the swing is taken from the rows' variance where that says more.
std::pair<double, double> first_levels(std::span<const double> part, double exposure_chips) {
  double mean = 0, square = 0;
  for (double value : part) mean += value / static_cast<double>(part.size());
  for (double value : part) square += (value - mean) * (value - mean) / static_cast<double>(part.size());
  // Variance of the mean of L random chips: 1/(4L) for whole ones, less what one chip's ramps take.
  const double shrink = exposure_chips < 1 ? 1 - exposure_chips / 3 : (1 - 1 / (3 * exposure_chips)) / exposure_chips;
  const double swing = 2 * std::sqrt(square / std::max(shrink, 1e-3));
  return {mean - 0.5 * swing, swing};
}

std::vector<RowRange> search_parts(std::span<const double> signal, double length) {
  const auto size = std::min(static_cast<std::size_t>(length), signal.size());
  std::vector<std::pair<double, RowRange>> parts;
  for (std::size_t begin = 0; begin + size <= signal.size(); begin += std::max<std::size_t>(size / 2, 1)) {
    double change = 0;
    for (std::size_t n = begin + 1; n < begin + size; ++n) change += std::pow(signal[n] - signal[n - 1], 2);
    parts.push_back({-change, {begin, begin + size}});
  }
  std::ranges::stable_sort(parts, {}, [](const auto& part) { return part.first; });
  std::vector<RowRange> best;
  for (const auto& part : parts)
    if (best.size() < kSearchParts) best.push_back(part.second);
  return best;
}

std::optional<Start> try_start(std::span<const double> signal, RowRange part, const ChipClock& clock,
                               const DetectChips& detect, const RefineOptions& options) {
  const auto [dark, swing] =
      first_levels(signal.subspan(part.begin, part.size()), clock.exposure / clock.rows_per_chip);
  if (!(swing > 0)) return std::nullopt;
  ChannelEstimate channel{clock, {}, {dark}, {swing}, 0.05 * swing, part, false};
  Start best;
  for (int round = 0; round < kSearchRounds; ++round) {
    auto turn = take_turn(signal, channel, part, detect, options);
    if (!turn || !(turn->channel.swing[0] > 0)) break;
    channel = std::move(turn->channel);
    const double score = channel.noise / channel.swing[0];
    if (!(score < 0.999 * best.score)) break;
    best = {channel, score};
  }
  if (!std::isfinite(best.score)) return std::nullopt;
  return best;
}

// A start with the chips detected there, by what the levels that suit them leave; without a fit of the clock.
struct Guess {
  ChipClock clock;
  RowRange part;
  double score;
};

std::optional<Guess> guess(std::span<const double> signal, RowRange part, const ChipClock& clock,
                           const DetectChips& detect, const RefineOptions& options) {
  if (!may_try(options, part, clock, 1)) return std::nullopt;
  const auto [dark, swing] =
      first_levels(signal.subspan(part.begin, part.size()), clock.exposure / clock.rows_per_chip);
  if (!(swing > 0)) return std::nullopt;
  const ChannelEstimate channel{clock, {}, {dark}, {swing}, 0.05 * swing, part, false};
  const auto chips = detect_rows(signal, channel, part, detect, {});
  if (!chips) return std::nullopt;
  const auto left = level_squares(signal, without_edges(*chips).known(), clock, {1, 0, true});
  if (!left) return std::nullopt;
  return Guess{clock, part, std::sqrt(left->squares / static_cast<double>(left->rows)) / swing};
}

// Over parts of the frame, rates and phases, the best first.
std::vector<Guess> guesses(std::span<const double> signal, const ChannelSearch& search, double exposure,
                           const DetectChips& detect, const RefineOptions& options) {
  const double chips = kSearchChips + exposure / search.rows_per_chip;
  const double rates = std::ceil(std::max(0.5 * chips * search.tolerance / kSearchSlack, 1.0));
  const double phases = std::ceil(0.5 / kSearchSlack);
  std::vector<Guess> found;
  for (const RowRange& part : search_parts(signal, chips * search.rows_per_chip))
    for (double i = 0; i < rates; ++i)
      for (double j = 0; j < phases; ++j) {
        const double period = search.rows_per_chip * (1 + search.tolerance * ((2 * i + 1) / rates - 1));
        const double middle = 0.5 * static_cast<double>(part.begin + part.end);
        const ChipClock clock{period, middle + (j / phases - std::floor(0.5 * chips)) * period,
                              std::max(exposure, kShortestExposure)};
        if (const auto made = guess(signal, part, clock, detect, options)) found.push_back(*made);
      }
  std::ranges::stable_sort(found, {}, &Guess::score);
  return found;
}

// Beyond the tolerance by more than its error: chips of a frame of a few rows, say, that were explained by another
// rate.
bool is_other_rate(const ChannelEstimate& channel, const ChannelSearch& search) {
  const double off = std::abs(channel.clock.rows_per_chip / search.rows_per_chip - 1);
  const double error = channel.errors.rows_per_chip_std() / search.rows_per_chip;
  return !(off <= search.tolerance + std::min(kRateErrors * error, kMostRateError));
}

std::vector<double> exposures(const ChannelSearch& search) {
  if (search.exposure) return {*search.exposure};
  std::vector<double> result;
  for (double length = 0.5; length <= search.longest_exposure; length += length < 2 ? 0.5 : 1)
    result.push_back(length * search.rows_per_chip);
  return result;
}

}  // namespace

std::optional<RefinedChannel> find_channel(std::span<const double> signal, const ChannelSearch& search,
                                           const DetectChips& detect, const RefineOptions& options) {
  require_positive("rows_per_chip", search.rows_per_chip);
  require(search.tolerance >= 0 && search.tolerance < 0.5, "tolerance", search.tolerance, "0 to 0.5");
  if (search.exposure) require_not_negative("exposure", *search.exposure);
  for (double value : signal) require_finite("signal", value);
  RefineOptions fixed = options;
  fixed.exposure_known = options.exposure_known || search.exposure.has_value();
  std::vector<Start> starts;
  for (double exposure : exposures(search)) {
    const auto guessed = guesses(signal, search, exposure, detect, fixed);
    for (const Guess& made : std::span(guessed).first(std::min(guessed.size(), kGuessesTried)))
      if (auto start = try_start(signal, made.part, made.clock, detect, fixed)) starts.push_back(std::move(*start));
  }
  std::ranges::stable_sort(starts, {}, &Start::score);
  std::optional<RefinedChannel> best;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < std::min(starts.size(), kStartsRefined); ++k) {
    auto refined = refine_channel(signal, starts[k].channel, detect, fixed);
    if (refined && !options.exposure_known && fixed.exposure_known)
      refined = refine_channel(signal, refined->channel, detect, options);
    if (!refined || is_other_rate(refined->channel, search)) continue;
    const double score = refined->channel.noise / refined->channel.swing[0];
    const double growth = refined->even ? kEvenGrowth : kUnevenGrowth;
    const bool sure = refined->settled && score < growth * starts[k].score;
    if (score < least) {
      least = score;
      best = std::move(refined);
    }
    if (sure) break;
  }
  return best;
}

}  // namespace ocisac
