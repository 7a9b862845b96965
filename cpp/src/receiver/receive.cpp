#include "ocisac/receiver/receive.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <utility>

#include "chips/slicer.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr double kLongestChip = 64, kShortestChip = 2;  // rows
constexpr double kRateTolerance = 0.03;
constexpr double kLargestChange = 0.02;                    // relative, of the period in the last fit
constexpr std::size_t kSureBlind = 12, kSureWithRate = 4;  // edges required for a reliable rate, blind or given
constexpr double kLongExposure = 1.05;                     // chips
constexpr double kMinSnr = 2;                              // noise divided at its median has 1.8
constexpr double kMaxSnr = 1e12;
constexpr double kSameLight = 0.9;  // cosine between the swings of a signal and of a light
constexpr double kWeakSnr = 9;      // swing of ±3 standard deviations

// A decoded signal: timing and decisions.
struct Decoded {
  ChipGrid grid;
  Detection detection;
};

// Prior knowledge about a frame.
struct Search {
  FrequencyRange range;
  std::optional<double> exposure_rows;  // rows
  std::size_t sure_edges;               // minimum number of edges for a reliable rate
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
                                               const Detection& seen) {
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
                                         const Detector& detector, std::optional<double> exposure_rows) {
  Decoded decoded{whole_chips(timing.lattice, signal.size()), {}};
  auto detected = detector.detect(signal, decoded.grid, exposure_rows, bits_between(timing.edges, decoded.grid));
  if (!detected) return std::nullopt;
  decoded.detection = std::move(*detected);
  const auto [edges, chips] = edges_of(signal, decoded.grid, decoded.detection);
  const auto lattice = fit_lattice(edges, chips);
  if (!lattice || std::abs(lattice->rows_per_chip / timing.lattice.rows_per_chip - 1) >= kLargestChange) return decoded;
  const ChipGrid refined = whole_chips(*lattice, signal.size());
  detected =
      detector.detect(signal, refined, exposure_rows, carried_over(decoded.detection.bits, decoded.grid, refined));
  if (detected) decoded = {refined, std::move(*detected)};
  return decoded;
}

// If every run is a multiple of n > 1 chips, the true chips are n times as long. Absent where n is 1 or there are too
// few edges.
std::optional<ChipTiming> slower_timing(const Decoded& decoded, const ChipTiming& timing, FrequencyRange range) {
  std::ptrdiff_t shared = 0, first_edge = 0, last_edge = 0;
  std::size_t edges = 0;
  const auto& bits = decoded.detection.bits;
  for (std::size_t k = 1; k < bits.size(); ++k) {
    if (bits[k] == bits[k - 1]) continue;
    const auto edge = decoded.grid.first + static_cast<std::ptrdiff_t>(k);
    if (edges++ == 0)
      first_edge = edge;
    else
      shared = std::gcd(shared, edge - last_edge);
    last_edge = edge;
  }
  if (edges < kSureBlind || shared < 2) return std::nullopt;
  ChipTiming slower = timing;
  const ChipLattice& lattice = decoded.grid.lattice;
  slower.lattice.phase = lattice.phase + static_cast<double>(first_edge) * lattice.rows_per_chip;
  slower.lattice.rows_per_chip = static_cast<double>(shared) * lattice.rows_per_chip;
  slower.lattice.rows_per_chip_std = static_cast<double>(shared) * lattice.rows_per_chip_std;
  if (slower.lattice.rows_per_chip * range.lowest > 1) return std::nullopt;
  return slower;
}

// 1 / variance of the soft values about ±1 (the threshold is 0).
double snr_of(std::span<const double> soft) {
  double variance = 0;
  for (double value : soft) variance += std::pow(std::abs(value) - 1, 2);
  variance /= static_cast<double>(soft.size());
  return std::min(1 / std::max(variance, 1e-300), kMaxSnr);
}

void fill(Received& received, Decoded decoded, std::optional<double> exposure_rows) {
  const ChipLattice& lattice = decoded.grid.lattice;
  for (auto bit : decoded.detection.bits) received.bits += bit ? '1' : '0';
  received.rows_per_chip = lattice.rows_per_chip;
  received.rows_per_chip_std = lattice.rows_per_chip_std;
  received.phase = decoded.grid.start(0);
  received.snr = snr_of(decoded.detection.soft);
  received.detection = std::move(decoded.detection);
  if (received.snr < kWeakSnr) received.flags |= flag::weak;
  if (exposure_rows && *exposure_rows > kLongExposure * lattice.rows_per_chip) received.flags |= flag::long_exposure;
}

