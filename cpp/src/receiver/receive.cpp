#include "ocisac/receiver/receive.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numeric>
#include <utility>

#include "chips/chip_period.hpp"
#include "chips/chip_timing.hpp"
#include "chips/lit_rows.hpp"
#include "columns/contrast_slope.hpp"
#include "columns/lamp_slope.hpp"
#include "columns/moving_mean.hpp"
#include "core/check_interrupt.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/receiver/frame_reading.hpp"
#include "receiver/colour_streams.hpp"
#include "receiver/lamp_rows.hpp"
#include "receiver/rows_of_noise.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr double kLongestChip = 64, kShortestChip = 2;  // rows
constexpr double kRateTolerance = 0.03;
constexpr double kNearlyAll = 0.9;                         // of the runs
constexpr std::size_t kSureBlind = 12, kSureWithRate = 4;  // edges required for a reliable rate, blind or given
constexpr double kWeakPart = 4;                            // signal-to-noise ratio of some chips: 2 % of them are wrong
constexpr std::size_t kPart = 16;                          // chips
constexpr double kMinSnr = 2;                              // noise divided at its median has 1.8
constexpr double kSameLight = 0.9;                         // cosine between the swings of a signal and of a light
constexpr int kMaxShears = 3;
constexpr double kCommon = 0.9;                           // of the expected correlation of a light's columns
constexpr double kDarkShare = 0.25;                       // of a bright chip of the lamp's width there
constexpr std::size_t kMostAtOnce = 4;                    // rows of a group
constexpr double kInterpolated = 0.1;                     // of the second differences of the other rows
constexpr double kLowestTone = 300, kHighestTone = 3000;  // Hz
constexpr double kMinHumCycles = 1, kMinToneCycles = 8;   // in the frame
constexpr int kSquareRounds = 3;
constexpr std::size_t kEnds = 8;                    // of the rows make an end
constexpr double kMinShare = 0.3, kMaxShare = 1.5;  // of the light beside the lamp in its columns
constexpr double kMostNoise = 0.1;                  // of the light's swing, where its own is measured
constexpr double kVaries = 2;                       // times the noise
constexpr double kSharp = 0.5;
constexpr double kBetter = 1.5;  // times the signal-to-noise ratio
constexpr double kSameClock = 0.005,
                 kDiffering = 0.05;  // rows per chip of the colours of one lamp; bits of two streams

// A decoded signal: timing and decisions.
struct Decoded {
  ChipGrid grid;
  SlicedChips detection;
  double rows_per_chip_std = 0;
  bool uneven =
      false;  // edges off the clock: rows that are not read at even times, missing chips, two lights, no chips
  bool slowed = false;  // the rate is that of the edges, a part of the one that was asked for
};

// Prior knowledge about a frame.
struct Search {
  FrequencyRange range;
  std::optional<double> exposure_rows;  // rows
  std::size_t sure_edges;               // minimum number of edges for a reliable rate
  bool among_lamps = false;             // above or below others: it ends between them
};

FrequencyRange search_range(const ReceiveOptions& options, const Camera& camera, std::size_t rows) {
  if (options.chip_rate) {
    const double frequency = *options.chip_rate * camera.row_time;
    require(frequency <= 1 / kShortestChip, "chip_rate", *options.chip_rate,
            "at most half the row rate: a chip of two rows or more");
    return {(1 - kRateTolerance) * frequency, std::min((1 + kRateTolerance) * frequency, 1 / kShortestChip)};
  }
  return {std::max(1 / kLongestChip, 4 / static_cast<double>(rows)), 1 / kShortestChip};
}

// 1 / variance of the relative levels about ±1 (the threshold is 0).
double snr_of(std::span<const double> relative_levels) {
  double variance = 0;
  std::size_t count = 0;
  for (double value : relative_levels) {
    if (value == 0) continue;  // in rows that are not lit
    variance += std::pow(std::abs(value) - 1, 2);
    ++count;
  }
  variance /= static_cast<double>(std::max<std::size_t>(count, 1));
  return std::min(1 / std::max(variance, 1e-300), kMaxSnr);
}

// The same of the worst part of the lit chips.
double snr_of_weakest_part(std::span<const double> relative_levels) {
  std::vector<double> lit;
  std::ranges::copy_if(relative_levels, std::back_inserter(lit), [](double level) { return level != 0; });
  double weakest = kMaxSnr;
  for (std::size_t begin = 0; begin + kPart <= lit.size(); ++begin)
    weakest = std::min(weakest, snr_of(std::span(lit).subspan(begin, kPart)));
  return weakest;
}

// State of the light between edges, sampled at each chip's centre.
std::vector<std::uint8_t> bits_between(const Edges& edges, const ChipGrid& grid) {
  std::vector<std::uint8_t> bits(grid.count);
  std::size_t next = 0;
  for (std::size_t chip = 0; chip < grid.count; ++chip) {
    while (next < edges.rows.size() && edges.rows[next] < grid.centre(chip)) ++next;
    bits[chip] = next > 0 ? edges.rising[next - 1] : static_cast<std::uint8_t>(!edges.rising[0]);
  }
  return bits;
}

// Rows at which the signal crosses the mean level at every change of bit, and the index of the chip that begins there.
std::pair<Edges, std::vector<double>> edges_of(std::span<const double> signal, const ChipGrid& grid,
                                               const SlicedChips& seen) {
  std::pair<Edges, std::vector<double>> result;
  for (std::size_t k = 0; k + 1 < grid.count; ++k) {
    if (seen.bits[k] == seen.bits[k + 1]) continue;
    const bool up = seen.bits[k + 1] != 0;
    const double level = 0.25 * (seen.bright[k] + seen.dark[k] + seen.bright[k + 1] + seen.dark[k + 1]);
    const auto low = static_cast<std::size_t>(std::max(std::floor(grid.centre(k)), 0.0));
    const auto high = std::min(static_cast<std::size_t>(std::ceil(grid.centre(k + 1))), signal.size() - 1);
    if ((signal[low] > level) == up || (signal[high] > level) != up) continue;
    result.first.rows.push_back(crossing(signal, low, high, level));
    result.first.rising.push_back(up);
    result.second.push_back(static_cast<double>(grid.first + static_cast<std::ptrdiff_t>(k) + 1));
  }
  return result;
}

