#include "receiver/column_decoder.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numeric>
#include <utility>

#include "chips/chip_period.hpp"
#include "chips/chip_timing.hpp"
#include "chips/lit_rows.hpp"
#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/chips/preamble.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/receiver/frame_reading.hpp"
#include "receiver/rows_of_noise.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr double kLongestChip = 64, kShortestChip = 2;  // rows
constexpr double kRateTolerance = 0.03;
constexpr std::size_t kFew = 12, kSureWithRate = 4;       // edges: of a part of the given rate, of the rate itself
constexpr double kWeakPart = 4;                           // signal-to-noise ratio of some chips: 2 % of them are wrong
constexpr std::size_t kPart = 16;                         // chips
constexpr double kMinSnr = 2;                             // noise divided at its median has 1.8
constexpr std::size_t kMostAtOnce = 4;                    // rows of a group
constexpr double kLowestTone = 300, kHighestTone = 3000;  // Hz
constexpr double kMinHumCycles = 1, kMinToneCycles = 8;   // in the frame
constexpr std::size_t kEnds = 8;                          // of the rows make an end
constexpr double kMinShare = 0.3, kMaxShare = 1.5;        // of the light beside the lamp in its columns
constexpr double kVaries = 2;                             // times the noise
constexpr double kHalfAtLeast = 0.42;                     // chips: clipped light is late by less

// A decoded signal: timing and decisions.
struct Decoded {
  ChipGrid grid;
  SlicedChips detection;
  double rows_per_chip_std = 0;
  bool uneven =
      false;        // edges off the clock: rows that are not read at even times, missing chips, two lights, no chips
  double lead = 0;  // of its lattice, as of ChipTiming
  bool slowed = false;  // the rate is that of the edges, a part of the one that was asked for
  double late = 0;      // falling edges on the lattice, chips
};

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
    result.first.add(signal, low, high, level);
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
std::optional<Decoded> detect_and_refine(std::span<const double> signal, const ChipLattice& first, const Edges& found,
                                         std::optional<double> exposure_rows) {
  Decoded decoded{whole_chips(first.clock, signal.size()), {}, first.rows_per_chip_std};
  auto detected = slice(signal, decoded.grid, exposure_rows, bits_between(found, decoded.grid));
  if (!detected) return std::nullopt;
  decoded.detection = std::move(*detected);
  const auto [edges, chips] = edges_of(signal, decoded.grid, decoded.detection);
  const auto fit = fit_lattice(edges, chips);
  if (!fit) return decoded;
  const ChipGrid refined = whole_chips(fit->lattice.clock, signal.size());
  detected = slice(signal, refined, exposure_rows, carried_over(decoded.detection.bits, decoded.grid, refined));
  if (detected) decoded = {refined, std::move(*detected), fit->lattice.rows_per_chip_std};
  decoded.late = fit->lattice.duty_offset / fit->lattice.clock.rows_per_chip;
  decoded.uneven = wanders(edges, fit->of_all);
  return decoded;
}

// Chips that are n > 1 times as long. `delayed`: falling edges are not on the lattice of the rising ones.
struct Slower {
  ChipLattice lattice;
  bool delayed = false;
};

// The first chips after changes.
std::vector<std::size_t> chips_of_edges(const Decoded& decoded) {
  std::vector<std::size_t> edges;
  const auto& bits = decoded.detection.bits;
  for (std::size_t k = 1; k < bits.size(); ++k)
    if (bits[k] != bits[k - 1]) edges.push_back(k);
  return edges;
}

using Runs = std::array<std::vector<std::size_t>, 2>;

// Lengths of every second run, from the third edge and from the one after it to the last but one, ascending.
Runs runs_between(std::span<const std::size_t> edges) {
  Runs runs;
  for (std::size_t k = 2; k + 1 < edges.size(); ++k) runs[k % 2].push_back(edges[k] - edges[k - 1]);
  for (auto& lengths : runs) std::ranges::sort(lengths);
  return runs;
}

bool vary(const std::vector<std::size_t>& sorted) { return !sorted.empty() && sorted.front() < sorted.back(); }

// True if most runs of one light have one length of several chips and none is shorter, while those of the other vary:
// pulses, which may be of one chip that the exposure makes longer.
bool may_be_longer(const Runs& runs) {
  const auto are_pulses = [](const auto& own, const auto& other) {
    return own.size() >= kSureWithRate && own.front() > 1 && own[own.size() * 3 / 4] == own.front() && vary(other);
  };
  return are_pulses(runs[0], runs[1]) || are_pulses(runs[1], runs[0]);
}

