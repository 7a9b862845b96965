#include "ocisac/lights/detect_sources.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>
#include <numeric>
#include <span>
#include <utility>

#include "core/check_interrupt.hpp"
#include "lights/box_gain.hpp"
#include "lights/data_light.hpp"
#include "lights/light_probability.hpp"
#include "lights/merging.hpp"
#include "lights/phase_odds.hpp"
#include "lights/refinement.hpp"
#include "lights/screening.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr std::size_t max_suspects = 256;
constexpr double min_rows = 24;         // of a box
constexpr std::size_t min_columns = 8;  // beside a light
constexpr double min_periodic = 0.4;    // fraction of the swing common to the columns
constexpr double max_uneven = 0.25;
constexpr double clear_probability = 0.83, clear_periodic = 0.9;  // of a lamp: a few cycles suffice
constexpr double default_false_alarms = 0.02;
constexpr double tone_odds = 3, data_odds = 9;  // required at that rate; few photographs show what resembles data
constexpr double edge_evidence = 0.5;           // nats
constexpr double data_texture = 0.3;            // relative to the bound for a tone
constexpr double data_periodic = 0.7;           // upper bound; a tone or a square wave has more
constexpr double largest_spread = 0.03, largest_own_spread = 0.015;  // max relative standard error of a frequency
constexpr double frequency_apart = 0.04;  // relative: parts that differ by more belong to a light that sends data
constexpr double settled_cycles = 5, settled_periodic = 0.95;
constexpr double faint_level = 0.1;
constexpr double much_clearer = 1.5;  // ratio of signal-to-noise ratios
constexpr double edges_beyond = 1.5;  // cycles that both edges of a whole box may lie beyond those of the own pixels
constexpr double shortest_inner = 2;  // cycles of an inner box; its outline may be longer
constexpr double reflection_level = 0.5;  // min strength relative to another light for a separate light

void check(const DetectOptions& options) {
  require(options.false_alarms > 0 && options.false_alarms <= 1, "false_alarms", options.false_alarms,
          "above 0 up to 1 in a picture");
  require(std::isfinite(options.min_cycles) && options.min_cycles >= 2, "min_cycles", options.min_cycles,
          "a finite number, 2 or above");
  require(options.max_sources >= 1, "max_sources", options.max_sources, "1 or above");
}

struct Found {
  RefinedLight light;  // the strongest part
  LightPart part;      // with the box of all parts
  std::size_t merged = 0;
  bool joined = false;  // of parts beside or above each other
  bool data = false;    // frequencies differ, or no tone spans the parts
  bool known = false;   // from the last frame
  std::optional<std::size_t> reflection_of = {};
  bool by_phase = false;
  double odds = 1;         // by the phase in other frames
  double alone = 0;        // probability without regard to other lights
  double probability = 0;  // with regard to them
  double told = 0;         // corrected
};

bool one_frequency(double f, double g) { return std::abs(f - g) <= frequency_apart * std::max(f, g); }

// Approximate total flux of the box.
double flux(const RefinedLight& light) { return light.amplitude * static_cast<double>(light.box.pixels()); }

double size_of(const RefinedLight& light) {
  return light.amplitude * std::sqrt(static_cast<double>(light.box.pixels()));
}

double with_odds(double probability, double factor) {
  return probability * factor / (probability * factor + 1 - probability);
}

// Probability required of a light, so that pictures without lights have `false_alarms` on average.
double probability_for(double odds, double false_alarms) {
  return with_odds(0.5, odds * default_false_alarms / false_alarms);
}

// One stored step: smaller swings are often compression artefacts.
double min_amplitude(const AnyFramesView& frames) { return holds_integers(frames) ? 1 : 0; }

// Evidence required of data: on 400 pictures of overlapping boxes false detections fall as e^(−evidence/1.2), and the
// rate is a quarter of the requested one.
double data_evidence_for(std::size_t suspects, double false_alarms) {
  return std::log(static_cast<double>(std::max<std::size_t>(suspects, 1))) - 1.2 * std::log(false_alarms) + 3;
}

// Max texture relative to the periodic swing; lines of text have more. The bound decreases for few columns, which may
// be similar by chance.
double max_texture(const RefinedLight& light) { return 0.8 * std::min(1.0, static_cast<double>(light.box.width) / 24); }