// Bits of one grid mapped to another on nearly the same lattice; the nearest bit beyond its ends.
std::vector<std::uint8_t> carried_over(std::span<const std::uint8_t> bits, const ChipGrid& from, const ChipGrid& to) {
  std::vector<std::uint8_t> carried(to.count);
  const auto last = static_cast<std::ptrdiff_t>(bits.size()) - 1;
  for (std::size_t k = 0; k < to.count; ++k) {
    const std::ptrdiff_t chip = to.first + static_cast<std::ptrdiff_t>(k) - from.first;
    carried[k] = bits[static_cast<std::size_t>(std::clamp(chip, std::ptrdiff_t{0}, last))];
  }
  return carried;
}

// Detects, refits the lattice to the edges at the detected levels, and detects again.
std::optional<Decoded> detect_and_refine(std::span<const double> signal, const ChipTiming& timing,
                                         std::optional<double> exposure_rows) {
  Decoded decoded{whole_chips(timing.lattice.clock, signal.size()), {}, timing.lattice.rows_per_chip_std};
  auto detected = slice(signal, decoded.grid, exposure_rows, bits_between(timing.edges, decoded.grid));
  if (!detected) return std::nullopt;
  decoded.detection = std::move(*detected);
  const auto [edges, chips] = edges_of(signal, decoded.grid, decoded.detection);
  const auto lattice = fit_lattice(edges, chips);
  if (!lattice) return decoded;
  const ChipGrid refined = whole_chips(lattice->clock, signal.size());
  detected = slice(signal, refined, exposure_rows, carried_over(decoded.detection.bits, decoded.grid, refined));
  if (detected) decoded = {refined, std::move(*detected), lattice->rows_per_chip_std};
  decoded.uneven = wanders(edges, *lattice);
  return decoded;
}

// If nearly all runs between the first and the last edge, which may be the lamp's ends, are multiples of n > 1 chips,
// the true chips are n times as long, whatever rate was given: single edges, of defects or of another lamp, do not lie
// on their lattice. Every second run of random chips and of a line code is odd at least. Absent where n is 1 or there
// are too few edges.
std::optional<ChipTiming> slower_timing(const Decoded& decoded, const ChipTiming& timing) {
  std::vector<std::size_t> edges;
  const auto& bits = decoded.detection.bits;
  for (std::size_t k = 1; k < bits.size(); ++k)
    if (bits[k] != bits[k - 1]) edges.push_back(k);
  if (edges.size() < 2 * kSureWithRate) return std::nullopt;
  const auto is_shared = [&](std::size_t chips) {
    std::size_t multiples = 0;
    for (std::size_t k = 2; k + 1 < edges.size(); ++k) multiples += (edges[k] - edges[k - 1]) % chips == 0;
    return static_cast<double>(multiples) >= kNearlyAll * static_cast<double>(edges.size() - 3);
  };
  const double chip = decoded.grid.clock.rows_per_chip;
  auto shared = static_cast<std::size_t>(kLongestChip / chip);
  while (shared > 1 && !is_shared(shared)) --shared;
  if (shared < 2) return std::nullopt;
  std::vector<std::size_t> places(shared);
  for (const std::size_t edge : edges) ++places[edge % shared];
  const auto place = std::ranges::max_element(places) - places.begin();
  ChipTiming slower = timing;
  slower.lattice.clock.rows_per_chip = static_cast<double>(shared) * chip;
  slower.lattice.clock.phase = decoded.grid.start(static_cast<std::size_t>(place));
  slower.lattice.rows_per_chip_std = static_cast<double>(shared) * decoded.rows_per_chip_std;
  return slower;
}

// The chips of a lamp whose end lies within the frame, `rows` high, end with a bright one: a dark chip beyond it looks
// like no lamp.
Decoded within(Decoded all, const RowRange& lit, std::size_t rows) {
  SlicedChips& seen = all.detection;
  const auto is_seen = [&](std::size_t chip, bool ends) {
    const double row = all.grid.centre(chip);
    return row >= static_cast<double>(lit.begin) - 0.5 && row <= static_cast<double>(lit.end) - 0.5 &&
           (!ends || seen.bits[chip] != 0);
  };
  std::size_t first = 0, end = all.grid.count;
  while (first < end && !is_seen(first, lit.begin > 0)) ++first;
  while (end > first && !is_seen(end - 1, lit.end < rows)) --end;
  const auto cut = [&](auto& values) {
    values.erase(values.begin() + static_cast<std::ptrdiff_t>(end), values.end());
    values.erase(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(first));
  };
  cut(seen.bits), cut(seen.dark), cut(seen.bright), cut(seen.relative_levels);
  all.grid.first += static_cast<std::ptrdiff_t>(first);
  all.grid.count = end - first;
  return all;
}

