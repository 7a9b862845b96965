#include "ocisac/lights/detect_sources.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <utility>

#include "core/check_interrupt.hpp"
#include "lights/detection.hpp"
#include "lights/refinement.hpp"
#include "lights/screening.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/lights/known_light.hpp"
#include "ocisac/tones/find_frequency.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kMaxSuspects = 256;
constexpr std::size_t kMinColumns = 8;  // beside a light
constexpr double kSeenBefore = 10;      // odds of a light that the last frame showed here

IndexRange all_columns(const SearchedFrame& in) { return {0, shape_of(in.frame.frames).columns}; }

std::vector<Suspect> suspects_in(const SearchedFrame& in, const Region& region, bool by_rows) {
  auto suspects = screen_sources(in.frame, region, in.options.false_alarms, by_rows);
  suspects.resize(std::min(suspects.size(), kMaxSuspects));
  return suspects;
}

// Refinement that sees the columns `within` alone.
std::optional<RefinedLight> refine(const SearchedFrame& in, Suspect suspect, const IndexRange& within,
                                   bool inside = false) {
  LitFrame part = in.frame;
  part.frames = part_of(in.frame.frames, {within.begin, 0, within.size(), shape_of(in.frame.frames).rows});
  suspect.box.x -= within.begin, suspect.best.x -= within.begin;
  auto light = refine_source(part, suspect, in.options.min_cycles, inside);
  if (light) light->box.x += within.begin;
  return light;
}

LightCandidate candidate_of(const SearchedFrame& in, const Detection& one, std::vector<double> terms) {
  return {one.light.box, one.light.frequency / in.camera.row_time, one.probability, one.odds, std::move(terms)};
}

Suspect suspect_at(const Region& box, double frequency) { return {box, frequency, 1, 0, box}; }

bool belongs_to(const Suspect& suspect, const RefinedLight& light) {
  return is_explained(suspect, light) || contains(suspect, light);
}

// The tone of a suspect: that of the inner box about its clearest tile where the whole one does not convince.
std::optional<Detection> most_probable(const SearchedFrame& in, const Suspect& suspect, const Detections& found) {
  const auto tone = [&](const Suspect& of, bool inside) {
    const auto light = refine(in, of, all_columns(in), inside);
    return light ? judged(in, *light, found) : std::nullopt;
  };
  const auto whole = tone(suspect, false);
  if (whole && is_convincing(in, *whole)) return whole;
  const auto inner = tone({suspect.best, suspect.frequency, suspect.share, 0, suspect.best}, true);
  const bool better = inner && (!whole || inner->probability > whole->probability);
  return better ? inner : whole;
}

// Judges a suspect that no light explains.
Detections with_tone_of(const SearchedFrame& in, Detections found, const Suspect& suspect) {
  if (std::ranges::any_of(found.lights, [&](const Detection& one) { return is_explained(suspect, one.light); }))
    return found;
  if (const auto one = most_probable(in, suspect, found))
    (is_convincing(in, *one) ? found.lights : found.doubtful).push_back(*one);
  return found;
}

// A light that is lit for a small part of its period has many harmonics: no tile shows much of one, columns show all.
Detections with_pulses(const SearchedFrame& in, Detections found, Region box) {
  FrequencySearch search;
  search.lower = std::min(in.options.min_cycles / static_cast<double>(box.height), 0.25);
  const FoundFrequency tone = find_frequency(part_of(frame_of(in.frame.frames, in.frame.index), box), search);
  if (tone.flags & ~flag::model_misfit) return found;
  const IndexRange columns = extent_of(tone.columns.used);
  box.x += columns.begin;
  box.width = columns.size();
  const auto one = most_probable(in, suspect_at(box, tone.frequency), found);
  if (one && is_convincing(in, *one) && covers(one->light.box, box)) found.lights.push_back(*one);
  return found;
}

Detections with_tones(const SearchedFrame& in, Detections found, std::span<const Suspect> suspects,
                      std::span<const double> frequencies) {
  for (const Suspect& suspect : suspects) {
    check_interrupt();
    const auto near = [&](double frequency) { return near_frequency(suspect.frequency, frequency); };
    if (frequencies.empty() || std::ranges::any_of(frequencies, near))
      found = with_tone_of(in, std::move(found), suspect);
  }
  return found;
}

