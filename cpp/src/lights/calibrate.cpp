#include "ocisac/lights/calibrate.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_blocks.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/lights/detect_sources.hpp"
#include "ocisac/tones/periodic_fit.hpp"
#include "ocisac/tones/tone_columns.hpp"

namespace ocisac {

namespace {

constexpr double min_cycles = 2.5;     // of a light in its box
constexpr double false_alarms = 1;     // a picture for calibration contains a light
constexpr std::size_t max_lights = 8;  // of a frame
constexpr std::size_t harmonics = 3;   // as of detect_sources()
constexpr double few_cycles = 2;
constexpr double same_frequency = 0.02;  // relative
constexpr double even_snr = 6;           // of a tone over the whole frame: outlines, text and lines leave 4 and less
constexpr double lit_share = 0.02;       // of the columns: fewer may be a line of text
constexpr double outline_cycles = 3;     // in the frame: the outline of a lamp resembles fewer
constexpr double likely = 0.575;         // probability of a light
constexpr double longest_frame = 1;      // s

// Energy of the pixels that a tone with its first harmonics explains, DN².
double explained_energy(const AnyFramesView& frames, double frequency) {
  const ColumnBlocks blocks = column_blocks(frames, std::numeric_limits<double>::quiet_NaN());
  const PeriodicModel model = periodic_model(frequency, blocks.rows, harmonics);
  const PeriodicFit fit = fit_periodic({blocks.signals, blocks.rows}, model, frequency);
  return std::accumulate(fit.periodic_energy.begin(), fit.periodic_energy.end(), 0.0) /
         static_cast<double>(blocks.width);
}

// The light of the first frame, within the bounds of the search, that explains most of the picture; an unlikely one
// only without likely ones.
std::optional<LightSource> strongest_lamp(const AnyFramesView& frames, const FrequencySearch& search) {
  Camera per_row;
  per_row.row_time = 1;
  std::optional<LightSource> best;
  double most = 0;
  for (const LightSource& light :
       detect_sources(frame_of(frames, 0), per_row, {false_alarms, min_cycles, max_lights})) {
    if (light.frequency < search.lower || light.frequency > search.upper) continue;
    const double energy = explained_energy(part_of(frames, light.box), light.frequency);
    const auto rank = [](const LightSource& one, double explains) {
      return std::pair{one.probability >= likely, explains};
    };
    if (!best || rank(light, energy) > rank(*best, most)) best = light, most = energy;
  }
  return best;
}

bool agree(double frequency, double frequency_std, const LightSource& light) {
  return std::abs(frequency - light.frequency) <=
         3 * std::hypot(frequency_std, light.frequency_std) + same_frequency * light.frequency;
}

bool answered(const FoundFrequency& found) {
  return (found.flags & (flag::no_tone | flag::at_bound | flag::few_cycles)) == 0;
}

bool is_narrow(const ToneColumns& columns) {
  return static_cast<double>(std::ranges::count(columns.used, 1)) <
         lit_share * static_cast<double>(columns.used.size());
}

// True if the tone explains the whole frame.
bool is_everywhere(const FoundFrequency& found, const Shape& shape) {
  return answered(found) && found.snr >= even_snr &&
         found.frequency * static_cast<double>(shape.rows) >= outline_cycles && !is_narrow(found.columns);
}

// Without a lower bound, frequencies of at least two cycles in the frame are searched first, lower ones only if no tone
// is found.
FoundFrequency find_in_frame(const AnyFramesView& frames, const FrequencySearch& search) {
  const double lowest = few_cycles / static_cast<double>(std::max<std::size_t>(shape_of(frames).rows, 1));
  if (search.lower == 0 && lowest < std::min(search.upper, 0.5)) {
    FrequencySearch from_two = search;
    from_two.lower = lowest;
    FoundFrequency found = find_frequency(frames, from_two);
    if (answered(found)) return found;
  }
  return find_frequency(frames, search);
}

}  // namespace

namespace {

struct Lamp {
  FoundFrequency found;
  double probability = kNaN;  // of its light; NaN: a tone of the whole frame
};

Lamp find_lamp(const AnyFramesView& frames, const FrequencySearch& search) {
  FoundFrequency whole = find_in_frame(frames, search);
  if (is_everywhere(whole, shape_of(frames))) return {std::move(whole)};
  const auto lamp = strongest_lamp(frames, search);
  if (!lamp) {
    if (answered(whole)) whole.flags |= flag::model_misfit;
    return {std::move(whole)};
  }
  const LightSource& light = *lamp;
  const bool contested = answered(whole) && !agree(whole.frequency, whole.frequency_std, light);
  if (contested &&
      explained_energy(frames, whole.frequency) > explained_energy(part_of(frames, light.box), light.frequency)) {
    whole.flags |= flag::model_misfit;
    return {std::move(whole)};
  }
  // The columns of the box among those of the frame.
  const ToneColumns own = tone_columns(part_of(frames, light.box), light.frequency, search.saturation);
  const std::size_t columns = shape_of(frames).columns;
  const auto first = static_cast<std::ptrdiff_t>(light.box.x);
  ToneColumns all{std::vector<std::uint8_t>(columns), std::vector<double>(columns), own.saturated};
  std::ranges::copy(own.used, all.used.begin() + first);
  std::ranges::copy(own.strength, all.strength.begin() + first);
  const bool doubtful = contested || light.probability < likely || is_narrow(all);
  const Flags flags = (own.saturated ? flag::saturated : 0) | (doubtful ? flag::model_misfit : 0);
  return {{light.frequency, light.frequency_std, light.snr, harmonics, flags, std::move(all)}, light.probability};
}

}  // namespace

FoundFrequency find_lamp_frequency(const AnyFramesView& frames, const FrequencySearch& search) {
  return find_lamp(frames, search).found;
}

std::size_t pick_colour(std::span<const AnyFramesView> colours, const FrequencySearch& search) {
  require(!colours.empty(), "colours", "0 colours", "at least one");
  constexpr Flags doubtful = flag::few_cycles | flag::at_bound | flag::model_misfit;
  std::size_t best = 0;
  auto best_rank = std::pair{true, std::numeric_limits<double>::infinity()};
  for (std::size_t colour = 0; colour < colours.size(); ++colour) {
    const FoundFrequency found = find_lamp_frequency(colours[colour], search);
    if ((found.flags & flag::no_tone) != 0) continue;
    const auto rank = std::pair{(found.flags & doubtful) != 0, found.frequency_std / found.frequency};
    if (rank < best_rank) {
      best_rank = rank;
      best = colour;
    }
  }
  return best;
}

Calibration calibrate(const AnyFramesView& frames, double frequency, const FrequencySearch& search) {
  require_positive("frequency", frequency);
  Lamp lamp = find_lamp(frames, search);
  FoundFrequency& found = lamp.found;
  const double row_time = found.frequency / frequency, row_time_std = found.frequency_std / frequency;
  if (row_time * static_cast<double>(shape_of(frames).rows) > longest_frame) found.flags |= flag::model_misfit;
  return {row_time, row_time_std, std::move(found), lamp.probability};
}

}  // namespace ocisac