// Chips of all rows: those without lit rows are compared with the nearest levels and get a relative level of 0.
Decoded spread_over(std::span<const double> signal, Decoded lit) {
  const ChipGrid whole = whole_chips(lit.grid.clock, signal.size());
  if (whole.first == lit.grid.first && whole.count == lit.grid.count) return lit;
  Decoded spread{whole, {}, lit.rows_per_chip_std, lit.uneven, lit.slowed};
  const auto last = static_cast<std::ptrdiff_t>(lit.grid.count) - 1;
  for (std::size_t k = 0; k < whole.count; ++k) {
    const std::ptrdiff_t at = whole.first + static_cast<std::ptrdiff_t>(k) - lit.grid.first;
    const auto nearest = static_cast<std::size_t>(std::clamp(at, std::ptrdiff_t{0}, last));
    const SlicedChips& seen = lit.detection;
    const auto row = static_cast<std::size_t>(std::clamp(whole.centre(k), 0.0, static_cast<double>(signal.size() - 1)));
    const bool is_lit = at >= 0 && at <= last;
    const bool bright = signal[row] > 0.5 * (seen.dark[nearest] + seen.bright[nearest]);
    spread.detection.bits.push_back(is_lit ? seen.bits[nearest] : static_cast<std::uint8_t>(bright));
    spread.detection.dark.push_back(seen.dark[nearest]);
    spread.detection.bright.push_back(seen.bright[nearest]);
    spread.detection.relative_levels.push_back(is_lit ? seen.relative_levels[nearest] : 0.0);
  }
  return spread;
}

ChipGrid grid_of(const Received& received) {
  return {{received.rows_per_chip, received.phase}, 0, received.bits.size()};
}

// Rows of the chips, of a frame of so many.
RowRange rows_of(const Received& received, std::size_t rows) {
  const auto most = static_cast<double>(rows), chips = static_cast<double>(received.bits.size());
  const double begin = std::clamp(received.phase, 0.0, most),
               end = std::clamp(received.phase + chips * received.rows_per_chip, begin, most);
  return {static_cast<std::size_t>(begin), static_cast<std::size_t>(end)};
}

// Signal-to-noise ratio of the chips, and whether some are weak.
void rate_chips(Received& received) {
  received.snr = snr_of(received.detection.relative_levels);
  received.flags &= ~flag::weak;
  if (received.snr < kWeakSnr || snr_of_weakest_part(received.detection.relative_levels) < kWeakPart)
    received.flags |= flag::weak;
}

void fill(Received& received, Decoded decoded, std::optional<double> exposure_rows) {
  for (auto bit : decoded.detection.bits) received.bits += bit ? '1' : '0';
  received.rows_per_chip = decoded.grid.clock.rows_per_chip;
  received.rows_per_chip_std = decoded.rows_per_chip_std;
  received.phase = decoded.grid.start(0);
  received.detection = std::move(decoded.detection);
  rate_chips(received);
  if (decoded.uneven) received.flags |= flag::model_misfit;
  if (chip_period(received.detection.bits)) received.flags |= flag::periodic;
  if (exposure_rows && *exposure_rows > kLongestSliced * received.rows_per_chip) received.flags |= flag::long_exposure;
}

// Chip timing of the lit rows, relative to row `begin`.
TimingSearch find_lit_timing(const CombinedColumn& column, RowRange lit, std::size_t begin, FrequencyRange range) {
  const std::size_t first = lit.begin > 0 ? lit.begin + 1 : 0;
  const std::size_t last = lit.end < column.signal.size() ? lit.end - 1 : lit.end;
  if (last < first + 2) return {};
  auto search = find_chip_timing(std::span(column.signal).subspan(first, last - first), column.noise, range);
  if (!search.timing) return search;
  const double moved = static_cast<double>(first) - static_cast<double>(begin);
  search.timing->lattice.clock.phase += moved;
  for (double& row : search.timing->edges.rows) row += moved;
  return search;
}

// Every second row is the mean of its neighbours: a colour of a mosaic, whose own rows are half of them.
bool is_interpolated(std::span<const double> signal) {
  std::array<double, 2> squares{};
  for (std::size_t n = 1; n + 1 < signal.size(); ++n)
    squares[n % 2] += std::pow(signal[n] - 0.5 * (signal[n - 1] + signal[n + 1]), 2);
  return std::min(squares[0], squares[1]) < kInterpolated * std::max(squares[0], squares[1]);
}

// Rows of a group are equal, as of those that are read at once, though an exposure of more than a row would show an
// edge in two rows at least: chips of less than two groups are not resolved. Of the squared changes between groups,
// light that is exposed for E rows leaves (E - 1)^2 within them or more, of rows that are read one after another; half
// of it counts.
bool is_read_in_groups(std::span<const double> signal, const ChipClock& clock, std::optional<double> exposure_rows) {
  const double least = 0.5 * std::pow(std::clamp(exposure_rows.value_or(0.0) - 1, 0.0, 0.5), 2);
  for (std::size_t rows = kMostAtOnce; rows > 1 && clock.rows_per_chip < 2 * static_cast<double>(rows); --rows) {
    std::array<double, kMostAtOnce> squares{};
    for (std::size_t n = 1; n < signal.size(); ++n) squares[n % rows] += std::pow(signal[n] - signal[n - 1], 2);
    const double between = *std::ranges::max_element(squares),
                 all = std::accumulate(squares.begin(), squares.end(), 0.0);
    if (all - between < least * between) return true;
  }
  return false;
}

// Changes of chips in lit rows.
std::size_t changes_of(const SlicedChips& seen) {
  std::size_t changes = 0;
  for (std::size_t k = 1; k < seen.bits.size(); ++k)
    changes += seen.bits[k] != seen.bits[k - 1] && seen.relative_levels[k] != 0 && seen.relative_levels[k - 1] != 0;
  return changes;
}

// Fewer lit rows by two chips or more.
bool is_part(const LitRows& fewer, const LitRows& lit) {
  return fewer.shortest > 0 && fewer.rows.size() + 2 * fewer.shortest <= lit.rows.size();
}

// Standard deviation of bright chips about their level, of that: texture behind the light, and noise.
double texture_of(const SlicedChips& seen) {
  std::vector<double> distances;
  for (std::size_t k = 0; k < seen.bits.size(); ++k)
    if (seen.bits[k] && seen.bright[k] > 0)
      distances.push_back(0.5 * std::abs(seen.relative_levels[k] - 1) * (seen.bright[k] - seen.dark[k]) /
                          seen.bright[k]);
  return distances.empty() ? 0.0 : median(std::move(distances)) / kMedianMagnitude;
}

