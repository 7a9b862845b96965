#include "ocisac/receiver/receive.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <utility>

#include "chips/chip_period.hpp"
#include "chips/chip_timing.hpp"
#include "chips/lamp_chips.hpp"
#include "chips/lit_rows.hpp"
#include "columns/lamp_slope.hpp"
#include "columns/side_light.hpp"
#include "core/check_interrupt.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/receiver/frame_reading.hpp"
#include "receiver/colour_streams.hpp"
#include "receiver/rows_of_noise.hpp"

namespace ocisac {

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kLongestChip = 64, kShortestChip = 2;  // rows
constexpr double kRateTolerance = 0.03;
constexpr double kMaxChange = 0.02;                        // relative, of the period in the last fit
constexpr std::size_t kSureBlind = 12, kSureWithRate = 4;  // edges required for a reliable rate, blind or given
constexpr double kLongExposure = 1.05;                     // chips
constexpr double kMinSnr = 2;                              // noise divided at its median has 1.8
constexpr double kMaxSnr = 1e12;
constexpr double kSameLight = 0.9;  // cosine between the swings of a signal and of a light
constexpr int kMaxShears = 3;
constexpr double kInterpolated = 0.1;  // of the second differences of the other rows
constexpr double kLowestTone = 300, kHighestTone = 3000, kMinProminence = 5,
                 kEvident = 60;                          // Hz; over its neighbourhood
constexpr double kMinHumCycles = 1, kMinToneCycles = 8;  // in the frame
constexpr int kSquareRounds = 3, kLampRounds = 3;
constexpr std::size_t kMinPeriodicBits = 16;
constexpr std::size_t kMargin = 1;    // rows by which a chip may move
constexpr std::size_t kStretch = 12;  // chips
constexpr double kMaxWeakShare = 0.05;
constexpr double kEvidentHum = 0.05;  // standard deviation over swing
constexpr double kVaries = 3;         // standard deviations of the noise
constexpr double kSameTone = 0.03;    // relative: the tone is known to a quarter of a spectral line
constexpr double kSlowCycles = 4;     // in the frame, at most: a frame of 1/30 s of the faster mains
constexpr double kBetter = 1.5;       // times the signal-to-noise ratio
constexpr std::size_t kMinChipsOfStreams = 16;
constexpr double kSameClock = 0.005,
                 kDiffering = 0.05;  // rows per chip of the colours of one lamp; bits of two streams

// A decoded signal: timing and decisions.
struct Decoded {
  ChipGrid grid;
  SlicedChips detection;
  double rows_per_chip_std = 0;
};

// Prior knowledge about a frame.
struct Search {
  FrequencyRange range;
  std::optional<double> exposure_rows;  // rows
  std::size_t sure_edges;               // minimum number of edges for a reliable rate
  double slow;                          // cycles per row: the fastest light that is no chips
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

Search search_of(const ReceiveOptions& options, const Camera& camera, std::size_t rows) {
  Search what{search_range(options, camera, rows),
              {},
              options.chip_rate ? kSureWithRate : kSureBlind,
              std::min(kMains.back() * camera.row_time, kSlowCycles / static_cast<double>(rows))};
  if (camera.exposure) what.exposure_rows = *camera.exposure / camera.row_time;
  return what;
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
    const auto passed = [&](std::size_t n) { return (signal[n] > level) == up; };
    if (passed(low) || !passed(high)) continue;
    std::size_t first = low + 1, last = high;
    while (!passed(first)) ++first;
    while (passed(last - 1)) --last;
    const auto place = [&](std::size_t n) {
      return static_cast<double>(n) - 1 + (level - signal[n - 1]) / (signal[n] - signal[n - 1]);
    };
    result.first.rows.push_back(0.5 * (place(first) + place(last)));
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
  if (!lattice || std::abs(lattice->clock.rows_per_chip / timing.lattice.clock.rows_per_chip - 1) >= kMaxChange)
    return decoded;
  const ChipGrid refined = whole_chips(lattice->clock, signal.size());
  detected = slice(signal, refined, exposure_rows, carried_over(decoded.detection.bits, decoded.grid, refined));
  if (detected) decoded = {refined, std::move(*detected), lattice->rows_per_chip_std};
  return decoded;
}

// If every run is a multiple of n > 1 chips, the true chips are n times as long. Absent where n is 1 or there are too
// few edges. The first and the last edge may be those of the lamp's rows.
std::optional<ChipTiming> slower_timing(const Decoded& decoded, const ChipTiming& timing, FrequencyRange range) {
  std::vector<std::ptrdiff_t> edges;
  const auto& bits = decoded.detection.bits;
  for (std::size_t k = 1; k < bits.size(); ++k)
    if (bits[k] != bits[k - 1]) edges.push_back(decoded.grid.first + static_cast<std::ptrdiff_t>(k));
  if (edges.size() < kSureBlind) return std::nullopt;
  std::ptrdiff_t shared = 0;
  for (std::size_t k = 2; k + 1 < edges.size(); ++k) shared = std::gcd(shared, edges[k] - edges[k - 1]);
  if (shared < 2) return std::nullopt;
  ChipTiming slower = timing;
  const ChipClock& clock = decoded.grid.clock;
  slower.lattice.clock.phase = clock.phase + static_cast<double>(edges[1]) * clock.rows_per_chip;
  slower.lattice.clock.rows_per_chip = static_cast<double>(shared) * clock.rows_per_chip;
  slower.lattice.rows_per_chip_std = static_cast<double>(shared) * decoded.rows_per_chip_std;
  if (slower.lattice.clock.rows_per_chip * range.lowest > 1) return std::nullopt;
  return slower;
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

// Chips of all rows: those without lit rows have a relative level of 0, the nearest levels, and the bits of `wide`,
// the detection in more rows, or where that has none by the nearest levels.
Decoded spread_over(std::span<const double> signal, Decoded lit, const Decoded& wide) {
  const ChipGrid whole = whole_chips(lit.grid.clock, signal.size());
  if (whole.first == lit.grid.first && whole.count == lit.grid.count) return lit;
  Decoded spread{whole, {}, lit.rows_per_chip_std};
  const auto last = static_cast<std::ptrdiff_t>(lit.grid.count) - 1;
  const auto bit_beyond = [&](double row, double level) {
    const double chip = std::floor((row - wide.grid.start(0)) / wide.grid.clock.rows_per_chip);
    if (chip >= 0 && chip < static_cast<double>(wide.grid.count))
      return wide.detection.bits[static_cast<std::size_t>(chip)];
    const double nearest = std::clamp(row, 0.0, static_cast<double>(signal.size() - 1));
    return static_cast<std::uint8_t>(signal[static_cast<std::size_t>(nearest)] > level);
  };
  for (std::size_t k = 0; k < whole.count; ++k) {
    const std::ptrdiff_t at = whole.first + static_cast<std::ptrdiff_t>(k) - lit.grid.first;
    const auto nearest = static_cast<std::size_t>(std::clamp(at, std::ptrdiff_t{0}, last));
    const SlicedChips& seen = lit.detection;
    const bool is_lit = at >= 0 && at <= last;
    const double level = 0.5 * (seen.dark[nearest] + seen.bright[nearest]);
    spread.detection.bits.push_back(is_lit ? seen.bits[nearest] : bit_beyond(whole.centre(k), level));
    spread.detection.dark.push_back(seen.dark[nearest]);
    spread.detection.bright.push_back(seen.bright[nearest]);
    spread.detection.relative_levels.push_back(is_lit ? seen.relative_levels[nearest] : 0.0);
  }
  return spread;
}

// Share of the lit chips in stretches whose levels are those of weak light.
double weak_share(std::span<const double> relative_levels) {
  std::vector<double> lit;
  std::ranges::copy_if(relative_levels, std::back_inserter(lit), [](double level) { return level != 0; });
  std::size_t weak = 0;
  for (std::size_t begin = 0; begin + kStretch <= lit.size(); begin += kStretch)
    if (snr_of(std::span(lit).subspan(begin, kStretch)) < kWeakSnr) weak += kStretch;
  return lit.empty() ? 0.0 : static_cast<double>(weak) / static_cast<double>(lit.size());
}

std::vector<std::uint8_t> lit_bits(const SlicedChips& seen) {
  std::vector<std::uint8_t> bits;
  for (std::size_t k = 0; k < seen.bits.size(); ++k)
    if (seen.relative_levels[k] != 0) bits.push_back(seen.bits[k]);
  return bits;
}

void fill(Received& received, Decoded decoded, std::optional<double> exposure_rows) {
  for (auto bit : decoded.detection.bits) received.bits += bit ? '1' : '0';
  received.rows_per_chip = decoded.grid.clock.rows_per_chip;
  received.rows_per_chip_std = decoded.rows_per_chip_std;
  received.phase = decoded.grid.start(0);
  received.snr = snr_of(decoded.detection.relative_levels);
  received.detection = std::move(decoded.detection);
  const bool weak = weak_share(received.detection.relative_levels) > kMaxWeakShare;
  if (received.snr < kWeakSnr || weak) received.flags |= flag::weak;
  if (chip_period(lit_bits(received.detection), kMinPeriodicBits)) received.flags |= flag::periodic;
  if (exposure_rows && *exposure_rows > kLongExposure * received.rows_per_chip) received.flags |= flag::long_exposure;
}

// Chip timing in rows of a signal; its rows are those of the signal.
TimingSearch find_timing_in(const CombinedColumn& column, RowRange rows, FrequencyRange range) {
  const std::size_t first = rows.begin > 0 ? rows.begin + 1 : 0;
  const std::size_t last = rows.end < column.signal.size() ? rows.end - 1 : rows.end;
  if (last < first + 2) return {};
  auto search = find_chip_timing(std::span(column.signal).subspan(first, last - first), column.noise, range);
  if (!search.timing) return search;
  search.timing->lattice.clock.phase += static_cast<double>(first);
  for (double& row : search.timing->edges.rows) row += static_cast<double>(first);
  return search;
}

// Every second row is the mean of its neighbours: a colour of a mosaic, whose own rows are half of them.
bool is_interpolated(std::span<const double> signal) {
  std::array<double, 2> squares{};
  for (std::size_t n = 1; n + 1 < signal.size(); ++n)
    squares[n % 2] += std::pow(signal[n] - 0.5 * (signal[n - 1] + signal[n + 1]), 2);
  return std::min(squares[0], squares[1]) < kInterpolated * std::max(squares[0], squares[1]);
}

// Changes of chips in lit rows.
std::size_t changes_of(const SlicedChips& seen) {
  std::size_t changes = 0;
  for (std::size_t k = 1; k < seen.bits.size(); ++k)
    changes += seen.bits[k] != seen.bits[k - 1] && seen.relative_levels[k] != 0 && seen.relative_levels[k - 1] != 0;
  return changes;
}

Decoded within(Decoded decoded, ChipRange range) {
  const auto cut = [&](auto& values) {
    values = {values.begin() + static_cast<std::ptrdiff_t>(range.begin),
              values.begin() + static_cast<std::ptrdiff_t>(range.end)};
  };
  decoded.grid.first += static_cast<std::ptrdiff_t>(range.begin);
  decoded.grid.count = range.size();
  cut(decoded.detection.bits);
  cut(decoded.detection.dark);
  cut(decoded.detection.bright);
  cut(decoded.detection.relative_levels);
  return decoded;
}

// The chips whose values a part of the rows gives as all rows do: they lie between its first and its last row, but at
// the ends of all rows.
ChipRange chips_inside(const ChipGrid& grid, RowRange rows, std::size_t row_count) {
  ChipRange range{0, grid.count};
  const auto first = static_cast<double>(rows.begin), last = static_cast<double>(rows.end) - 1;
  while (rows.begin > 0 && range.begin < range.end && grid.start(range.begin) < first) ++range.begin;
  while (rows.end < row_count && range.begin < range.end && grid.start(range.end) > last) --range.end;
  return range;
}

// Decodes the lit rows of a signal; `edges`: of the light or of noise in these rows.
std::optional<Decoded> decode_rows(const CombinedColumn& column, const LitRows& lit, const Search& what,
                                   std::size_t& edges) {
  auto search = find_timing_in(column, lit.rows, what.range);
  edges = search.edges;
  if (!search.timing) return std::nullopt;
  // Chips that end dark show it a chip beyond the last row that stands out.
  const std::size_t begin = lit.rows.begin - std::min(lit.shortest, lit.rows.begin);
  const std::size_t end = std::min(lit.rows.end + lit.shortest, column.signal.size());
  const auto signal = std::span(column.signal).subspan(begin, end - begin);
  search.timing->lattice.clock.phase -= static_cast<double>(begin);
  for (double& row : search.timing->edges.rows) row -= static_cast<double>(begin);
  auto decoded = detect_and_refine(signal, *search.timing, what.exposure_rows);
  const auto slower = decoded ? slower_timing(*decoded, *search.timing, what.range) : std::nullopt;
  if (slower)
    if (auto again = detect_and_refine(signal, *slower, what.exposure_rows)) decoded = std::move(again);
  if (!decoded) return decoded;
  decoded->grid.clock.phase += static_cast<double>(begin);
  const ChipRange inside = chips_inside(decoded->grid, {begin, end}, column.signal.size());
  if (inside.size() == 0) return std::nullopt;
  return within(std::move(*decoded), inside);
}

// The chips in which the lamp stands; `seen`: of more rows than those of the lamp, maybe.
ChipRange lamp_among(std::span<const double> signal, const Decoded& seen, const Search& what) {
  const auto values = chip_values(signal, seen.grid, what.exposure_rows);
  return lamp_chips(values, seen.detection, what.slow * seen.grid.clock.rows_per_chip);
}

// Decodes the rows in which the lamp stands, which are known once chips are detected in more of them; the result has
// chips of all rows.
std::optional<Decoded> decode_lamp(const CombinedColumn& column, const Search& what, std::size_t& edges) {
  LitRows lit = lit_rows(column.signal, column.noise);
  auto decoded = decode_rows(column, lit, what, edges);
  if (!decoded) return std::nullopt;
  const Decoded wide = *decoded;
  for (int round = 0; round < kLampRounds; ++round) {
    const ChipRange lamp = lamp_among(column.signal, *decoded, what);
    if (lamp.size() == decoded->grid.count) break;
    const auto row_at = [&](double row) {
      return static_cast<std::size_t>(std::clamp(row, 0.0, static_cast<double>(column.signal.size())));
    };
    const std::size_t begin = row_at(std::floor(decoded->grid.start(lamp.begin)));
    lit = {{begin, row_at(std::ceil(decoded->grid.start(lamp.end)))}, kMargin};
    decoded = within(std::move(*decoded), lamp);
    std::size_t of_lamp = 0;
    auto again = decode_rows(column, lit, what, of_lamp);
    if (!again) break;
    edges = of_lamp;
    decoded = std::move(again);
  }
  return spread_over(column.signal, std::move(*decoded), wide);
}

// Decodes one combination of columns; returns success. Otherwise the flags of `received` give the reason.
bool decode(const CombinedColumn& column, const Search& what, Received& received) {
  check_interrupt();
  std::size_t edges = 0;
  auto decoded = decode_lamp(column, what, edges);
  const bool few_edges = edges > 0 && edges < what.sure_edges;
  received.weights = column.weights;
  received.flags = (column.saturated ? flag::saturated : 0) | (few_edges ? flag::too_few_edges : 0);
  if (decoded && snr_of(decoded->detection.relative_levels) >= kMinSnr) {
    // Edges of noise may outnumber those of the light.
    if (changes_of(decoded->detection) < what.sure_edges) received.flags |= flag::too_few_edges;
    fill(received, std::move(*decoded), what.exposure_rows);
    return true;
  }
  if (!few_edges) received.flags |= flag::no_signal;
  return false;
}

// A signal without other light; `square`: frequency of the square wave that was removed, cycles per row, else 0.
struct Rest {
  std::vector<double> signal;
  double square = 0;
};

StrongestTone other_tone(std::span<const double> signal, double row_time) {
  return strongest_tone(signal, signal.size(), kLowestTone * row_time, std::min(kHighestTone * row_time, 0.25));
}

std::vector<double> difference(std::span<const double> a, std::span<const double> b) {
  std::vector<double> result(a.begin(), a.end());
  for (std::size_t n = 0; n < result.size(); ++n) result[n] -= b[n];
  return result;
}

// The signal without mains hum of each frequency, and without its strongest tone as a square wave.
std::vector<Rest> without_other_light(std::span<const double> signal, const StrongestTone& tone, double row_time,
                                      double exposure_rows) {
  std::vector<Rest> rests;
  const auto add = [&](const RowNuisance& nuisance) {
    if (auto fit = remove_nuisance(signal, nuisance)) rests.push_back({std::move(fit->rest)});
  };
  const auto rows = static_cast<double>(signal.size());
  for (const double mains : kMains)
    if (mains * row_time * rows >= kMinHumCycles) add({0, {mains * row_time}});
  if (tone.prominence > kMinProminence && tone.frequency * rows >= kMinToneCycles)
    rests.push_back({without_square_wave(signal, tone.frequency, exposure_rows), tone.frequency});
  return rests;
}

// Adds light that was removed before detection: reported levels are those of the pixels.
void add_to_levels(Received& received, std::span<const double> light, std::optional<double> exposure_rows) {
  const ChipGrid grid{{received.rows_per_chip, received.phase}, 0, received.bits.size()};
  const auto values = chip_values(light, grid, exposure_rows);
  for (std::size_t k = 0; k < values.size(); ++k) {
    received.detection.dark[k] += values[k];
    received.detection.bright[k] += values[k];
  }
}

// The light of received chips in each row, with levels that are straight along the lit rows, and dark beyond.
std::optional<std::vector<double>> light_of(const Received& received, std::span<const double> signal,
                                            std::optional<double> exposure_rows) {
  const auto& seen = received.detection;
  const auto is_lit = [](double level) { return level != 0; };
  const auto first = std::ranges::find_if(seen.relative_levels, is_lit) - seen.relative_levels.begin();
  const auto bits = lit_bits(seen);
  const std::vector<double> levels(bits.begin(), bits.end());
  const ChipClock clock{received.rows_per_chip, received.phase + static_cast<double>(first) * received.rows_per_chip,
                        exposure_rows.value_or(0.0)};
  const auto row_at = [&](double chip) {
    const double row = std::clamp(clock.phase + chip * clock.rows_per_chip, 0.0, static_cast<double>(signal.size()));
    return static_cast<std::size_t>(std::lround(row));
  };
  const bool whole = levels.size() == seen.bits.size();
  const std::size_t begin = whole ? 0 : row_at(0),
                    end = whole ? signal.size() : row_at(static_cast<double>(levels.size()));
  const auto lit = signal.subspan(begin, end - begin);
  ChipClock of_lit = clock;
  of_lit.phase -= static_cast<double>(begin);
  const auto channel = fit_channel(lit, {levels, 0}, of_lit, {1, 1, exposure_rows.has_value()});
  if (!channel) return std::nullopt;
  std::vector<double> light(signal.size());
  expose_chips({levels, 0}, channel->clock, std::span(light).subspan(begin, lit.size()));
  for (std::size_t n = 0; n < light.size(); ++n) {
    const double row =
        std::clamp(static_cast<double>(n) - static_cast<double>(begin), 0.0, static_cast<double>(lit.size()));
    light[n] = channel->dark_at(row, lit.size()) + channel->swing_at(row, lit.size()) * light[n];
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
    Received again{received.frame, 0, received.colour, {}, kNan, kNan, kNan, kNan, {}, {}, 0, {}};
    if (!decode(other, what, again) || !(again.snr > received.snr)) return;
    received = std::move(again);
    rest = std::move(other.signal);
  }
}

double deviation(std::span<const double> values) {
  double sum = 0, squares = 0;
  for (const double value : values) sum += value, squares += value * value;
  const auto count = static_cast<double>(values.size());
  return std::sqrt(std::max(squares / count - std::pow(sum / count, 2), 0.0));
}

// Median swing of lit chips; 0 without chips.
double swing_of(const SlicedChips& seen) {
  std::vector<double> swings;
  for (std::size_t k = 0; k < seen.bits.size(); ++k)
    if (seen.relative_levels[k] != 0) swings.push_back(seen.bright[k] - seen.dark[k]);
  if (swings.empty()) return 0;
  const auto middle = swings.begin() + static_cast<std::ptrdiff_t>(swings.size() / 2);
  std::ranges::nth_element(swings, middle);
  return *middle;
}

// Chips that alternate as the tone does may be the tone.
bool may_be_tone(const Received& received, const StrongestTone& tone) {
  return tone.prominence > kMinProminence && std::abs(2 * received.rows_per_chip * tone.frequency - 1) < kSameTone;
}

// As decode, but that noise is not searched; without chips, with weak ones, or beside an evident tone, other light is
// removed from the rows and detection repeated. Steady rows beside a lamp show no other light.
bool decode_any(const CombinedColumn& column, const Search& what, double row_time, Received& received) {
  if (is_noise(column.signal)) {
    received.weights = column.weights;
    received.flags = (column.saturated ? flag::saturated : 0) | flag::no_signal;
    return false;
  }
  const bool decoded = decode(column, what, received);
  const auto tone = other_tone(column.signal, row_time);
  const bool as_tone = decoded && may_be_tone(received, tone);
  if (decoded && (received.flags & flag::weak) == 0 && tone.prominence < kEvident && !as_tone) return true;
  if (lit_rows(column.signal, column.noise).rows.size() < column.signal.size()) return decoded;
  bool better = decoded;
  for (auto& [rest, square] : without_other_light(column.signal, tone, row_time, what.exposure_rows.value_or(0.0))) {
    CombinedColumn other = column;
    other.signal = std::move(rest);
    Received tried{received.frame, 0, received.colour, {}, kNan, kNan, kNan, kNan, {}, {}, 0, {}};
    if (!decode(other, what, tried)) continue;
    if (square > 0) refine_square(column, what, square, other.signal, tried);
    if (better && tried.snr < kBetter * received.snr) continue;
    received = std::move(tried);
    add_to_levels(received, difference(column.signal, other.signal), what.exposure_rows);
    better = true;
  }
  return better;
}

// One source and its signal; `signal` is empty where decoding failed.
struct Source {
  Received received;
  std::vector<double> signal;
  double slope = 0;                       // of the light that all columns show
  std::vector<CombinedColumn> columns{};  // of each colour; empty where decoding failed
};

// The light of best quality in the `allowed` columns (empty: all).
Source receive_source(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                      const Search& what, std::span<const std::uint8_t> allowed) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  Received best{frame, 0, 0, {}, nan, nan, nan, nan, {}, {}, 0, {}};
  double slope = 0;
  bool first = true;
  for (const auto saturated : {SaturatedColumns::leave_out, SaturatedColumns::use}) {
    std::vector<std::pair<CombinedColumn, std::size_t>> columns;
    for (std::size_t colour = 0; colour < colours.size(); ++colour)
      columns.emplace_back(combine_columns(colours[colour], frame, camera.tone_curve, saturated, allowed), colour);
    std::ranges::stable_sort(columns, [](const auto& a, const auto& b) {
      const bool half = is_interpolated(a.first.signal), other_half = is_interpolated(b.first.signal);
      return half != other_half ? other_half : a.first.quality > b.first.quality;
    });
    if (first) slope = columns.front().first.slope;
    for (auto& [column, colour] : columns) {
      if (saturated == SaturatedColumns::use && !column.saturated) continue;  // tried already
      Received received{frame, 0, colour, {}, nan, nan, nan, nan, {}, {}, 0, {}};
      if (decode_any(column, what, camera.row_time, received)) {
        Source source{std::move(received), column.signal, slope, {}};
        std::ranges::sort(columns, {}, [](const auto& one) { return one.second; });
        for (auto& one : columns) source.columns.push_back(std::move(one.first));
        return source;
      }
      if (std::exchange(first, false)) best = std::move(received);
    }
  }
  return {std::move(best), {}, slope, {}};
}

// Share of the lit chips that differ where both have some; 1 where that is less than half of those of both.
double differing(const Received& a, const Received& b) {
  const auto moved = static_cast<std::ptrdiff_t>(std::lround((b.phase - a.phase) / a.rows_per_chip));
  std::size_t both = 0, wrong = 0;
  for (std::size_t k = 0; k < b.bits.size(); ++k) {
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(k) + moved;
    if (at < 0 || at >= static_cast<std::ptrdiff_t>(a.bits.size())) continue;
    const auto of_a = static_cast<std::size_t>(at);
    if (a.detection.relative_levels[of_a] == 0 || b.detection.relative_levels[k] == 0) continue;
    ++both;
    wrong += a.bits[of_a] != b.bits[k];
  }
  const std::size_t fewer = std::min(lit_bits(a.detection).size(), lit_bits(b.detection).size());
  return 2 * both < fewer || both == 0 ? 1.0 : static_cast<double>(wrong) / static_cast<double>(both);
}

bool same_clock(const Received& a, const Received& b) {
  return std::abs(a.rows_per_chip / b.rows_per_chip - 1) < kSameClock;
}

// The streams of a source's colours where they differ; the source itself, or its colours added, where they agree.
std::vector<Received> streams_of(const Source& source, std::size_t frame, const Camera& camera, const Search& what) {
  const Received& first = source.received;
  if (source.columns.size() < 2 || first.bits.size() < kMinChipsOfStreams) return {first};
  const ChipGrid grid{{first.rows_per_chip, first.phase}, 0, first.bits.size()};
  std::vector<std::vector<double>> values;
  for (const auto& column : source.columns) values.push_back(chip_values(column.signal, grid, what.exposure_rows));
  const auto streams = colour_streams(values);
  std::vector<Received> found;
  for (const auto& stream : streams) {
    Received one{frame, 0, stream.colour, {}, kNan, kNan, kNan, kNan, {}, {}, 0, stream.weights};
    if (!decode_any(sum_of(source.columns, stream), what, camera.row_time, one)) continue;
    bool is_new = (one.flags & ~(flag::saturated | first.flags)) == 0 && same_clock(one, first);
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

// A frame whose light stands obliquely, sheared upright.
std::vector<Received> receive_upright(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                                      const Search& what, double slope, int shears) {
  std::vector<UprightFrame> upright;
  std::vector<AnyFramesView> views;
  for (const auto& colour : colours) upright.emplace_back(colour, frame, slope);
  for (const auto& colour : upright) views.push_back(colour.view());
  auto sources = receive_frame(views, 0, camera, what, shears);
  for (Received& received : sources) {
    received.frame = frame;
    received.weights = upright.front().own_weights(received.weights);
  }
  return sources;
}

// All lights of a frame, each from columns of its own where there are several; first the one that all columns show.
std::vector<Received> receive_frame(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                                    const Search& what, int shears) {
  Source whole = receive_source(colours, frame, camera, what, {});
  if (whole.slope != 0 && shears < kMaxShears)
    return receive_upright(colours, frame, camera, what, whole.slope, shears + 1);
  const auto lights = light_groups(colours[whole.received.colour], frame, camera.tone_curve);
  std::vector<Received> sources;
  for (const auto& light : lights) {
    const bool seen = is_clean(whole) && agreement(whole.signal, light) >= kSameLight;
    Source source = receive_source(colours, frame, camera, what, light.columns);
    const auto is_same = [&](const Received& other) {
      return same_clock(other, source.received) && differing(other, source.received) < kDiffering;
    };
    if (is_clean(source) && std::ranges::any_of(sources, is_same)) continue;  // other columns of the same lamp
    if (is_clean(source))
      sources.insert(seen ? sources.begin() : sources.end(), std::move(source.received));
    else if (seen)
      sources.insert(sources.begin(), whole.received);
  }
  if (lights.empty()) sources = streams_of(whole, frame, camera, what);
  if (sources.empty()) return {std::move(whole.received)};
  for (std::size_t k = 0; k < sources.size(); ++k) sources[k].source = k;
  return sources;
}

// Other light may be beside the lamp, or taken for one: a flag, several sources, rows without a lamp, hum or a tone.
bool is_suspect(const std::vector<Received>& sources, std::span<const double> signal, double row_time) {
  const Received& first = sources.front();
  if (sources.size() > 1 || (first.flags & ~flag::saturated) != 0) return true;
  if (lit_bits(first.detection).size() < first.bits.size()) return true;
  const auto tone = other_tone(signal, row_time);
  if (tone.prominence > kEvident || may_be_tone(first, tone)) return true;
  const double swing = swing_of(first.detection);
  return std::ranges::any_of(kMains, [&](double mains) {
    if (mains * row_time * static_cast<double>(signal.size()) < kMinHumCycles) return false;
    const auto fit = remove_nuisance(signal, {0, {mains * row_time}});
    return fit && deviation(difference(signal, fit->rest)) > kEvidentHum * swing;
  });
}

// Light beside the lamp, per colour, and the lights of the frame without it.
struct Beside {
  bool varies = false;
  std::vector<Received> sources;  // empty where it does not vary
};

Beside receive_beside(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                      const Search& what, const Received& found) {
  std::vector<SideLight> lights;
  std::vector<FrameWithout> frames;
  std::vector<AnyFramesView> views;
  for (const auto& colour : colours) {
    auto light = side_light(colour, frame, camera.tone_curve, found.weights);
    if (!light) return {};
    lights.push_back(std::move(*light));
  }
  const SideLight& beside = lights[found.colour];
  if (!(beside.varying > kVaries * beside.noise)) return {};
  for (std::size_t c = 0; c < colours.size(); ++c)
    frames.emplace_back(colours[c], frame, camera.tone_curve, lights[c].rows);
  for (const auto& one : frames) views.push_back(one.view());
  Camera linear = camera;
  linear.tone_curve = {};
  Beside result{beside.varying > kEvidentHum * swing_of(found.detection), receive_frame(views, 0, linear, what)};
  for (Received& received : result.sources) {
    received.frame = frame;
    if (received.bits.empty()) continue;
    std::vector<double> removed(beside.rows.size());
    for (std::size_t c = 0; c < lights.size(); ++c) {
      const auto& weights = received.colour_weights;
      const double weight = weights.empty() ? static_cast<double>(c == received.colour) : weights[c];
      for (std::size_t n = 0; n < removed.size(); ++n) removed[n] += weight * lights[c].rows[n];
    }
    add_to_levels(received, removed, what.exposure_rows);
  }
  return result;
}

// The lights of a frame; where other light may be beside them, those of the frame without it, if these are sure. If
// not, those that were found may be other light.
std::vector<Received> receive_lights(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                                     const Search& what) {
  auto sources = receive_frame(colours, frame, camera, what);
  const Received& first = sources.front();
  if (first.weights.empty() || (sources.size() > 1 && !first.colour_weights.empty())) return sources;
  const auto signal = combine_columns(colours[first.colour], frame, camera.tone_curve).signal;
  if (!is_suspect(sources, signal, camera.row_time)) return sources;
  auto beside = receive_beside(colours, frame, camera, what, first);
  const auto is_sure = [](const Received& one) { return !one.bits.empty() && (one.flags & ~flag::saturated) == 0; };
  if (!beside.sources.empty()) {
    const bool better = !beside.sources.front().bits.empty() && !is_sure(first);
    if (is_sure(beside.sources.front()) || better) return std::move(beside.sources);
  }
  if (beside.varies)
    for (Received& received : sources)
      if (!received.bits.empty()) received.flags |= flag::model_misfit;
  return sources;
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
  const Search what = search_of(options, camera, shape.rows);
  std::vector<Received> received;
  for (std::size_t frame = 0; frame < shape.frames; ++frame)
    std::ranges::move(receive_lights(colours, frame, camera, what), std::back_inserter(received));
  for (Received& one : received) {
    if (!one.colour_weights.empty()) continue;
    one.colour_weights.assign(colours.size(), 0.0);
    one.colour_weights[one.colour] = 1;
  }
  return received;
}

std::optional<double> blind_rows_per_chip(const CombinedColumn& column, const Camera& camera) {
  const Search what = search_of({}, camera, column.signal.size());
  Received received;
  return decode(column, what, received) ? std::optional(received.rows_per_chip) : std::nullopt;
}

}  // namespace ocisac
