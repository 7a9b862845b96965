#include "ocisac/receiver/receive.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <iterator>
#include <numeric>
#include <utility>

#include "columns/contrast_slope.hpp"
#include "columns/lamp_slope.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/require.hpp"
#include "receiver/colour_streams.hpp"
#include "receiver/column_decoder.hpp"
#include "receiver/lamp_rows.hpp"
#include "tones/clipping.hpp"

namespace ocisac {

namespace {

constexpr double kDarkShare = 0.25;    // of a bright chip of the lamp's width there
constexpr double kInterpolated = 0.1;  // of the second differences of the other rows
constexpr double kMostOthers = 2.5;    // lamps on one clock: 3/4 of the edges of random chips are no other one's, of 3
constexpr double kSameClock = 0.005,
                 kDiffering = 0.05;  // rows per chip of the colours of one lamp; bits of two streams

// Rows between two places, of a frame of so many.
RowRange rows_between(double first, double last, std::size_t rows) {
  const auto most = static_cast<double>(rows);
  const double begin = std::clamp(first, 0.0, most), end = std::clamp(last, begin, most);
  return {static_cast<std::size_t>(begin), static_cast<std::size_t>(end)};
}

// Rows of the chips, of a frame of so many.
RowRange rows_of(const Received& received, std::size_t rows) {
  const double chips = static_cast<double>(received.bits.size());
  return rows_between(received.phase, received.phase + chips * received.rows_per_chip, rows);
}

// Every second row is the mean of its neighbours: a colour of a mosaic, whose own rows are half of them.
bool is_interpolated(std::span<const double> signal) {
  std::array<double, 2> squares{};
  for (std::size_t n = 1; n + 1 < signal.size(); ++n)
    squares[n % 2] += std::pow(signal[n] - 0.5 * (signal[n - 1] + signal[n + 1]), 2);
  return std::min(squares[0], squares[1]) < kInterpolated * std::max(squares[0], squares[1]);
}

// The chips of a lamp whose outline is known: where it is narrow, a bright one is as much fainter, and the string ends
// with a chip that is neither, or where the lamp is narrower than a column.
void fit_to_outline(const AnyFramesView& colour, const CombinedColumn& column, const ColumnSearch& what,
                    Received& received) {
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
  const auto is_wide = [&](std::size_t k) { return outline->width(grid.centre(k)) > kMostly * outline->widest; };
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
      if (share > kDarkShare && share < kMostly) break;
      append(share >= kMostly, 2 * share - 1, like);
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

// Correlation of the changes from chip to chip between two halves of the columns, by weight; 1 for a single column.
double agreement_of_halves(const AnyFramesView& colour, const Received& received, std::optional<double> exposure_rows) {
  const ChipGrid grid = grid_of(received);
  const std::span weights(received.weights);
  std::array<std::vector<double>, 2> changes;
  std::size_t middle = 0;
  for (double before = 0; middle < weights.size() && before + weights[middle] < 0.5; ++middle)
    before += weights[middle];
  const auto other = static_cast<std::ptrdiff_t>(middle);
  for (std::size_t half = 0; half < 2; ++half) {
    std::vector<double> of_half(weights.begin(), weights.end());
    std::fill(of_half.begin() + (half == 0 ? other : 0), half == 0 ? of_half.end() : of_half.begin() + other, 0.0);
    changes[half] = chip_values(weighted_rows(colour, received.frame, {}, of_half), grid, exposure_rows);
    std::adjacent_difference(changes[half].begin(), changes[half].end(), changes[half].begin());
    changes[half].front() = 0;
  }
  const double energy = scalar_product(changes[0], changes[0]) * scalar_product(changes[1], changes[1]);
  return energy > 0 ? scalar_product(changes[0], changes[1]) / std::sqrt(energy) : 1.0;
}

// True if the columns share the chips: all but noise, of which each half has twice that of all, 1/snr of the chips'
// square. A texture has edges of its own in each part, or contrast in its dark or its bright rows alone.
bool is_common(const AnyFramesView& colour, const Received& received, const ToneCurve& curve,
               std::optional<double> exposure_rows) {
  const double expected = 1 / (1 + 2 / received.snr);
  if (!(agreement_of_halves(colour, received, exposure_rows) > kNearlyAll * expected)) return false;
  const IndexRange columns = extent_of(received.weights);
  const RowRange rows = rows_of(received, shape_of(colour).rows);
  const Region box{columns.begin, rows.begin, columns.size(), rows.size()};
  return !contrast_slope(colour, received.frame, box, curve).is_of_texture();
}

// True if samples of lit columns pile up at their highest value by more than chance though noise spreads them over
// several: light is clipped there, at a level below the camera's white. Noise is what second differences across the
// columns show.
bool piles_up(const AnyFramesView& colour, std::size_t frame, std::span<const double> weights) {
  const auto brightest = static_cast<std::size_t>(std::ranges::max_element(weights) - weights.begin());
  const auto pile = find_piles(colour, frame, brightest, 0).high;
  if (!pile || weights.size() < 3) return false;
  const PileCounts counts = count_pile(colour, frame, *pile);
  double at = 0, beside = 0, beyond = 0;
  for (std::size_t k = 0; k < weights.size(); ++k)
    if (weights[k] > 0) at += counts.at[k], beside += counts.beside[k], beyond += counts.beyond[k];
  if (!(at > beside + beyond + kSure * std::sqrt(at + beside + beyond))) return false;
  return std::visit(
      [&](const auto& view) {
        const std::size_t middle = std::clamp<std::size_t>(brightest, 1, view.columns - 2);
        double squares = 0, rows = 0;
        for (std::size_t row = 0; row < view.rows; ++row) {
          const auto value = [&](std::size_t k) { return static_cast<double>(view(frame, row, k)); };
          if (!(value(middle) < pile->level)) continue;
          squares += std::pow(value(middle - 1) - 2 * value(middle) + value(middle + 1), 2) / 6;
          rows += 1;
        }
        return squares > rows * pile->step * pile->step;
      },
      colour);
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
                      const ColumnSearch& what, std::span<const std::uint8_t> allowed) {
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
      if (decode_column(column, what, camera.row_time, received)) {
        if (column.has_sides) fit_to_outline(colours[colour], column, what, received);
        if (piles_up(colours[colour], frame, column.weights)) received.flags |= flag::saturated;
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
std::vector<Received> streams_of(const Source& source, std::size_t frame, const Camera& camera,
                                 const ColumnSearch& what) {
  const Received& first = source.received;
  if (source.columns.size() < 2 || first.bits.size() < kMinChipsOfStreams) return {first};
  const ChipGrid grid = grid_of(first);
  std::vector<std::vector<double>> values;
  for (const auto& column : source.columns) values.push_back(chip_values(column.signal, grid, what.exposure_rows));
  const auto streams = colour_streams(values);
  std::vector<Received> found;
  for (const auto& stream : streams) {
    Received one{.frame = frame, .colour = stream.colour, .colour_weights = stream.weights};
    if (!decode_column(sum_of(source.columns, stream), what, camera.row_time, one)) continue;
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
                                    const ColumnSearch& what, int shears = 0);

// A frame whose light stands obliquely, sheared upright; empty where its columns agree no better then: the chips of a
// round lamp may lie about an oblique line by chance.
std::vector<Received> receive_upright(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                                      const ColumnSearch& what, const Source& whole, int shears) {
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
                                    const ColumnSearch& what, const CombinedColumn& column, int shears) {
  const auto lamps = rows_of_lamps(column.signal, column.noise);
  if (lamps.size() < 2) return {};
  ColumnSearch of_lamp = what;
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

// Share of a light's squared changes from row to row that are in step with another one's chips, more than edges at
// random places, and are none of its edges: where its chips stay as they are, or change the other way.
double own_edges(const LightGroup& light, const Received& other) {
  const ChipGrid grid = grid_of(other);
  const auto& levels = other.detection.relative_levels;
  std::vector<double> changes(light.swings.size());
  std::adjacent_difference(light.swings.begin(), light.swings.end(), changes.begin());
  changes.front() = 0;
  std::complex<double> own;
  double by_chance = 0;
  for (std::size_t k = 1; k < grid.count; ++k) {
    if (levels[k - 1] == 0 || levels[k] == 0) continue;
    std::complex<double> edge;
    const RowRange rows = rows_between(grid.centre(k - 1), grid.centre(k), changes.size());
    for (std::size_t n = rows.begin; n < rows.end; ++n)
      if (!(changes[n] * (other.bits[k] - other.bits[k - 1]) > 0))
        edge += std::polar(changes[n] * changes[n], kTwoPi * static_cast<double>(n) / other.rows_per_chip);
    own += edge, by_chance += std::norm(edge);
  }
  return std::sqrt(std::max(std::norm(own) - by_chance, 0.0)) / scalar_product(changes, changes);
}

// True if more lights have edges of their own on the light's clock than lamps do: modules of a printed code.
bool is_of_code(const Received& received, std::span<const LightGroup> lights) {
  double others = 0;
  for (const LightGroup& light : lights) others += own_edges(light, received);
  return others > kMostOthers;
}

// All lights of a frame, each from columns or rows of its own where there are several; first the one that all columns
// show.
std::vector<Received> receive_frame(std::span<const AnyFramesView> colours, std::size_t frame, const Camera& camera,
                                    const ColumnSearch& what, int shears) {
  Source whole = receive_source(colours, frame, camera, what, {});
  if (whole.slope != 0 && shears < kMaxIterations)
    if (auto upright = receive_upright(colours, frame, camera, what, whole, shears + 1); !upright.empty())
      return upright;
  auto sources = receive_above(colours, frame, camera, what, whole.best, shears);
  if (sources.size() < 2) {
    sources.clear();
    const auto lights = light_groups(colours[whole.received.colour], frame, camera.tone_curve);
    std::vector<Received> periodic;
    for (const auto& light : lights) {
      const bool seen = is_clean(whole) && agreement(whole.signal, light) >= kNearlyAll;
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
    if (sources.empty()) sources.push_back(std::move(whole.received));
    for (Received& source : sources)
      if (is_of_code(source, lights)) source.flags |= flag::ambiguous_kind;
  }
  for (std::size_t k = 0; k < sources.size(); ++k) sources[k].source = k;
  return sources;
}

// Changes over a chip of the rows of a source in a frame, by its columns' weights, as stored: slow light cancels.
std::vector<double> changes_of(const AnyFramesView& colour, std::size_t frame, const Received& source) {
  const auto rows = weighted_rows(colour, frame, {}, source.weights);
  const auto lag = static_cast<std::size_t>(std::max(std::round(source.rows_per_chip), 1.0));
  const RowRange seen = rows_of(source, rows.size());
  std::vector<double> changes;
  for (std::size_t n = seen.begin + lag; n < seen.end; ++n) changes.push_back(rows[n] - rows[n - lag]);
  return changes;
}

// True where another frame has the same chips, or explains the rows better than the chips do: a picture
// that stands still, or a light in step with the frames. The chips leave 1/snr of the square of the rows, the other
// frame 1 − r², r: their correlation.
bool stands_still(const AnyFramesView& colour, const Received& source, std::size_t other,
                  std::span<const Received> received) {
  const auto is_same = [&](const Received& one) { return one.frame == other && is_one_lamp(source, one); };
  if (std::ranges::any_of(received, is_same)) return true;
  const auto own = changes_of(colour, source.frame, source), same = changes_of(colour, other, source);
  const double energy = scalar_product(own, own) * scalar_product(same, same), common = scalar_product(own, same);
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
  const ColumnSearch what = column_search(options, camera, shape.rows);
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

}  // namespace ocisac