// The lamp does not fade towards its ends: the outermost lit chips swing by half of the most at least.
bool ends_sharply(const SlicedChips& seen) {
  double first = 0, last = 0, most = 0;
  for (std::size_t k = 0; k < seen.bits.size(); ++k) {
    if (seen.relative_levels[k] == 0) continue;  // not lit
    last = seen.bright[k] - seen.dark[k];
    if (most == 0) first = last;
    most = std::max(most, last);
  }
  return std::min(first, last) > kSharp * most;
}

// Chips of the lit rows. `edges`: those of the light that were found.
std::optional<Decoded> decode_rows(const CombinedColumn& column, const LitRows& lit, const Search& what,
                                   std::size_t& edges) {
  // Chips that end dark show it a chip beyond the last row that stands out.
  const std::size_t begin = lit.rows.begin - std::min(lit.shortest, lit.rows.begin);
  const std::size_t end = std::min(lit.rows.end + lit.shortest, column.signal.size());
  const auto signal = std::span(column.signal).subspan(begin, end - begin);
  const auto search = find_lit_timing(column, lit.rows, begin, what.range);
  edges = search.edges;
  if (!search.timing) return std::nullopt;
  auto decoded = detect_and_refine(signal, *search.timing, what.exposure_rows);
  const auto slower = decoded ? slower_timing(*decoded, *search.timing) : std::nullopt;
  if (slower)
    if (auto again = detect_and_refine(signal, *slower, what.exposure_rows)) {
      decoded = std::move(again);
      decoded->slowed = true;
    }
  if (!decoded || snr_of(decoded->detection.relative_levels) < kMinSnr) return std::nullopt;
  decoded->uneven |= is_read_in_groups(signal, decoded->grid.clock, what.exposure_rows);
  decoded->grid.clock.phase += static_cast<double>(begin);
  auto seen = within(*decoded, lit.rows, column.signal.size());
  if (seen.grid.count == 0) return std::nullopt;
  // A lamp that does not fade may be idle in the dark rows.
  if (!column.has_sides || (!what.among_lamps && ends_sharply(seen.detection)))
    return spread_over(column.signal, std::move(*decoded));
  return seen;
}

// Decodes one combination of columns; returns success. Otherwise the flags of `received` give the reason.
bool decode(const CombinedColumn& column, const Search& what, Received& received, DarkRows dark = {}) {
  check_interrupt();
  dark.expected = dark.expected || column.has_sides;
  std::size_t edges = 0;
  const RowRange all{0, column.signal.size()};
  const auto lit = lit_rows(column.signal, column.noise, all, dark);
  auto decoded = decode_rows(column, lit, what, edges);
  if (decoded) {
    // Rows beyond the lamp that are no more uneven than its light is.
    const auto fewer =
        lit_rows(column.signal, column.noise, all,
                 {.texture = texture_of(decoded->detection), .most_noise = kMostNoise, .expected = column.has_sides});
    std::size_t of_fewer = 0;
    if (is_part(fewer, lit))
      if (auto within = decode_rows(column, fewer, what, of_fewer); within && ends_sharply(within->detection)) {
        decoded = std::move(within);
        edges = of_fewer;
      }
  }
  const bool few_edges = edges > 0 && edges < what.sure_edges;
  received.weights = column.weights;
  received.flags = flag_if(column.saturated, flag::saturated) | flag_if(few_edges, flag::too_few_edges);
  if (!decoded) {
    if (!few_edges) received.flags |= flag::no_signal;
    if (what.exposure_rows.value_or(0.0) * what.range.lowest > kLongestSliced) received.flags |= flag::long_exposure;
    return false;
  }
  // Edges of noise may outnumber those of the light.
  if (changes_of(decoded->detection) < (decoded->slowed ? kSureBlind : what.sure_edges))
    received.flags |= flag::too_few_edges;
  fill(received, std::move(*decoded), what.exposure_rows);
  return true;
}

StrongestTone other_tone(std::span<const double> signal, double row_time) {
  return strongest_tone(signal, signal.size(), kLowestTone * row_time, std::min(kHighestTone * row_time, 0.25));
}

std::vector<double> difference(std::span<const double> a, std::span<const double> b) {
  std::vector<double> result(a.begin(), a.end());
  for (std::size_t n = 0; n < result.size(); ++n) result[n] -= b[n];
  return result;
}

// Adds light that was removed before detection: reported levels are those of the pixels.
void add_to_levels(Received& received, std::span<const double> light, std::optional<double> exposure_rows) {
  const ChipGrid grid = grid_of(received);
  const auto values = chip_values(light, grid, exposure_rows);
  for (std::size_t k = 0; k < values.size(); ++k) {
    received.detection.dark[k] += values[k];
    received.detection.bright[k] += values[k];
  }
}

// The light of received chips in each row, with levels that are straight along the rows.
std::optional<std::vector<double>> light_of(const Received& received, std::span<const double> signal,
                                            std::optional<double> exposure_rows) {
  std::vector<double> levels;
  for (const char bit : received.bits) levels.push_back(bit == '1' ? 1.0 : 0.0);
  const ChipClock clock{received.rows_per_chip, received.phase, exposure_rows.value_or(0.0)};
  const auto channel = fit_channel(signal, {levels, 0}, clock, {1, 1, exposure_rows.has_value()});
  if (!channel) return std::nullopt;
  std::vector<double> light(signal.size());
  expose_chips({levels, 0}, channel->clock, light);
  for (std::size_t n = 0; n < light.size(); ++n) {
    const auto row = static_cast<double>(n);
    light[n] = channel->dark_at(row, light.size()) + channel->swing_at(row, light.size()) * light[n];
  }
  return light;
}