bool measurable(const DataLight& data, const LightLimits& limits, double min_evidence) {
  const RefinedLight& light = data.light;
  return static_cast<double>(light.box.height) >= limits.rows &&
         0.5 * static_cast<double>(data.edges) >= limits.cycles && light.amplitude >= limits.amplitude &&
         edge_evidence * static_cast<double>(data.edges) + data.clock >= min_evidence && light.snr >= 1 &&
         light.texture <= data_texture * max_texture(light);
}

// True for texture that varies periodically with the rows, unlike a picture under a light.
bool like_text(const RefinedLight& light) { return light.texture > 0.25 && light.uneven > max_uneven; }

// The pixels of an outline agree with a tone, or it is none.
bool measurable(const RefinedLight& light, const LightLimits& limits) {
  const auto height = static_cast<double>(light.box.height);
  const double spread = (light.inside ? largest_own_spread : largest_spread) * light.frequency;
  if (height < limits.rows || height * light.frequency < limits.cycles || light.amplitude < limits.amplitude ||
      !(light.frequency_std <= spread))
    return false;
  return light.inside || (light.texture <= max_texture(light) && !like_text(light) && light.periodic >= min_periodic);
}

// −ln of the probability that texture looks as periodic; its variation in a box counts as one independent cell per
// cycle.
double evidence(const RefinedLight& light) {
  return std::log1p(light.snr) * static_cast<double>(light.box.height) * light.frequency;
}

// Evidence required of a suspect that is not clearly a lamp. On 600 pictures of overlapping boxes, the background with
// most chance alignments of edges, false detections fall as e^(−evidence/1.6). Below one in 50 pictures, where three
// bars can be even without noise, they fall as e^(−evidence/2.6).
double evidence_for(std::size_t suspects, double false_alarms) {
  return std::log(static_cast<double>(std::max<std::size_t>(suspects, 1))) - 1.6 * std::log(false_alarms) -
         std::min(std::log(false_alarms / 0.02), 0.0) - 0.3;
}

bool clean(const Found& one) { return !one.data && one.light.periodic >= data_periodic; }

// True if the detection is certain to be no part of a light that sends data, whose chips alternate for fewer cycles.
bool settled(const Found& one) {
  const double cycles = static_cast<double>(one.light.box.height) * one.light.frequency;
  return one.data || one.known ||
         (clean(one) && (cycles >= settled_cycles || (cycles >= 3 && one.light.periodic >= settled_periodic)));
}

// Compares frequencies with a tolerance: texture under a faint reflection biases its frequency by more than the
// standard error.
bool same_frequency(const RefinedLight& weak, const RefinedLight& strong) {
  const double spread = 3 * std::hypot(weak.frequency_std, strong.frequency_std) + 0.002 * strong.frequency;
  const double lowest = weak.amplitude < faint_level * strong.amplitude ? 0.03 * strong.frequency : 0;
  return std::abs(weak.frequency - strong.frequency) <= std::clamp(spread, lowest, 0.05 * strong.frequency);
}

// Compares frequencies; that of a suspect or tile is accurate to half a cycle of at least 2.5.
bool may_show(const auto& suspect, double frequency) {
  return std::abs(suspect.frequency - frequency) <= 0.25 * frequency;
}

bool covers(const Region& box, const Region& part) { return 2 * shared_pixels(part, box) > part.pixels(); }

// True if a suspect or tile lies in a light's box, or at most a cycle above or below it, or beside it at a frequency of
// that light: it needs no refinement.
bool explained(const auto& suspect, const RefinedLight& light) {
  const auto cycle = static_cast<std::size_t>(std::lround(1 / light.frequency));
  const bool harmonic =
      std::ranges::any_of(std::array{1, 2, 3}, [&](int order) { return may_show(suspect, order * light.frequency); });
  Region reach = widened(light.box, cycle);
  if (!harmonic) reach.x = light.box.x, reach.width = light.box.width;
  return covers(reach, suspect.box);
}