// By how much runs are longer than whole ones of `shared`; shorter where one is below that.
double excess_of(const std::vector<std::size_t>& sorted, std::size_t shared) {
  const double part = static_cast<double>(sorted[sorted.size() / 2] % shared);
  return sorted.front() < shared ? part - static_cast<double>(shared) : part;
}

// If nearly all runs between the first and the last edge, which may be the lamp's ends, are multiples of n > 1 chips,
// the true chips are n times as long, whatever rate was given: single edges, of defects or of another lamp, do not lie
// on their lattice. Every second run of random chips and of a line code is odd at least. If nearly all pairs of runs
// are, while bright and dark runs are not and differ among themselves, unlike pulses of one length, the light is
// clipped: all bright runs are longer by a part of a chip, and dark ones shorter, or the other way round. Absent where
// n is 1, or beyond `slowest` rows a chip if delayed, or there are too few edges. `late`: of falling edges, half chips,
// where n is 3/2, 5/2, …: pulses of whole chips, as of a return-to-zero code, end half a given chip off the lattice.
std::optional<Slower> slower_chips(const Decoded& decoded, double slowest, int late = 0) {
  if (const int halves = static_cast<int>(std::nearbyint(2 * decoded.late)); late == 0 && halves != 0)
    if (auto slower = slower_chips(decoded, 0, halves)) return slower;
  auto edges = chips_of_edges(decoded);
  if (late != 0)
    for (auto& edge : edges) edge = 2 * edge + static_cast<std::size_t>(decoded.detection.bits[edge] ? 0 : late);
  if (edges.size() < 2 * kSureWithRate) return std::nullopt;
  const auto is_shared = [&](std::size_t chips, std::size_t runs) {
    std::size_t multiples = 0;
    for (std::size_t k = 1 + runs; k + 1 < edges.size(); ++k) multiples += (edges[k] - edges[k - runs]) % chips == 0;
    return static_cast<double>(multiples) >= kNearlyAll * static_cast<double>(edges.size() - 2 - runs);
  };
  const double chip = decoded.grid.clock.rows_per_chip / (late == 0 ? 1 : 2);
  const Runs runs = runs_between(edges);
  const bool may_delay = edges.size() >= 2 * kFew && vary(runs[0]) && vary(runs[1]);
  const auto is_delayed = [&](std::size_t chips) {
    return may_delay && static_cast<double>(chips) * chip < slowest && is_shared(chips, 2);
  };
  auto shared = static_cast<std::size_t>(kLongestChip / chip);
  while (shared > 1 && !is_shared(shared, 1) && !is_delayed(shared)) --shared;
  if (shared < 2) return std::nullopt;
  Slower slower{{}, !is_shared(shared, 1) || (late != 0 && std::abs(decoded.late) < kHalfAtLeast)};
  std::vector<std::size_t> places(shared);
  for (std::size_t k = 0; k < edges.size(); k += slower.delayed ? 2 : 1) ++places[edges[k] % shared];
  const auto place = std::ranges::max_element(places) - places.begin();
  ChipClock& clock = slower.lattice.clock;
  clock.rows_per_chip = static_cast<double>(shared) * chip;
  clock.phase = decoded.grid.start(0) + (static_cast<double>(place) - 0.5 * late) * chip;
  if (slower.delayed) clock.phase += 0.5 * excess_of(runs[1], shared) * chip;  // of the runs that begin there
  slower.lattice.rows_per_chip_std = clock.rows_per_chip / decoded.grid.clock.rows_per_chip * decoded.rows_per_chip_std;
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
  Decoded spread{whole, {}, lit.rows_per_chip_std, lit.uneven, lit.lead, lit.slowed};
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

// Dark chips that may lie beside the lamp are not known to be lit: beyond the outermost bright ones where it ends
// within the frame, and between bright ones of which one swings 1.5 times as much, as between it and its reflection.
void doubt_gaps(SlicedChips& seen, bool ends) {
  std::optional<std::size_t> last;  // bright chip
  const auto swing = [&](std::size_t k) { return (seen.relative_levels[k] + 1) * (seen.bright[k] - seen.dark[k]); };
  const auto doubt = [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) seen.relative_levels[k] = 0;
  };
  for (std::size_t k = 0; k < seen.bits.size(); ++k) {
    if (!seen.bits[k] || seen.relative_levels[k] == 0) continue;
    if (last ? std::max(swing(k), swing(*last)) > kBetter * std::min(swing(k), swing(*last)) : ends)
      doubt(last ? *last + 1 : 0, k);
    last = k;
  }
  if (last && ends) doubt(*last + 1, seen.bits.size());
}