// Estimates the square wave beside the received chips, in whose company it was estimated before, and decodes again.
void refine_square(const CombinedColumn& column, const Search& what, double frequency, std::vector<double>& rest,
                   Received& received) {
  for (int round = 0; round < kSquareRounds; ++round) {
    const auto light = light_of(received, rest, what.exposure_rows);
    if (!light) return;
    const auto beside = difference(column.signal, *light);
    CombinedColumn other = column;
    other.signal = difference(
        column.signal, difference(beside, without_square_wave(beside, frequency, what.exposure_rows.value_or(0.0))));
    Received again{.frame = received.frame, .colour = received.colour};
    if (!decode(other, what, again) || !(again.snr > received.snr)) return;
    received = std::move(again);
    rest = std::move(other.signal);
  }
}

double deviation(std::span<const double> values) {
  return std::sqrt(squares_about_mean(values) / static_cast<double>(values.size()));
}

struct Share {
  double share = 0, rest = 0;
};

// Least-squares share of the light beside a lamp in rows of its columns, and the standard deviation of the rest.
Share share_of(std::span<const double> beside, std::span<const double> signal) {
  const auto count = static_cast<double>(signal.size());
  const double mean = mean_of(signal), mean_beside = mean_of(beside);
  double square = 0, product = 0, power = 0;
  for (std::size_t n = 0; n < signal.size(); ++n) {
    const double s = signal[n] - mean, b = beside[n] - mean_beside;
    square += s * s;
    product += s * b;
    power += b * b;
  }
  const double share = power > 0 ? product / power : 0.0;
  return {share, std::sqrt(std::max(square - share * product, 0.0) / count)};
}

// The column without the light that columns beside the lamp show, by its share in rows at an end of the frame, where
// the lamp may not reach. Absent where the lamp does: the share is that of the lamp's own light beside it.
std::optional<CombinedColumn> without_light_beside(const CombinedColumn& column) {
  const std::size_t rows = column.signal.size(), window = rows / kEnds;
  if (column.beside.size() != rows || window < 2) return std::nullopt;
  const std::span beside(column.beside), signal(column.signal);
  const Share first = share_of(beside.first(window), signal.first(window));
  const Share last = share_of(beside.last(window), signal.last(window));
  const auto [share, rest] = first.rest < last.rest ? first : last;
  if (share < kMinShare || share > kMaxShare || share * deviation(beside) < kVaries * rest) return std::nullopt;
  CombinedColumn own = column;
  for (std::size_t n = 0; n < rows; ++n) own.signal[n] -= share * beside[n];
  own.noise = std::fmax(column.noise, rest);
  return own;
}

// Decodes the rows of a lamp that leaves a part of the frame to light beside it, fewer than the `lit` ones; false if it
// stands in all of them.
bool decode_within(const CombinedColumn& column, const LitRows& lit, const Search& what, Received& received) {
  const auto own = without_light_beside(column);
  if (!own) return false;
  const RowRange all{0, own->signal.size()};
  const DarkRows dark{.least_departure = 0, .most_noise = kMostNoise, .expected = true};
  if (!is_part(lit_rows(own->signal, own->noise, all, dark), lit)) return false;
  Received tried{.frame = received.frame, .colour = received.colour};
  if (!decode(*own, what, tried, dark) || !ends_sharply(tried.detection)) return false;
  received = std::move(tried);
  add_to_levels(received, difference(column.signal, own->signal), what.exposure_rows);
  return true;
}

// As decode, but that noise is not searched; without chips, or with weak ones, other light is removed from the rows and
// detection repeated. Steady rows beside a lamp show no other light.
bool decode_any(const CombinedColumn& column, const Search& what, double row_time, Received& received) {
  if (is_noise(column.signal)) {
    received.weights = column.weights;
    received.flags = flag_if(column.saturated, flag::saturated) | flag::no_signal;
    return false;
  }
  const bool decoded = decode(column, what, received);
  const auto lit = lit_rows(column.signal, column.noise);
  if (decode_within(column, lit, what, received)) return true;
  const auto tone = other_tone(column.signal, row_time);
  if (decoded && (received.flags & flag::weak) == 0) return true;
  if (lit.rows.size() < column.signal.size()) return decoded;
  bool better = decoded;
  // `square`: frequency of the square wave that was removed, cycles per row, else 0.
  const auto try_without = [&](std::vector<double> rest, double square) {
    CombinedColumn other = column;
    other.signal = std::move(rest);
    Received tried{.frame = received.frame, .colour = received.colour};
    if (!decode(other, what, tried)) return;
    if (square > 0) refine_square(column, what, square, other.signal, tried);
    if (better && tried.snr < kBetter * received.snr) return;
    received = std::move(tried);
    add_to_levels(received, difference(column.signal, other.signal), what.exposure_rows);
    better = true;
  };
  const auto rows = static_cast<double>(column.signal.size());
  for (const double mains : kMains) {
    if (mains * row_time * rows < kMinHumCycles) continue;
    if (auto fit = remove_nuisance(column.signal, {0, {mains * row_time}})) try_without(std::move(fit->rest), 0);
  }
  if (tone.prominence > kProminent && tone.frequency * rows >= kMinToneCycles)
    try_without(without_square_wave(column.signal, tone.frequency, what.exposure_rows.value_or(0.0)), tone.frequency);
  return better;
}