// True if a coarse suspect contains a light of its frequency.
bool holds(const Suspect& suspect, const RefinedLight& light) {
  return 2 * shared_pixels(suspect.box, light.box) > light.box.pixels() && may_show(suspect, light.frequency);
}

LightPart part_of(const RefinedLight& light) { return {light.box, light.frequency}; }

// True if boxes share half of the smaller one at any frequency; lights known to be separate may cross.
bool doubles(const Found& a, const Found& b) {
  return shared_of_smaller(a.light.box, b.light.box) > 0.5 &&
         !(a.known && b.known && !one_frequency(a.light.frequency, b.light.frequency));
}

// Merges double detections of a light into the stronger one.
std::vector<Found> without_doubles(std::vector<Found> lights) {
  std::ranges::stable_sort(lights, std::greater{}, [](const Found& one) { return size_of(one.light); });
  std::vector<Found> kept;
  for (const Found& one : lights) {
    const auto twin = std::ranges::find_if(kept, [&](const Found& other) { return doubles(one, other); });
    if (twin == kept.end())
      kept.push_back(one);
    else
      ++twin->merged;
  }
  return kept;
}

// Joins the parts of a light that sends data, which is periodic in places; repeats with the joined parts. `across`,
// `down`: predicates for two parts of one light.
template <class Across, class Down>
void join_parts(std::vector<Found>& found, const Across& across, const Down& down) {
  for (std::size_t i = 0; i < found.size(); ++i)
    for (std::size_t k = i + 1; k < found.size();) {
      Found &one = found[i], &other = found[k];
      const bool beside = across(one.part, other.part);
      if (!beside && !down(one.part, other.part)) {
        ++k;
        continue;
      }
      one.known = one.known || other.known;
      one.told = std::max(one.told, other.told);
      one.data = one.data || other.data || !beside || !one_frequency(one.light.frequency, other.light.frequency);
      one.merged += 1 + other.merged;
      one.joined = true;
      one.part.box = hull(one.part.box, other.part.box);
      found.erase(found.begin() + static_cast<std::ptrdiff_t>(k));
      k = i + 1;
    }
}

// A reflection has the light's phase at row 0. If the distance in rows is too large to extrapolate the phase, only
// frequencies are compared.
void find_reflections(std::vector<Found>& found) {
  for (std::size_t i = 1; i < found.size(); ++i)
    for (std::size_t k = 0; k < i && !found[i].reflection_of && !found[i].known; ++k) {
      const RefinedLight &weak = found[i].light, &strong = found[k].light;
      if (found[k].reflection_of || !same_frequency(weak, strong) || flux(weak) > reflection_level * flux(strong))
        continue;
      // Phases at the centre of the weaker light: the error of its own frequency does not matter there.
      const auto middle = [](const RefinedLight& light) {
        return static_cast<double>(light.box.y) + 0.5 * static_cast<double>(light.box.height);
      };
      const double between = middle(weak) - middle(strong);
      const double spread = 2 * std::numbers::pi * std::abs(between) * strong.frequency_std + 0.3;
      const double apart = std::remainder(
          weak.phase - strong.phase + 2 * std::numbers::pi * middle(weak) * (weak.frequency - strong.frequency),
          2 * std::numbers::pi);
      const bool phase_known = spread < 1;
      if (phase_known && std::abs(apart) > 3 * spread) continue;
      found[i].reflection_of = k;
      found[i].by_phase = phase_known;
    }
}

// The most probable first, then the strongest.
std::vector<Found> by_probability(const std::vector<Found>& found) {
  std::vector<std::size_t> order(found.size()), place(found.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, std::greater{}, [&](std::size_t i) { return found[i].told; });
  for (std::size_t k = 0; k < order.size(); ++k) place[order[k]] = k;
  std::vector<Found> sorted;
  for (const std::size_t i : order) {
    sorted.push_back(found[i]);
    if (auto& of = sorted.back().reflection_of) of = place[*of];
  }
  return sorted;
}