// Suspects that belong to lights are no chances of a texture: without them, a fainter light may convince. `earlier`:
// number of lights found before this search.
Detections reconsidered(const SearchedFrame& in, Detections found, std::span<const Suspect> suspects,
                        std::size_t earlier) {
  for (;;) {
    found.suspects = 1 + static_cast<std::size_t>(std::ranges::count_if(suspects, [&](const Suspect& suspect) {
                       return std::ranges::none_of(
                           found.lights, [&](const Detection& one) { return belongs_to(suspect, one.light); });
                     }));
    for (std::size_t i = earlier; i < found.lights.size(); ++i) found.lights[i] = judged_again(found.lights[i], found);
    for (Detection& one : found.doubtful) one = judged_again(one, found);
    const auto next = std::ranges::find_if(found.doubtful, [&](const Detection& one) {
      return is_convincing(in, one) && !is_double_of_any(one, found.lights);
    });
    if (next == found.doubtful.end()) break;
    const Detection one = *next;
    found.doubtful.erase(next);
    found.lights.push_back(one);
  }
  const auto first = found.lights.begin() + static_cast<std::ptrdiff_t>(earlier);
  const auto rest =
      std::stable_partition(first, found.lights.end(), [&](const Detection& one) { return is_convincing(in, one); });
  found.doubtful.insert(found.doubtful.end(), rest, found.lights.end());
  found.lights.erase(rest, found.lights.end());
  return found;
}

// A lamp of another frequency in the columns `within` beside a light; `searched`: those near it.
Detections with_lamps_beside(const SearchedFrame& in, Detections found, const RefinedLight& light,
                             const Region& searched, const IndexRange& within) {
  if (searched.width < kMinColumns) return found;
  for (const Suspect& suspect : suspects_in(in, searched, true)) {
    const auto known = [&](const Detection& one) {
      return covers(one.light.box, suspect.box) || contains(suspect, one.light);
    };
    if (std::ranges::any_of(found.lights, known) ||
        one_light_across(in.frame, light.box, suspect.box, std::min(light.frequency, suspect.frequency)))
      continue;
    const auto other = refine(in, suspect, within);
    const auto one = other && !same_frequency(*other, light) ? judged(in, *other, found) : std::nullopt;
    if (one && is_convincing(in, *one) && !is_double_of_any(*one, found.lights)) found.lights.push_back(*one);
  }
  return found;
}

// Tiles that resolve a light's cycle are up to two cycles wide and show the light alone where a lamp beside it is
// narrower. The columns beside it are screened by themselves, for lamps of other frequencies.
Detections searched_beside(const SearchedFrame& in, Detections found, const RefinedLight light) {
  const Shape shape = shape_of(in.frame.frames);
  const auto cycle = static_cast<std::size_t>(std::lround(1 / light.frequency));
  const std::size_t right = std::min(light.box.right(), shape.columns);
  Region near = widened(light.box, std::max(light.box.height, 2 * cycle));
  near.y = light.box.y - std::min(light.box.y, 2 * cycle);
  near.height = std::min(light.box.bottom() + 2 * cycle, shape.rows) - near.y;
  const std::size_t end = std::max(right, std::min(near.right(), shape.columns));
  found = with_lamps_beside(in, std::move(found), light, {near.x, near.y, light.box.x - near.x, near.height},
                            {0, light.box.x});
  return with_lamps_beside(in, std::move(found), light, {right, near.y, end - right, near.height},
                           {right, shape.columns});
}

// True for a tone, and for lamps above each other, whose columns also have a common swing.
bool is_made_of_tones(const RefinedLight& light, std::span<const Detection> lights) {
  std::vector<std::uint8_t> rows(light.box.height);
  for (const Detection& one : lights) {
    const Region& box = one.light.box;
    if (!is_tone(one) || !is_settled(one) || shared_length(box.x, box.width, light.box.x, light.box.width) == 0)
      continue;
    const std::size_t first = std::clamp(box.y, light.box.y, light.box.bottom());
    const std::size_t end = std::clamp(box.bottom(), light.box.y, light.box.bottom());
    std::fill_n(rows.begin() + static_cast<std::ptrdiff_t>(first - light.box.y), end - first, std::uint8_t{1});
  }
  return 4 * static_cast<std::size_t>(std::ranges::count(rows, 1)) > 3 * rows.size();
}