// The chips of a lamp whose outline is known: where it is narrow, a bright one is as much fainter, and the string ends
// with a chip that is neither, or where the lamp is narrower than a column.
void fit_to_outline(const AnyFramesView& colour, const CombinedColumn& column, const Search& what, Received& received) {
  const SlicedChips seen = received.detection;
  const ChipGrid grid = grid_of(received);
  std::vector<std::size_t> bright;
  for (std::size_t k = 0; k < grid.count; ++k)
    if (seen.bits[k] && seen.relative_levels[k] != 0)
      bright.push_back(static_cast<std::size_t>(std::max(grid.centre(k), 0.0)));
  const auto outline = outline_of(colour, received.frame, column.weights, bright);
  if (!outline) return;
  const ChipGrid all = whole_chips(grid.clock, column.signal.size());
  const auto values = chip_values(column.signal, all, what.exposure_rows);
  const auto is_wide = [&](std::size_t k) { return outline->width(grid.centre(k)) > kSharp * outline->widest; };
  std::size_t first = 0, last = grid.count - 1;
  while (first < last && !is_wide(first)) ++first;
  while (last > first && !is_wide(last)) --last;
  SlicedChips& chips = received.detection;
  chips = {};
  const auto append = [&](std::uint8_t bit, double level, std::size_t like) {
    chips.bits.push_back(bit);
    chips.relative_levels.push_back(level);
    chips.dark.push_back(seen.dark[like]);
    chips.bright.push_back(seen.bright[like]);
  };
  // From the outermost wide chip on, `like` whose levels they are.
  const auto append_beyond = [&](std::size_t like, std::ptrdiff_t step) {
    for (std::ptrdiff_t chip = static_cast<std::ptrdiff_t>(like) + step;; chip += step) {
      const auto at = static_cast<std::size_t>(chip - all.first);
      if (chip < all.first || at >= all.count || outline->width(all.start(step < 0 ? at : at + 1)) < 1) break;
      const double swing =
          (seen.bright[like] - seen.dark[like]) * outline->width(all.centre(at)) / outline->width(grid.centre(like));
      const double share = (values[at] - seen.dark[like]) / swing;
      if (share > kDarkShare && share < kSharp) break;
      append(share >= kSharp, 2 * share - 1, like);
    }
  };
  append_beyond(first, -1);
  const std::size_t before = chips.bits.size();
  for (auto* of_chips : {&chips.dark, &chips.bright, &chips.relative_levels}) std::ranges::reverse(*of_chips);
  std::ranges::reverse(chips.bits);
  for (std::size_t k = first; k <= last; ++k) append(seen.bits[k], seen.relative_levels[k], k);
  append_beyond(last, 1);
  received.bits.clear();
  for (const std::uint8_t bit : chips.bits) received.bits += bit ? '1' : '0';
  received.phase = grid.start(first) - static_cast<double>(before) * received.rows_per_chip;
  rate_chips(received);
}