LightSource source_of(const AnyFramesView& frames, std::size_t frame, const Camera& camera, const Found& found) {
  const RefinedLight& light = found.light;
  const double frequency = light.frequency / camera.row_time;
  const BoxGain gain = box_gain(frame_of(frames, frame), camera, light.box, frequency);
  LightSource source;
  source.frame = frame;
  source.box = found.part.box;
  source.probability = found.told;
  source.frequency = frequency;
  source.frequency_std = light.frequency_std / camera.row_time;
  source.gain = gain.gain, source.gain_std = gain.gain_std;
  source.phase = gain.phase;
  source.mean = gain.mean;
  source.snr = light.snr;
  source.amplitude = light.amplitude;
  source.share = light.periodic;
  source.carries_data = found.data || light.periodic < data_periodic;
  source.reflection_of = found.reflection_of;
  source.reflection_by_phase = found.by_phase;
  source.merged = found.merged;
  source.joined = found.joined;
  source.flags = gain.flags;
  return source;
}

using Columns = std::pair<std::size_t, std::size_t>;  // [first, second)

// Detection of lights in one frame.
class Look {
 public:
  Look(const AnyFramesView& frames, std::size_t frame, const Camera& camera, const DetectOptions& options)
      : frames_(frames),
        frame_(frame),
        camera_(camera),
        options_(options),
        limits_{min_rows, options.min_cycles, min_amplitude(frames)},
        least_probability_(probability_for(tone_odds, options.false_alarms)) {
    // A memoryless curve preserves every period, and stored values resolve darkness best.
    stored_.dark_level = camera.tone_curve.dark_level;
    stored_.white_level = camera.tone_curve.white_level;
    floor_ = logarithm_floor(frames, stored_);
  }

  // Returns true if the expected light is confirmed at its place and no other detection is there.
  bool find_expected(const Region& box, double cycles_per_row) {
    const Suspect suspect{box, cycles_per_row, 1, 0, box};
    const auto light = refine_source(frames_, frame_, stored_.dark_level, suspect, floor_, limits_, whole_box, 1);
    auto one = light ? judged(*light) : std::nullopt;
    if (!one || !convincing(*one)) return false;
    one->known = true;
    if (std::ranges::any_of(found_, [&](const Found& other) { return doubles(*one, other); })) return false;
    found_.push_back(*one);
    return true;
  }

  // Detects the lights of a region except those already found: tones of `frequencies` in cycles per row. Without
  // frequencies: any tone, and data where no tone explains a suspect.
  void search(const Region& region, std::span<const double> frequencies = {}) {
    const auto suspects = suspects_in(region, Coarsening::both);
    const std::size_t earlier = found_.size();
    suspects_ = suspects.size();
    refused_.clear();
    find_tones(suspects, frequencies, {0, shape_of(frames_).columns});
    judge_again(suspects, earlier);
    if (!frequencies.empty()) return;
    for (std::size_t i = 0; i < found_.size(); ++i)
      if (std::ranges::none_of(std::span(found_).first(i), [&](const Found& one) { return doubles(one, found_[i]); }))
        search_beside(found_[i].light);
    find_data(suspects);
  }

  // All measurable tones of a frame, or waveforms of data, of any probability.
  std::vector<LightCandidate> candidates(bool data) {
    const Shape shape = shape_of(frames_);
    search({0, 0, shape.columns, shape.rows});
    if (data) return data_candidates_;
    std::vector<LightCandidate> all;
    // With the box and the frequency that lights() gives it, and the features of its probability.
    const auto add = [&](Found one, bool listed) {
      if (one.data) return;
      update(one);
      const ToneFeatures features = features_now(one);
      const bool inside = one.light.inside;
      if (sharpen(one)) all.push_back(candidate(one, features, inside, listed));
    };
    for (const Found& one : tried_) add(one, false);
    auto tones = without_doubles(found_);
    std::ranges::stable_sort(refused_, std::greater{}, &Found::probability);
    for (const Found& one : refused_)
      if (std::ranges::none_of(tones, [&](const Found& other) { return doubles(one, other); })) tones.push_back(one);
    for (const Found& one : tones) add(one, true);
    return all;
  }

  std::vector<Found> lights() {
    auto found = without_doubles(std::move(found_));
    const auto of = [&](auto same) {
      return [&, same](const LightPart& a, const LightPart& b) {
        return same(frames_, frame_, stored_.dark_level, floor_, a, b);
      };
    };
    std::erase_if(found, [&](Found& one) { return !sharpen(one); });
    found = without_doubles(std::move(found));  // boxes of a light and of texture that it is part of
    join_parts(found, of(one_light_across), of(one_light_down));
    find_reflections(found);
    found.resize(std::min(found.size(), options_.max_sources));
    return by_probability(found);
  }