void fill(Received& received, Decoded decoded, std::optional<double> exposure_rows) {
  for (auto bit : decoded.detection.bits) received.bits += bit ? '1' : '0';
  received.rows_per_chip = decoded.grid.clock.rows_per_chip;
  received.rows_per_chip_std = decoded.rows_per_chip_std;
  received.phase = decoded.grid.start(0);
  received.detection = std::move(decoded.detection);
  rate_chips(received);
  if (decoded.uneven) received.flags |= flag::model_misfit;
  if (are_periodic(received.detection.bits)) received.flags |= flag::periodic;
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
  return std::min(first, last) > kMostly * most;
}

// Chips of the lit rows. `edges`: those of the light that were found.
std::optional<Decoded> decode_rows(const CombinedColumn& column, const LitRows& lit, const ColumnSearch& what,
                                   std::size_t& edges) {
  // Chips that end dark show it a chip beyond the last row that stands out.
  const std::size_t begin = lit.rows.begin - std::min(lit.shortest, lit.rows.begin);
  const std::size_t end = std::min(lit.rows.end + lit.shortest, column.signal.size());
  const auto signal = std::span(column.signal).subspan(begin, end - begin);
  const auto search = find_lit_timing(column, lit.rows, begin, what.range);
  edges = search.edges;
  if (!search.timing) return std::nullopt;
  const Edges& found = search.timing->edges;
  auto decoded = detect_and_refine(signal, search.timing->lattice, found, what.exposure_rows);
  const auto slower = decoded ? slower_chips(*decoded, 1 / what.range.lowest) : std::nullopt;
  if (slower)
    if (auto again = detect_and_refine(signal, slower->lattice, found, what.exposure_rows)) {
      decoded = std::move(again);
      decoded->slowed = true;
      decoded->uneven |= slower->delayed;
    }
  if (!decoded || snr_of(decoded->detection.relative_levels) < kMinSnr) return std::nullopt;
  decoded->lead = search.timing->lead;
  if (!what.exposure_rows) decoded->uneven |= may_be_longer(runs_between(chips_of_edges(*decoded)));
  decoded->uneven |= is_read_in_groups(signal, decoded->grid.clock, what.exposure_rows);
  decoded->grid.clock.phase += static_cast<double>(begin);
  // A longer exposure than a chip leaves swings of any height, too.
  if (what.exposure_rows && *what.exposure_rows < decoded->grid.clock.rows_per_chip)
    doubt_gaps(decoded->detection, lit.rows.size() < column.signal.size());
  auto seen = within(*decoded, lit.rows, column.signal.size());
  if (seen.grid.count == 0) return std::nullopt;
  // A lamp that does not fade may be idle in the dark rows.
  if (!column.has_sides || (!what.among_lamps && ends_sharply(seen.detection)))
    return spread_over(column.signal, std::move(*decoded));
  return seen;
}

// Decodes one combination of columns; returns success. Otherwise the flags of `received` give the reason.
bool decode(const CombinedColumn& column, const ColumnSearch& what, Received& received, DarkRows dark = {}) {
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
                 {.texture = texture_of(decoded->detection), .most_noise = kSmallShare, .expected = column.has_sides});
    std::size_t of_fewer = 0;
    if (is_part(fewer, lit))
      if (auto within = decode_rows(column, fewer, what, of_fewer); within && ends_sharply(within->detection)) {
        decoded = std::move(within);
        edges = of_fewer;
      }
  }
  received.weights = column.weights;
  received.flags = flag_if(column.saturated, flag::saturated);
  if (!decoded) {
    received.flags |= edges > 0 && edges < kFew ? flag::too_few_edges : flag::no_signal;
    if (what.exposure_rows.value_or(0.0) * what.range.lowest > kLongestSliced) received.flags |= flag::long_exposure;
    return false;
  }
  // Edges of noise may outnumber those of the light. Many edges off their lattice, of light that is clipped or
  // sharpened, leave a small lead, though no other lattice is as good for all.
  const std::size_t changes = changes_of(decoded->detection);
  if (changes < (decoded->slowed ? kFew : kSureWithRate) || (changes < 2 * kFew && decoded->lead < what.sure_lead))
    received.flags |= flag::too_few_edges;
  fill(received, std::move(*decoded), what.exposure_rows);
  return true;
}

// Decodes rows that are displaced along the frame, where that leaves less of them than `received`, if it has bits. The
// bits are those of even rows, and flagged: their clock is none of the rows.
bool decode_displaced(const CombinedColumn& column, const ColumnSearch& what, Received& received) {
  const RowWarp warp = warp_of_edges(column.signal, column.noise, what.range);
  if (warp.empty()) return false;
  CombinedColumn even = column;
  even.signal = unwarped(column.signal, warp);
  Received tried{.frame = received.frame, .colour = received.colour};
  if (!decode(even, what, tried) || (tried.flags & (flag::weak | flag::too_few_edges)) != 0 ||
      (!received.bits.empty() && tried.snr <= received.snr))
    return false;
  received = std::move(tried);
  received.flags |= flag::model_misfit;
  received.phase = picture_row(received.phase, warp);
  return true;
}