double product_of(const std::vector<double>& a, const std::vector<double>& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

// Correlation of the changes from chip to chip between two halves of the columns, by weight; 1 for a single column.
double agreement_of_halves(const AnyFramesView& colour, const Received& received, std::optional<double> exposure_rows) {
  const ChipGrid grid = grid_of(received);
  const std::span weights(received.weights);
  std::array<std::vector<double>, 2> changes;
  std::size_t middle = 0;
  for (double before = 0; middle < weights.size() && before + weights[middle] < 0.5; ++middle)
    before += weights[middle];
  for (std::size_t half = 0; half < 2; ++half) {
    const std::size_t begin = half == 0 ? 0 : middle, end = half == 0 ? middle : weights.size();
    const auto rows = std::visit(
        [&](const auto& view) {
          std::vector<double> sums(view.rows, 0.0);
          for (std::size_t n = 0; n < view.rows; ++n)
            for (std::size_t k = begin; k < end; ++k)
              if (weights[k] > 0) sums[n] += weights[k] * static_cast<double>(view(received.frame, n, k));
          return sums;
        },
        colour);
    changes[half] = chip_values(rows, grid, exposure_rows);
    std::adjacent_difference(changes[half].begin(), changes[half].end(), changes[half].begin());
    changes[half].front() = 0;
  }
  const double energy = product_of(changes[0], changes[0]) * product_of(changes[1], changes[1]);
  return energy > 0 ? product_of(changes[0], changes[1]) / std::sqrt(energy) : 1.0;
}

// True if the columns share the chips: all but noise, of which each half has twice that of all, 1/snr of the chips'
// square. A texture has edges of its own in each part, or contrast in its dark or its bright rows alone.
bool is_common(const AnyFramesView& colour, const Received& received, const ToneCurve& curve,
               std::optional<double> exposure_rows) {
  const double expected = 1 / (1 + 2 / received.snr);
  if (!(agreement_of_halves(colour, received, exposure_rows) > kCommon * expected)) return false;
  const auto lit = [](double weight) { return weight != 0; };
  const auto first = std::ranges::find_if(received.weights, lit);
  const auto last = std::find_if(received.weights.rbegin(), received.weights.rend(), lit).base();
  const RowRange rows = rows_of(received, shape_of(colour).rows);
  const Region box{static_cast<std::size_t>(first - received.weights.begin()), rows.begin,
                   static_cast<std::size_t>(last - first), rows.size()};
  return !contrast_slope(colour, received.frame, box, curve).is_of_texture();
}

// One source and its signal; `signal` is empty where decoding failed.
struct Source {
  Received received;
  std::vector<double> signal;
  double slope = 0;                       // of the light that all columns show
  std::vector<CombinedColumn> columns{};  // of each colour; empty where decoding failed
  CombinedColumn best{};                  // of the columns, whether decoded or not
};

// The light of best quality in the `allowed` columns (empty: all).
Source receive_source(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                      const Search& what, std::span<const std::uint8_t> allowed) {
  Received best{.frame = frame};
  CombinedColumn clearest;
  bool first = true;
  for (const bool use_saturated : {false, true}) {
    std::vector<std::pair<CombinedColumn, std::size_t>> columns;
    for (std::size_t colour = 0; colour < colours.size(); ++colour)
      columns.emplace_back(combine_columns(colours[colour], frame, camera.tone_curve, use_saturated, allowed), colour);
    std::ranges::stable_sort(columns, [](const auto& a, const auto& b) {
      const bool half = is_interpolated(a.first.signal), other_half = is_interpolated(b.first.signal);
      return half != other_half ? other_half : a.first.quality > b.first.quality;
    });
    if (first) clearest = columns.front().first;
    for (auto& [column, colour] : columns) {
      if (use_saturated && !column.saturated) continue;  // tried already
      Received received{.frame = frame, .colour = colour};
      if (decode_any(column, what, camera.row_time, received)) {
        if (column.has_sides) fit_to_outline(colours[colour], column, what, received);
        if ((received.flags & ~flag::saturated) == 0 &&
            !is_common(colours[colour], received, camera.tone_curve, what.exposure_rows))
          received.flags |= flag::ambiguous_kind;
        Source source{std::move(received), column.signal, clearest.slope, {}, column};
        std::ranges::sort(columns, {}, [](const auto& one) { return one.second; });
        for (auto& one : columns) source.columns.push_back(std::move(one.first));
        return source;
      }
      if (std::exchange(first, false)) best = std::move(received);
    }
    if (std::ranges::none_of(columns, [](const auto& one) { return one.first.left_out; })) break;
  }
  const double slope = clearest.slope;
  return {std::move(best), {}, slope, {}, std::move(clearest)};
}

// Share of the bits that differ where both have some; 1 where they overlap in less than half of the first.
double differing(const Received& a, const Received& b) {
  const auto moved = static_cast<std::ptrdiff_t>(std::lround((b.phase - a.phase) / a.rows_per_chip));
  std::size_t both = 0, wrong = 0;
  for (std::size_t k = 0; k < b.bits.size(); ++k) {
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(k) + moved;
    if (at < 0 || at >= static_cast<std::ptrdiff_t>(a.bits.size())) continue;
    ++both;
    wrong += a.bits[static_cast<std::size_t>(at)] != b.bits[k];
  }
  return 2 * both < a.bits.size() ? 1.0 : static_cast<double>(wrong) / static_cast<double>(both);
}

// The streams of a source's colours where they differ; the source itself, or its colours added, where they agree.
std::vector<Received> streams_of(const Source& source, std::size_t frame, const Camera& camera, const Search& what) {
  const Received& first = source.received;
  if (source.columns.size() < 2 || first.bits.size() < kMinChipsOfStreams) return {first};
  const ChipGrid grid = grid_of(first);
  std::vector<std::vector<double>> values;
  for (const auto& column : source.columns) values.push_back(chip_values(column.signal, grid, what.exposure_rows));
  const auto streams = colour_streams(values);
  std::vector<Received> found;
  for (const auto& stream : streams) {
    Received one{.frame = frame, .colour = stream.colour, .colour_weights = stream.weights};
    if (!decode_any(sum_of(source.columns, stream), what, camera.row_time, one)) continue;
    const bool same_clock = std::abs(one.rows_per_chip / first.rows_per_chip - 1) < kSameClock;
    bool is_new = (one.flags & ~(flag::saturated | first.flags)) == 0 && same_clock;
    for (const Received& other : found) is_new &= differing(other, one) > kDiffering;
    if (is_new) found.push_back(std::move(one));
  }
  if (streams.size() > 1 && found.size() > 1) {
    std::ranges::stable_sort(found, [](const Received& a, const Received& b) { return a.snr > b.snr; });
    return found;
  }
  const bool is_better = streams.size() == 1 && found.size() == 1 && found[0].snr > kBetter * first.snr &&
                         differing(first, found[0]) < kDiffering;
  return {is_better ? found[0] : first};
}

bool is_clean(const Source& source) {
  return !source.signal.empty() && (source.received.flags & ~flag::saturated) == 0;
}

std::vector<Received> receive_frame(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                                    const Search& what, int shears = 0);

// A frame whose light stands obliquely, sheared upright; empty where its columns agree no better then: the chips of a
// round lamp may lie about an oblique line by chance.
std::vector<Received> receive_upright(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                                      const Search& what, const Source& whole, int shears) {
  std::vector<UprightFrame> upright;
  std::vector<AnyFramesView> views;
  for (const auto& colour : colours) upright.emplace_back(colour, frame, whole.slope);
  for (const auto& colour : upright) views.push_back(colour.view());
  const auto column = combine_columns(views[whole.received.colour], 0, camera.tone_curve);
  if (column.quality < kBetter * whole.best.quality) return {};
  auto sources = receive_frame(views, 0, camera, what, shears);
  for (Received& received : sources) {
    received.frame = frame;
    received.weights = upright.front().own_weights(received.weights);
  }
  return sources;
}

// Lamps above each other, each from the rows around it; none where all rows may be those of one lamp.
std::vector<Received> receive_above(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                                    const Search& what, const CombinedColumn& column, int shears) {
  const auto lamps = rows_of_lamps(column.signal, column.noise);
  if (lamps.size() < 2) return {};
  Search of_lamp = what;
  of_lamp.among_lamps = true;
  std::vector<Received> sources;
  for (const RowRange& rows : lamps) {
    std::vector<AnyFramesView> views;
    for (const auto& colour : colours)
      views.push_back(part_of(colour, {0, rows.begin, shape_of(colour).columns, rows.size()}));
    for (Received& received : receive_frame(views, frame, camera, of_lamp, shears)) {
      if (received.bits.empty()) continue;
      received.phase += static_cast<double>(rows.begin);
      sources.push_back(std::move(received));
    }
  }
  return sources;
}

// Chips on one clock, alike where both lamps are seen.
bool is_one_lamp(const Received& a, const Received& b) {
  const double chips = (b.phase - a.phase) / a.rows_per_chip;
  return std::abs(a.rows_per_chip / b.rows_per_chip - 1) < kSameClock && std::abs(std::remainder(chips, 1.0)) < 0.25 &&
         differing(a, b) < kDiffering;
}

// All lights of a frame, each from columns or rows of its own where there are several; first the one that all columns
// show.
std::vector<Received> receive_frame(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                                    const Search& what, int shears) {
  Source whole = receive_source(colours, frame, camera, what, {});
  if (whole.slope != 0 && shears < kMaxShears)
    if (auto upright = receive_upright(colours, frame, camera, what, whole, shears + 1); !upright.empty())
      return upright;
  auto sources = receive_above(colours, frame, camera, what, whole.best, shears);
  if (sources.size() < 2) {
    sources.clear();
    const auto lights = light_groups(colours[whole.received.colour], frame, camera.tone_curve);
    std::vector<Received> periodic;
    for (const auto& light : lights) {
      const bool seen = is_clean(whole) && agreement(whole.signal, light) >= kSameLight;
      Source source = receive_source(colours, frame, camera, what, light.columns);
      const auto is_same = [&](const Received& other) { return is_one_lamp(other, source.received); };
      const bool is_part = std::ranges::any_of(sources, is_same) || std::ranges::any_of(periodic, is_same);
      if (is_part || source.received.bits.empty()) continue;
      if (is_clean(source))
        sources.insert(seen ? sources.begin() : sources.end(), std::move(source.received));
      else if (seen)
        sources.insert(sources.begin(), whole.received);
      else if ((source.received.flags & flag::periodic) != 0)
        periodic.push_back(std::move(source.received));
    }
    std::ranges::move(periodic, std::back_inserter(sources));
    if (lights.empty()) sources = streams_of(whole, frame, camera, what);
  }
  if (sources.empty()) return {std::move(whole.received)};
  for (std::size_t k = 0; k < sources.size(); ++k) sources[k].source = k;
  return sources;
}

constexpr std::size_t kComparedColumns = 128;  // of a source, evenly spaced, at most

// Changes over a chip of the rows of a source in a frame, by its columns' weights, as stored: slow light cancels.
std::vector<double> changes_of(const AnyFramesView& colour, std::size_t frame, const Received& source) {
  return std::visit(
      [&](const auto& view) {
        std::vector<std::size_t> lit;
        for (std::size_t k = 0; k < source.weights.size(); ++k)
          if (source.weights[k] != 0) lit.push_back(k);
        const std::size_t every = 1 + lit.size() / kComparedColumns;
        const auto lag = static_cast<std::size_t>(std::max(std::round(source.rows_per_chip), 1.0));
        const RowRange seen = rows_of(source, view.rows);
        std::vector<double> rows, changes;
        for (std::size_t n = seen.begin; n < seen.end; ++n) {
          double sum = 0;
          for (std::size_t k = 0; k < lit.size(); k += every)
            sum += source.weights[lit[k]] * static_cast<double>(view(frame, n, lit[k]));
          rows.push_back(sum);
        }
        for (std::size_t n = lag; n < rows.size(); ++n) changes.push_back(rows[n] - rows[n - lag]);
        return changes;
      },
      colour);
}

// True where another frame has the same chips, or explains the rows better than the chips do: a picture
// that stands still, or a light in step with the frames. The chips leave 1/snr of the square of the rows, the other
// frame 1 − r², r: their correlation.
bool stands_still(const AnyFramesView& colour, const Received& source, std::size_t other,
                  std::span<const Received> received) {
  const auto is_same = [&](const Received& one) { return one.frame == other && is_one_lamp(source, one); };
  if (std::ranges::any_of(received, is_same)) return true;
  const auto own = changes_of(colour, source.frame, source), same = changes_of(colour, other, source);
  const double energy = product_of(own, own) * product_of(same, same), common = product_of(own, same);
  return common > 0 && energy - common * common < energy / source.snr;
}

}  // namespace