 private:
  [[nodiscard]] std::vector<Suspect> suspects_in(const Region& region, Coarsening coarsening) const {
    auto suspects = screen_sources(part_of(frames_, region), frame_, stored_, options_.false_alarms, coarsening);
    suspects.resize(std::min(suspects.size(), max_suspects));
    for (Suspect& suspect : suspects) {
      suspect.box.x += region.x, suspect.box.y += region.y;
      suspect.best.x += region.x, suspect.best.y += region.y;
      for (Tile& tile : suspect.tiles) tile.box.x += region.x, tile.box.y += region.y;
    }
    return suspects;
  }

  // Tiles that resolve a light's cycle are up to two cycles wide and show the light alone where a lamp beside it is
  // narrower. The columns beside it are screened by themselves, for lamps of other frequencies.
  void search_beside(const RefinedLight light) {
    const Shape shape = shape_of(frames_);
    const auto cycle = static_cast<std::size_t>(std::lround(1 / light.frequency));
    const std::size_t right = std::min(light.box.right(), shape.columns);
    const std::size_t reach = std::max(light.box.height, 2 * cycle);
    Region near = widened(light.box, reach);
    near.y = light.box.y - std::min(light.box.y, 2 * cycle);
    near.height = std::min(light.box.bottom() + 2 * cycle, shape.rows) - near.y;
    const auto search = [&](std::size_t first, std::size_t end, const Columns& within) {
      if (end < first + min_columns) return;
      for (const Suspect& suspect : suspects_in({first, near.y, end - first, near.height}, Coarsening::rows)) {
        const bool known = std::ranges::any_of(found_,
                                               [&](const Found& one) {
                                                 return covers(one.light.box, suspect.box) || holds(suspect, one.light);
                                               }) ||
                           one_light_across(frames_, frame_, stored_.dark_level, floor_, part_of(light),
                                            {suspect.box, suspect.frequency});
        const auto other = known ? std::nullopt : refine(suspect, within, whole_box);
        const auto one = other && !same_frequency(*other, light) ? judged(*other) : std::nullopt;
        if (one && convincing(*one) &&
            std::ranges::none_of(found_, [&](const Found& old) { return doubles(*one, old); }))
          add_tone(*one);
      }
    };
    search(near.x, light.box.x, {0, light.box.x});
    search(right, std::min(near.right(), shape.columns), {right, shape.columns});
  }

  // Tones in columns [within.first, within.second).
  void find_tones(const std::vector<Suspect>& suspects, std::span<const double> frequencies, const Columns& within) {
    for (const Suspect& suspect : suspects) {
      check_interrupt();
      if (!frequencies.empty() && std::ranges::none_of(frequencies, [&](double f) { return may_show(suspect, f); }))
        continue;
      // A light leaves what it does not explain, such as another lamp beside it.
      for (auto rest = unexplained(suspect); rest;) {
        const auto one = most_probable(*rest, within);
        if (!one) break;
        if (!convincing(*one)) {
          refused_.push_back(*one);
          break;
        }
        add_tone(*one);
        auto left = unexplained(*rest);
        if (left && left->tiles.size() == rest->tiles.size()) break;
        rest = std::move(left);
      }
    }
  }

  // Refinement that sees the columns `within` alone.
  [[nodiscard]] std::optional<RefinedLight> refine(Suspect suspect, const Columns& within, double edge) const {
    const auto [first, end] = within;
    const auto columns = part_of(frames_, {first, 0, end - first, shape_of(frames_).rows});
    suspect.box.x -= first, suspect.best.x -= first;
    const LightLimits inner{limits_.rows, shortest_inner, limits_.amplitude};
    auto light =
        refine_source(columns, frame_, stored_.dark_level, suspect, floor_, edge == inner_box ? inner : limits_, edge);
    if (light) light->box.x += first;
    return light;
  }