StrongestTone other_tone(std::span<const double> signal, double row_time) {
  return strongest_tone(signal, signal.size(), kLowestTone * row_time, std::min(kHighestTone * row_time, 0.25));
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
void refine_square(const CombinedColumn& column, const ColumnSearch& what, double frequency, std::vector<double>& rest,
                   Received& received) {
  for (int round = 0; round < kMaxIterations; ++round) {
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

struct Share {
  double share = 0, rest = 0;
};

// Least-squares share of the light beside a lamp in rows of its columns, and the standard deviation of the rest.
Share share_of(std::span<const double> beside, std::span<const double> signal) {
  const double product = scalar_product(without_mean(signal), without_mean(beside)), power = squares_about_mean(beside);
  const double share = power > 0 ? product / power : 0.0;
  return {share, std::sqrt(std::max(variance_of(signal) - share * product / static_cast<double>(signal.size()), 0.0))};
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
  if (share < kMinShare || share > kMaxShare || share * std::sqrt(variance_of(beside)) < kVaries * rest)
    return std::nullopt;
  CombinedColumn own = column;
  for (std::size_t n = 0; n < rows; ++n) own.signal[n] -= share * beside[n];
  double alike = 0;
  for (std::size_t n = 1; n < rows; ++n) alike += (own.signal[n] - own.signal[n - 1]) * (signal[n] - signal[n - 1]);
  if (!(alike > 0)) return std::nullopt;  // what is left of a lamp that the columns beside show is its negative
  own.noise = std::fmax(column.noise, rest);
  return own;
}

// Decodes the rows of a lamp that leaves a part of the frame to light beside it, fewer than the `lit` ones; false if it
// stands in all of them.
bool decode_within(const CombinedColumn& column, const LitRows& lit, const ColumnSearch& what, Received& received) {
  const auto own = without_light_beside(column);
  if (!own) return false;
  const RowRange all{0, own->signal.size()};
  const DarkRows dark{.least_departure = 0, .most_noise = kSmallShare, .expected = true};
  if (!is_part(lit_rows(own->signal, own->noise, all, dark), lit)) return false;
  Received tried{.frame = received.frame, .colour = received.colour};
  if (!decode(*own, what, tried, dark) || !ends_sharply(tried.detection)) return false;
  received = std::move(tried);
  add_to_levels(received, difference(column.signal, own->signal), what.exposure_rows);
  return true;
}

}  // namespace

void rate_chips(Received& received) {
  received.snr = snr_of(received.detection.relative_levels);
  received.flags &= ~flag::weak;
  if (received.snr < kWeakSnr || snr_of_weakest_part(received.detection.relative_levels) < kWeakPart)
    received.flags |= flag::weak;
}

ColumnSearch column_search(const ReceiveOptions& options, const Camera& camera, std::size_t rows) {
  ColumnSearch what{{std::max(1 / kLongestChip, 4 / static_cast<double>(rows)), 1 / kShortestChip}, {}, kMinCertainty};
  if (camera.exposure) what.exposure_rows = *camera.exposure / camera.row_time;
  if (!options.chip_rate) return what;
  require_positive("chip_rate", *options.chip_rate);
  const double frequency = *options.chip_rate * camera.row_time;
  require(frequency <= 1 / kShortestChip, "chip_rate", *options.chip_rate,
          "at most half the row rate: a chip of two rows or more");
  what.range = {(1 - kRateTolerance) * frequency, std::min((1 + kRateTolerance) * frequency, 1 / kShortestChip)};
  what.sure_lead = 0;
  return what;
}

bool decode_column(const CombinedColumn& column, const ColumnSearch& what, double row_time, Received& received) {
  if (is_noise(column.signal)) {
    received.weights = column.weights;
    received.flags = flag_if(column.saturated, flag::saturated) | flag::no_signal;
    return false;
  }
  bool decoded = decode(column, what, received);
  if (!decoded || (received.flags & flag::model_misfit) != 0) decoded |= decode_displaced(column, what, received);
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

std::optional<double> blind_rows_per_chip(const CombinedColumn& column, const Camera& camera) {
  Received received;
  const bool decoded = decode(column, column_search({}, camera, column.signal.size()), received);
  return decoded ? std::optional(received.rows_per_chip) : std::nullopt;
}

}  // namespace ocisac