Detections with_data(const SearchedFrame& in, Detections found, std::span<const Suspect> suspects) {
  std::vector<RefinedLight> tones;  // that were joined into lights
  const std::size_t unexplained = std::exchange(found.suspects, suspects.size());
  for (const Suspect& suspect : suspects) {
    check_interrupt();
    // In other columns, a tone has its own frequency alone.
    const auto explains = [&](const RefinedLight& light) {
      const bool beside = 2 * shared_length(light.box.x, light.box.width, suspect.box.x, suspect.box.width) <
                          std::min(light.box.width, suspect.box.width);
      return belongs_to(suspect, light) && (!beside || near_frequency(suspect.frequency, light.frequency));
    };
    const auto settles = [&](const Detection& one) { return is_settled(one) && explains(one.light); };
    if (std::ranges::any_of(tones, explains) || std::ranges::any_of(found.lights, settles)) continue;
    const auto data = find_data_light(in.frame, suspect);
    auto one = data ? judged(in, *data, found) : std::nullopt;
    if (!one) continue;
    found.waveforms.push_back(candidate_of(in, *one, terms_of(*one, found)));
    if (!is_convincing(in, *one)) continue;
    if (is_made_of_tones(one->light, found.lights)) {
      tones.push_back(one->light);
      continue;
    }
    one->merged = std::erase_if(found.lights, [&](const Detection& other) {
      return !other.expected && shared_of_smaller(other.light.box, one->light.box) > 0.5;
    });
    found.lights.push_back(*one);
  }
  found.suspects = unexplained;
  return found;
}

// Frequency of a short light from its own pixels, without bias by its outline.
Detection sharpened(const SearchedFrame& in, Detection one) {
  RefinedLight& light = one.light;
  if (one.data || light.inside || static_cast<double>(light.box.height) * light.frequency > kLongestInner) return one;
  const auto own = refine(in, suspect_at(light.box, light.frequency), all_columns(in), true);
  if (!own || !near_frequency(own->frequency, light.frequency) || !is_measurable(in, {.light = *own, .box = own->box}))
    return one;
  light.frequency = own->frequency, light.frequency_std = own->frequency_std, light.phase = own->phase;
  return one;
}

// Adds the light if it is confirmed in the box and no other detection is there; returns false if not.
bool add_expected(const SearchedFrame& in, const Region& box, double cycles_per_row, Detections& found) {
  const auto light = refine_source(in.frame, suspect_at(box, cycles_per_row), in.options.min_cycles, false, 1);
  auto one = light ? judged(in, *light, found) : std::nullopt;
  if (!one) return false;
  one->expected = true;
  one->odds *= kSeenBefore;
  one->noise = light->chance;  // of one box and frequency
  *one = judged_again(*one, found);
  if (!is_convincing(in, *one)) return false;
  if (is_double_of_any(*one, found.lights)) return false;
  found.lights.push_back(*one);
  return true;
}

// Adds the lights of a region: tones of `frequencies` in cycles per row. Without frequencies: any tone, and data where
// no tone explains a suspect.
Detections searched(const SearchedFrame& in, Detections found, const Region& region,
                    std::span<const double> frequencies = {}) {
  const auto suspects = suspects_in(in, region, false);
  const std::size_t earlier = found.lights.size();
  found.suspects = suspects.size();
  found.doubtful.clear();
  found = with_tones(in, std::move(found), suspects, frequencies);
  if (frequencies.empty() && std::ranges::none_of(found.lights, is_settled))
    found = with_pulses(in, std::move(found), region);
  found = reconsidered(in, std::move(found), suspects, earlier);
  if (!frequencies.empty()) return found;
  for (std::size_t i = 0; i < found.lights.size(); ++i) {
    const Detection light = found.lights[i];
    if (std::none_of(found.lights.begin(), found.lights.begin() + static_cast<std::ptrdiff_t>(i),
                     [&](const Detection& one) { return are_doubles(one, light); }))
      found = searched_beside(in, std::move(found), light.light);
  }
  return with_data(in, std::move(found), suspects);
}

// The lights as listed: sharpened, without doubles, with joined parts and reflections, the most probable first.
std::vector<Detection> listed_lights(const SearchedFrame& in, const Detections& found) {
  std::vector<Detection> lights;
  for (const Detection& one : without_doubles(found.lights)) lights.push_back(sharpened(in, one));
  lights = without_doubles(std::move(lights));  // boxes of a light and of texture that it is part of
  lights = with_reflections(with_joined_parts(in.frame, std::move(lights)));
  lights.resize(std::min(lights.size(), in.options.max_sources));
  return by_probability(lights);
}

// All measurable tones of a frame, of any probability, with box and frequency of listed_lights().
std::vector<LightCandidate> tone_candidates(const SearchedFrame& in, const Detections& found) {
  auto tones = without_doubles(found.lights);
  auto doubtful = found.doubtful;
  std::ranges::stable_sort(doubtful, std::greater{}, &Detection::probability);
  for (const Detection& one : doubtful)
    if (!is_double_of_any(one, tones)) tones.push_back(one);
  std::vector<LightCandidate> all;
  for (const Detection& one : tones) {
    if (one.data) continue;
    const Detection now = judged_again(one, found);
    all.push_back(candidate_of(in, sharpened(in, now), terms_of(now, found)));
  }
  return all;
}