  // The part of a suspect that no light explains.
  [[nodiscard]] std::optional<Suspect> unexplained(const Suspect& suspect) const {
    const auto known = [&](const auto& one) {
      return std::ranges::any_of(found_, [&](const Found& other) { return explained(one, other.light); });
    };
    if (known(suspect)) return {};
    std::vector<Tile> tiles;
    std::ranges::remove_copy_if(suspect.tiles, std::back_inserter(tiles), known);
    if (tiles.empty()) return {};
    auto rest = suspect_of(std::move(tiles));
    if (known(rest)) return {};
    return rest;
  }

  // Adds a light, or adjacent lamps that were detected as one, each refined in its own columns.
  void add_tone(const Found& light) {
    std::vector<Found> lamps;
    for (const LightPart& part : parts_beside(frames_, frame_, stored_.dark_level, floor_, light.part)) {
      const auto lamp = refine({part.box, part.frequency, 1, 0, part.box}, {part.box.x, part.box.right()}, whole_box);
      if (const auto one = lamp ? judged(*lamp) : std::nullopt; one && convincing(*one)) lamps.push_back(*one);
    }
    if (lamps.size() < 2) lamps.assign(1, light);
    found_.insert(found_.end(), lamps.begin(), lamps.end());
  }

  template <class Features>
  [[nodiscard]] LightCandidate candidate(const Found& one, const Features& features, bool inside, bool listed) const {
    return {one.light.box,   one.light.frequency / camera_.row_time, one.told,
            one.probability, {features.begin(), features.end()},     inside,
            listed};
  }

  // A measurable tone with its probability.
  [[nodiscard]] std::optional<Found> judged(const RefinedLight& light) const {
    if (!measurable(light, limits_)) return {};
    Found one{.light = light, .part = part_of(light)};
    one.odds = phase_odds(frames_, frame_, camera_, light.box, light.frequency / camera_.row_time);
    update(one);
    return one;
  }

  // The tone of a suspect: that of the inner box about its clearest tile where the whole one does not convince.
  [[nodiscard]] std::optional<Found> most_probable(const Suspect& suspect, const Columns& within) {
    const auto tone = [&](const Suspect& of, double edge) {
      const auto light = refine(of, within, edge);
      return light ? judged(*light) : std::nullopt;
    };
    // The phase in other frames tells the same of both.
    const auto by_this_frame = [&](Found one) {
      one.odds = 1;
      update(one);
      return one;
    };
    const auto whole = tone(suspect, whole_box);
    if (whole && convincing(by_this_frame(*whole))) return whole;
    const auto inner = tone({suspect.best, suspect.frequency, suspect.share, 0, suspect.best}, inner_box);
    const bool better = inner && (!whole || by_this_frame(*inner).probability > by_this_frame(*whole).probability);
    if (const auto& other = better ? whole : inner) tried_.push_back(*other);
    return better ? inner : whole;
  }

  // Frequency of a short light from its own pixels, without bias by its outline. Box and measures too where they are
  // much clearer and the box is shorter: texture that swings in phase with the light made its box too large. A sharp
  // edge is 0.4 cycles further out at 0.15 of the amplitude than it is. False if the light is too short then.
  [[nodiscard]] bool sharpen(Found& one) const {
    RefinedLight& light = one.light;
    if (one.data || light.inside || static_cast<double>(light.box.height) * light.frequency > longest_inner)
      return true;
    const auto own = refine({light.box, light.frequency, 1, 0, light.box}, {0, shape_of(frames_).columns}, inner_box);
    if (!own || !may_show(*own, light.frequency)) return true;
    const bool fits = measurable(*own, limits_);
    const auto shorter = static_cast<double>(light.box.height) - static_cast<double>(own->box.height);
    const bool smaller = shorter * light.frequency >= edges_beyond || much_narrower(own->box, light.box);
    if (!one.known && smaller && own->snr >= much_clearer * light.snr) {
      light = *own;
      one.part = part_of(light);
      return fits;
    }
    if (fits) light.frequency = own->frequency, light.frequency_std = own->frequency_std, light.phase = own->phase;
    return true;
  }