// Decodes one combination of columns; returns success. Otherwise the flags of `received` give the reason.
bool decode(const CombinedColumn& column, const Search& what, Received& received) {
  const auto search = find_chip_timing(column.signal, column.noise, what.range);
  const bool few_edges = search.edges > 0 && search.edges < what.sure_edges;
  received.weights = column.weights;
  received.flags = (column.saturated ? flag::saturated : 0) | (few_edges ? flag::too_few_edges : 0);
  if (search.timing) {
    auto decoded = detect_and_refine(column.signal, *search.timing, Slicer{}, what.exposure_rows);
    const auto slower = decoded ? slower_timing(*decoded, *search.timing, what.range) : std::nullopt;
    if (slower)
      if (auto again = detect_and_refine(column.signal, *slower, Slicer{}, what.exposure_rows))
        decoded = std::move(again);
    if (decoded && snr_of(decoded->detection.soft) >= kMinSnr) {
      fill(received, std::move(*decoded), what.exposure_rows);
      return true;
    }
  }
  if (!few_edges) received.flags |= flag::no_signal;
  return false;
}

// One source and its signal; `signal` is empty where decoding failed.
struct Source {
  Received received;
  std::vector<double> signal;
};

// The light of best quality in the `allowed` columns (empty: all).
Source receive_source(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                      const Search& what, std::span<const std::uint8_t> allowed) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  Received best{frame, 0, 0, {}, nan, nan, nan, nan, {}, {}, 0};
  bool first = true;
  for (const auto saturated : {SaturatedColumns::leave_out, SaturatedColumns::use}) {
    std::vector<std::pair<CombinedColumn, std::size_t>> columns;
    for (std::size_t colour = 0; colour < colours.size(); ++colour)
      columns.emplace_back(combine_columns(colours[colour], frame, camera.tone_curve, saturated, allowed), colour);
    std::ranges::stable_sort(columns, [](const auto& a, const auto& b) { return a.first.quality > b.first.quality; });
    for (auto& [column, colour] : columns) {
      if (saturated == SaturatedColumns::use && !column.saturated) continue;  // tried already
      Received received{frame, 0, colour, {}, nan, nan, nan, nan, {}, {}, 0};
      if (decode(column, what, received)) return {std::move(received), std::move(column.signal)};
      if (std::exchange(first, false)) best = std::move(received);
    }
  }
  return {std::move(best), {}};
}

bool is_clean(const Source& source) {
  return !source.signal.empty() && (source.received.flags & ~flag::saturated) == 0;
}

// All lights of a frame, each from its own columns if there are several; first the one that dominates the combination
// of all columns.
std::vector<Received> receive_frame(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                                    const Search& what) {
  Source whole = receive_source(colours, frame, camera, what, {});
  const auto lights = light_groups(colours[whole.received.colour], frame, camera.tone_curve);
  std::vector<Received> sources;
  for (const auto& light : lights) {
    const bool seen = is_clean(whole) && agreement(whole.signal, light) >= kSameLight;
    Source source = receive_source(colours, frame, camera, what, light.columns);
    if (is_clean(source))
      sources.insert(seen ? sources.begin() : sources.end(), std::move(source.received));
    else if (seen)
      sources.insert(sources.begin(), whole.received);
  }
  if (sources.empty()) return {std::move(whole.received)};
  for (std::size_t k = 0; k < sources.size(); ++k) sources[k].source = k;
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
  Search what{search_range(options, camera, shape.rows), {}, options.chip_rate ? kSureWithRate : kSureBlind};
  if (camera.exposure) what.exposure_rows = *camera.exposure / camera.row_time;
  std::vector<Received> received;
  for (std::size_t frame = 0; frame < shape.frames; ++frame)
    std::ranges::move(receive_frame(colours, frame, camera, what), std::back_inserter(received));
  return received;
}

std::optional<double> blind_rows_per_chip(const CombinedColumn& column, const Camera& camera) {
  Search what{search_range({}, camera, column.signal.size()), {}, kSureBlind};
  if (camera.exposure) what.exposure_rows = *camera.exposure / camera.row_time;
  Received received;
  return decode(column, what, received) ? std::optional(received.rows_per_chip) : std::nullopt;
}

}  // namespace ocisac