void check(const DetectOptions& options) {
  require(options.false_alarms > 0 && options.false_alarms <= 1, "false_alarms", options.false_alarms,
          "above 0 up to 1 in a picture");
  require(std::isfinite(options.min_cycles) && options.min_cycles >= 2, "min_cycles", options.min_cycles,
          "a finite number, 2 or above");
  require(options.max_sources >= 1, "max_sources", options.max_sources, "1 or above");
}

LightSource source_of(const SearchedFrame& in, const Detection& found) {
  const RefinedLight& light = found.light;
  const double row_time = in.camera.row_time, frequency = light.frequency / row_time;
  const MeasuredLight gain = box_gain(frame_of(in.frame.frames, in.frame.index), in.camera, light.box, frequency);
  LightSource source;
  source.frame = in.frame.index;
  source.box = found.box;
  source.probability = found.probability;
  source.frequency = frequency;
  source.frequency_std = std::hypot(light.frequency_std, light.systematic.std) / row_time;
  source.gain = gain.gain, source.gain_std = gain.gain_std;
  source.phase = gain.phase;
  source.mean = gain.mean;
  source.snr = light.snr;
  source.amplitude = light.amplitude;
  source.share = light.edges > 0 ? 0 : light.periodic;  // none of data
  source.carries_data = !is_tone(found);
  source.reflection_of = found.reflection_of;
  source.reflection_by_phase = found.reflection_by_phase;
  source.merged = found.merged;
  source.joined = found.joined;
  source.flags = gain.flags | flag_if(light.systematic.doubted, flag::model_misfit);
  return source;
}

std::vector<LightSource> sources_of(const SearchedFrame& in, const Detections& found) {
  std::vector<LightSource> sources;
  for (const Detection& one : listed_lights(in, found)) sources.push_back(source_of(in, one));
  return sources;
}

Region whole(const Shape& shape) { return {0, 0, shape.columns, shape.rows}; }

void check(const ExpectedLight& light, const Shape& shape, const Camera& camera) {
  require_inside("box", light.box, shape.columns, shape.rows);
  require_inside("region", light.region, shape.columns, shape.rows);
  require(light.frequency > 0 && light.frequency * camera.row_time < 0.5, "frequency", light.frequency,
          "above 0, below half the row rate");
}

}  // namespace

std::vector<LightSource> detect_sources(const AnyFramesView& frames, const Camera& camera,
                                        const DetectOptions& options) {
  check(frames, kMostLight);
  check(camera);
  check(options);
  std::vector<LightSource> sources;
  const Shape shape = shape_of(frames);
  require(options.frame.value_or(0) < shape.frames, "frame", options.frame.value_or(0), "a frame of those given");
  const std::size_t first = options.frame.value_or(0), end = options.frame ? first + 1 : shape.frames;
  for (std::size_t frame = first; frame < end; ++frame) {
    const SearchedFrame in{lit_frame(frames, frame, camera.tone_curve), camera, options};
    const std::vector<LightSource> found = sources_of(in, searched(in, {}, whole(shape)));
    sources.insert(sources.end(), found.begin(), found.end());
  }
  return sources;
}

std::vector<LightCandidate> light_candidates(const AnyFramesView& frame, const Camera& camera, bool data) {
  check(frame);
  check(camera);
  const SearchedFrame in{lit_frame(frame, 0, camera.tone_curve), camera, {.min_cycles = 2}};
  const Detections found = searched(in, {}, whole(shape_of(frame)));
  return data ? found.waveforms : tone_candidates(in, found);
}

std::vector<LightSource> follow_sources(const AnyFramesView& frame, const Camera& camera,
                                        std::span<const ExpectedLight> expected, const DetectOptions& options) {
  check(frame);
  check(camera);
  check(options);
  const Shape shape = shape_of(frame);
  require(shape.frames == 1, "frame", shape.frames, "one frame");
  for (const ExpectedLight& light : expected) check(light, shape, camera);
  const SearchedFrame in{lit_frame(frame, 0, camera.tone_curve), camera, options};
  Detections found;
  std::vector<const ExpectedLight*> missing;
  for (const ExpectedLight& light : expected) {
    const double cycles_per_row = light.frequency * camera.row_time;
    if (light.seen && !light.data && add_expected(in, light.box, cycles_per_row, found)) continue;
    missing.push_back(&light);
  }
  for (const ExpectedLight* light : missing) {
    const double cycles_per_row = light->frequency * camera.row_time;
    found = searched(in, std::move(found), light->region, {&cycles_per_row, light->data ? 0U : 1U});
  }
  return sources_of(in, found);
}

}  // namespace ocisac