  // Expected number of other lights among those found: pictures that show some show more.
  [[nodiscard]] double company_of(const Found& one) const {
    double sum = 0;
    for (const Found& other : found_)
      if (!other.data && !doubles(one, other)) sum += other.alone;
    return sum;
  }

  [[nodiscard]] ToneFeatures features_now(const Found& one) const {
    return features_of(one.light, suspects_, company_of(one));
  }

  // Probabilities of a tone beside the suspects and lights of now.
  void update(Found& one) const {
    const bool inside = one.light.inside;
    const ToneFeatures features = features_now(one);
    one.alone = with_odds(probability_of(features_of(one.light, suspects_, 0), inside), one.odds);
    one.probability = with_odds(probability_of(features, inside), one.odds);
    one.told = with_odds(corrected_probability_of(features, inside), one.odds);
  }

  [[nodiscard]] bool convincing(const Found& one) const {
    const double own = one.probability;
    const bool clear = own >= std::max(clear_probability, least_probability_) && one.light.periodic >= clear_periodic;
    return clear || (own >= least_probability_ &&
                     evidence(one.light) + std::log(one.odds) >= evidence_for(suspects_, options_.false_alarms));
  }

  [[nodiscard]] bool is_explained(const Suspect& suspect) const {
    return std::ranges::any_of(
        found_, [&](const Found& one) { return explained(suspect, one.light) || holds(suspect, one.light); });
  }

  // Suspects that belong to lights are no chances of a texture: without them, a fainter light may convince. `earlier`:
  // number of lights found before this search.
  void judge_again(const std::vector<Suspect>& suspects, std::size_t earlier) {
    const auto acceptable = [&](const Found& one) {
      return convincing(one) && std::ranges::none_of(found_, [&](const Found& other) { return doubles(one, other); });
    };
    for (;;) {
      suspects_ = 1;
      for (const Suspect& suspect : suspects) suspects_ += is_explained(suspect) ? 0 : 1;
      for (std::size_t i = earlier; i < found_.size(); ++i) update(found_[i]);
      for (Found& one : refused_) update(one);
      const auto next = std::ranges::find_if(refused_, acceptable);
      if (next == refused_.end()) return;
      const Found one = *next;
      refused_.erase(next);
      add_tone(one);
    }
  }

  void find_data(const std::vector<Suspect>& suspects) {
    const double min_evidence = data_evidence_for(suspects.size(), options_.false_alarms);
    std::vector<RefinedLight> tones;  // tones that were joined into lights
    for (const Suspect& suspect : suspects) {
      check_interrupt();
      const auto explains = [&](const RefinedLight& light) {
        return explained(suspect, light) || holds(suspect, light);
      };
      if (std::ranges::any_of(tones, explains) ||
          std::ranges::any_of(found_, [&](const Found& one) { return settled(one) && explains(one.light); }))
        continue;
      const auto data = find_data_light(frames_, frame_, stored_.dark_level, floor_, suspect);
      if (!data) continue;
      const RefinedLight& light = data->light;
      if (!measurable(*data, limits_, min_evidence)) continue;
      const DataFeatures features = features_of(*data, suspects.size());
      const double probability = with_odds(probability_of(features),
                                           waveform_odds(frames_, frame_, stored_.dark_level, floor_, part_of(light)));
      Found one{.light = light, .part = part_of(light), .data = true, .probability = probability, .told = probability};
      data_candidates_.push_back(candidate(one, features, false, true));
      if (probability < probability_for(data_odds, options_.false_alarms)) continue;
      if (made_of_tones(light)) {
        tones.push_back(light);
        continue;
      }
      const auto part = [&](const Found& other) {
        return !other.known && shared_of_smaller(other.light.box, light.box) > 0.5;
      };
      one.merged = std::erase_if(found_, part);
      found_.push_back(one);
    }
  }

  // True for a tone, and for lamps above each other, whose columns also have a common swing.
  [[nodiscard]] bool made_of_tones(const RefinedLight& light) const {
    std::size_t rows = 0;
    for (const Found& one : found_)
      if (clean(one) && settled(one) &&
          shared_length(one.light.box.x, one.light.box.width, light.box.x, light.box.width) > 0)
        rows += shared_length(one.light.box.y, one.light.box.height, light.box.y, light.box.height);
    return 2 * rows > light.box.height;
  }

