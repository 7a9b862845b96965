#include "ocisac/lights/calibrate.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "core/levels.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/lights/detect_sources.hpp"
#include "ocisac/tones/periodic_fit.hpp"
#include "ocisac/tones/tone_columns.hpp"

namespace ocisac {

namespace {

constexpr double kSameFrequency = 6;  // standard errors; text and lines shift a tone of the whole frame by 5
constexpr double kFewCycles = 2;
constexpr double kLongestFrame = 1;    // s
constexpr double kShortestRow = 1e-7;  // s

double energy_of(const LightSource& light) {
  return 0.5 * light.amplitude * light.amplitude * static_cast<double>(light.box.pixels());
}

// How far a frequency with this standard error may lie from that of the light.
double reach_of(double frequency_std, const LightSource& light) {
  return kSameFrequency * std::hypot(frequency_std, light.frequency_std);
}

bool agree(double frequency, double frequency_std, const LightSource& light) {
  return std::abs(frequency - light.frequency) <= reach_of(frequency_std, light);
}

// The box of a light with others of its frequency, and the frequency by all of them in all frames. Of thin pulses near
// a whole number of rows a cycle, rows show bursts: each passes for a light and has, alone, another frequency.
void measure_together(LightSource& light, std::span<const LightSource> lights, const AnyFramesView& frames,
                      FrequencySearch search) {
  Region all = light.box;
  std::size_t count = 0;
  for (const LightSource& other : lights) {
    if (!agree(other.frequency, other.frequency_std, light)) continue;
    all = hull(all, other.box);
    ++count;
  }
  if (count < 2) return;
  const double reach = reach_of(0, light);
  search.lower = std::max(search.lower, light.frequency - reach);
  search.upper = std::min(search.upper, light.frequency + reach);
  const FoundFrequency found = find_frequency(part_of(frames, all), search);
  if ((found.flags & (flag::no_tone | flag::at_bound)) != 0) return;
  light.box = all;
  light.frequency = found.frequency;
  light.frequency_std = found.frequency_std;
  light.snr = found.snr;
}

// The lights of the first frame within the bounds of the search; a swing of more energy comes first.
std::vector<LightSource> lamps_of(const AnyFramesView& frames, const FrequencySearch& search) {
  Camera per_row;
  per_row.row_time = 1;
  auto lights = detect_sources(frame_of(frames, 0), per_row, {.false_alarms = 1});
  std::erase_if(lights, [&](const LightSource& light) {
    return light.frequency < search.lower || light.frequency > search.upper;
  });
  std::ranges::stable_sort(lights, std::ranges::greater{}, energy_of);
  return lights;
}

bool answered(const FoundFrequency& found) {
  return (found.flags & (flag::no_tone | flag::at_bound | flag::few_cycles)) == 0;
}

bool is_narrow(const ToneColumns& columns) {
  return static_cast<double>(std::ranges::count(columns.used, 1)) <
         kNextToNone * static_cast<double>(columns.used.size());
}

// True if the tone explains the whole frame: outlines, text and lines leave less.
bool is_everywhere(const FoundFrequency& found) {
  return answered(found) && found.snr >= kSure && !is_narrow(found.columns);
}

// Without a lower bound, frequencies of at least two cycles in the frame are searched first, lower ones only if no tone
// is found.
FoundFrequency find_in_frame(const AnyFramesView& frames, const FrequencySearch& search) {
  const double lowest = kFewCycles / static_cast<double>(std::max<std::size_t>(shape_of(frames).rows, 1));
  if (search.lower == 0 && lowest < std::min(search.upper, 0.5)) {
    FrequencySearch from_two = search;
    from_two.lower = lowest;
    FoundFrequency found = find_frequency(frames, from_two);
    if (answered(found)) return found;
  }
  return find_frequency(frames, search);
}

// The row time is yet to be found.
Calibration find_lamp(const AnyFramesView& frames, const FrequencySearch& search) {
  FoundFrequency whole = find_in_frame(frames, search);
  if (is_everywhere(whole)) return {kNaN, kNaN, std::move(whole), kNaN};
  const std::vector<LightSource> lamps = lamps_of(frames, search);
  if (lamps.empty()) {
    if (answered(whole)) whole.flags |= flag::model_misfit;
    return {kNaN, kNaN, std::move(whole), kNaN};
  }
  LightSource light = lamps.front();
  measure_together(light, lamps, frames, search);
  // The error of a misfit is no allowance, and it supports no light.
  const bool misfit = (whole.flags & flag::model_misfit) != 0 && !whole.may_be_texture;
  const double allowed = misfit ? 0 : whole.frequency_std;
  const bool contested = answered(whole) && !agree(whole.frequency, allowed, light);
  // The columns of the box among those of the frame.
  const ToneColumns own = tone_columns(part_of(frames, light.box), light.frequency, search.saturation);
  const std::size_t columns = shape_of(frames).columns;
  const auto first = static_cast<std::ptrdiff_t>(light.box.x);
  ToneColumns all{std::vector<std::uint8_t>(columns), std::vector<double>(columns), own.saturated};
  std::ranges::copy(own.used, all.used.begin() + first);
  std::ranges::copy(own.strength, all.strength.begin() + first);
  // A lamp that is no likely tone, such as data, counts only beside a tone of the whole frame.
  const bool uncertain = light.share == 0 || light.probability < kMostly;
  // Pulses may have weaker ones between them, or a fundamental that is folded, which the whole frame shows.
  const bool doubted = misfit && (whole.is_folded || whole.harmonics > kComparedHarmonics) &&
                       agree(whole.frequency, whole.frequency_std, light);
  const bool doubtful = contested || doubted || (uncertain && (misfit || !answered(whole))) || is_narrow(all);
  const Flags flags = flag_if(own.saturated, flag::saturated) | flag_if(doubtful, flag::model_misfit);
  return {kNaN, kNaN, {light.frequency, light.frequency_std, light.snr, 3, flags, std::move(all)}, light.probability};
}

}  // namespace

FoundFrequency find_lamp_frequency(const AnyFramesView& frames, const FrequencySearch& search) {
  return find_lamp(frames, search).found;
}

std::size_t pick_colour(std::span<const AnyFramesView> colours, const FrequencySearch& search) {
  require(!colours.empty(), "colours", "0 colours", "at least one");
  constexpr Flags kDoubtful = flag::few_cycles | flag::at_bound | flag::model_misfit;
  std::size_t best = 0;
  auto best_rank = std::pair{true, std::numeric_limits<double>::infinity()};
  for (std::size_t colour = 0; colour < colours.size(); ++colour) {
    const FoundFrequency found = find_lamp_frequency(colours[colour], search);
    if ((found.flags & flag::no_tone) != 0) continue;
    const auto rank = std::pair{(found.flags & kDoubtful) != 0, -found.snr};
    if (rank < best_rank) {
      best_rank = rank;
      best = colour;
    }
  }
  return best;
}

Calibration calibrate(const AnyFramesView& frames, double frequency, const FrequencySearch& search) {
  require_positive("frequency", frequency);
  Calibration lamp = find_lamp(frames, search);
  if (is_everywhere(lamp.found) && std::isnan(lamp.probability)) {
    const std::vector<LightSource> lamps = lamps_of(frames, search);
    const auto same = std::ranges::find_if(
        lamps, [&](const LightSource& one) { return agree(lamp.found.frequency, lamp.found.frequency_std, one); });
    if (same != lamps.end()) lamp.probability = same->probability;
  }
  lamp.row_time = lamp.found.frequency / frequency;
  lamp.row_time_std = lamp.found.frequency_std / frequency;
  if (lamp.row_time < kShortestRow || lamp.row_time * static_cast<double>(shape_of(frames).rows) > kLongestFrame)
    lamp.found.flags |= flag::model_misfit;
  return lamp;
}

}  // namespace ocisac