std::vector<Received> receive(std::span<const AnyFramesView> colours, const Camera& camera,
                              const ReceiveOptions& options) {
  check(camera);
  require(!colours.empty(), "colour", "none", "at least one colour");
  const Shape shape = shape_of(colours.front());
  for (const auto& colour : colours) {
    check(colour);
    const Shape other = shape_of(colour);
    require(other.frames == shape.frames && other.rows == shape.rows && other.columns == shape.columns, "colour",
            "colours of different shapes", "one shape");
  }
  if (options.chip_rate) require_positive("chip_rate", *options.chip_rate);
  Search what{search_range(options, camera, shape.rows), {}, options.chip_rate ? kSureWithRate : kSureBlind};
  if (camera.exposure) what.exposure_rows = *camera.exposure / camera.row_time;
  std::vector<Received> received;
  for (std::size_t frame = 0; frame < shape.frames; ++frame)
    std::ranges::move(receive_frame(colours, frame, camera, what), std::back_inserter(received));
  for (Received& one : received) {
    const std::size_t other = one.frame + 1 < shape.frames ? one.frame + 1 : one.frame - 1;
    if (shape.frames > 1 && !one.bits.empty() && stands_still(colours[one.colour], one, other, received))
      one.flags |= flag::ambiguous_kind;
    if (!one.colour_weights.empty()) continue;
    one.colour_weights.assign(colours.size(), 0.0);
    one.colour_weights[one.colour] = 1;
  }
  return received;
}

std::optional<double> blind_rows_per_chip(const CombinedColumn& column, const Camera& camera) {
  Search what{search_range({}, camera, column.signal.size()), {}, kSureBlind};
  if (camera.exposure) what.exposure_rows = *camera.exposure / camera.row_time;
  Received received;
  return decode(column, what, received) ? std::optional(received.rows_per_chip) : std::nullopt;
}

}  // namespace ocisac