  const AnyFramesView& frames_;
  std::size_t frame_;
  const Camera& camera_;
  const DetectOptions& options_;
  LightLimits limits_;
  ToneCurve stored_;
  double floor_ = 0, least_probability_;
  std::size_t suspects_ = 1;  // that no light explains, in the last search
  std::vector<Found> found_, refused_;
  std::vector<Found> tried_;  // fits of suspects that have a more probable one
  std::vector<LightCandidate> data_candidates_;
};

// Search region and frequencies; without frequencies: any.
struct Search {
  Region region;
  std::vector<double> frequencies;
};

// Replaces searches with overlapping regions by one of the enclosing region.
std::vector<Search> united(std::vector<Search> searches) {
  for (std::size_t i = 0; i < searches.size(); ++i)
    for (std::size_t k = i + 1; k < searches.size();) {
      Region& a = searches[i].region;
      const Region& b = searches[k].region;
      if (shared_pixels(a, b) == 0) {
        ++k;
        continue;
      }
      a = hull(a, b);
      auto &all = searches[i].frequencies, &more = searches[k].frequencies;
      if (all.empty() || more.empty())
        all.clear();
      else
        all.insert(all.end(), more.begin(), more.end());
      searches.erase(searches.begin() + static_cast<std::ptrdiff_t>(k));
      k = i + 1;
    }
  return searches;
}

void check(const Region& region, const Shape& shape, const char* name) {
  const auto fits = [](std::size_t first, std::size_t count, std::size_t all) {
    return count > 0 && first < all && count <= all - first;
  };
  require(fits(region.x, region.width, shape.columns), name, region.x, "columns of the frame");
  require(fits(region.y, region.height, shape.rows), name, region.y, "rows of the frame");
}

void check(const ExpectedLight& light, const Shape& shape, const Camera& camera) {
  check(light.box, shape, "box");
  check(light.region, shape, "region");
  require(light.frequency > 0 && light.frequency * camera.row_time < 0.5, "frequency", light.frequency,
          "above 0, below half the row rate");
}

}  // namespace

std::vector<LightSource> detect_sources(const AnyFramesView& frames, const Camera& camera,
                                        const DetectOptions& options) {
  check(frames);
  check(camera);
  check(options);
  std::vector<LightSource> sources;
  const Shape shape = shape_of(frames);
  require(options.frame.value_or(0) < shape.frames, "frame", options.frame.value_or(0), "a frame of those given");
  const std::size_t first = options.frame.value_or(0), end = options.frame ? first + 1 : shape.frames;
  for (std::size_t frame = first; frame < end; ++frame) {
    Look look(frames, frame, camera, options);
    look.search({0, 0, shape.columns, shape.rows});
    for (const Found& found : look.lights()) sources.push_back(source_of(frames, frame, camera, found));
  }
  return sources;
}

std::vector<LightCandidate> light_candidates(const AnyFramesView& frame, const Camera& camera, bool data) {
  check(frame);
  check(camera);
  const DetectOptions options{.min_cycles = 2};
  return Look(frame, 0, camera, options).candidates(data);
}

std::vector<LightSource> follow_sources(const AnyFramesView& frame, const Camera& camera,
                                        std::span<const ExpectedLight> expected, const DetectOptions& options) {
  check(frame);
  check(camera);
  check(options);
  const Shape shape = shape_of(frame);
  require(shape.frames == 1, "frame", shape.frames, "one frame");
  for (const ExpectedLight& light : expected) check(light, shape, camera);
  Look look(frame, 0, camera, options);
  std::vector<Search> searches;
  for (const ExpectedLight& light : expected) {
    const double cycles_per_row = light.frequency * camera.row_time;
    if (light.seen && !light.data && look.find_expected(light.box, cycles_per_row)) continue;
    searches.push_back({light.region, light.data ? std::vector<double>{} : std::vector{cycles_per_row}});
  }
  for (const Search& search : united(std::move(searches))) look.search(search.region, search.frequencies);
  std::vector<LightSource> sources;
  for (const Found& found : look.lights()) sources.push_back(source_of(frame, 0, camera, found));
  return sources;
}

}  // namespace ocisac
