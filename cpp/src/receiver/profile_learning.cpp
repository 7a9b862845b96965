#include "ocisac/receiver/profile_learning.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "columns/moving_mean.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "receiver/reading_trust.hpp"
#include "receiver/rows_of_noise.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kKeptFrames = 16;
constexpr std::int64_t kProfileInterval = 4;  // frames between fits of a profile in use
constexpr std::size_t kMaxProfileMisfits = 6;
constexpr std::size_t kProfileRounds = 12;
constexpr std::array kShapeWeights{1.0, 1.0, 0.1, 0.01, 0.001};  // by round: prior of the first shape
constexpr double kProfileGain = 0.95;      // max ratio of the noise of a round to that of the round before
constexpr double kMaxProfileGrowth = 1.5;  // ratio of a frame's noise to that of those that the profile is of
constexpr double kMinFittedSwing = 0.15;   // of the median, of a fitted profile: darker rows are not read
constexpr std::size_t kOwnSmoothing = 3;   // rows either side, of the swing at a lamp's ends
constexpr double kModeratelySlow = 0.3;    // chips, of rise and fall
constexpr double kProfileChips = 8;        // chips either side over which a profile's swing is smoothed, at least

bool is_bright(const RowProfile& profile, RowRange rows) {
  return std::ranges::all_of(std::span(profile.swing).subspan(rows.begin, rows.size()),
                             [](double swing) { return swing > 0; });
}

// The first profile's bright rows. Its smoothing reaches beyond the end of a lamp, where chips could be invented that
// show nothing of themselves: rows at the ends must swing by themselves about as much as those nearby.
RowRange swinging_rows(const RowProfile& first, std::span<const ProfileFrame> frames) {
  RowRange rows = profile_rows(first, kSmallShare);
  const auto own = first_profile(frames, kOwnSmoothing);
  if (!own) return rows;
  const auto swings = [&](std::size_t row) { return own->swing[row] > kMostly * first.swing[row]; };
  while (rows.size() > 0 && !swings(rows.begin)) ++rows.begin;
  while (rows.size() > 0 && !swings(rows.end - 1)) --rows.end;
  return rows;
}

// The rows without those at the ends that swing by little once their own swing is fitted: a veil about the lamp, whose
// chips the profile's errors hide.
RowRange lamp_rows(const RowProfile& fitted, RowRange rows) {
  const auto swing = moving_mean(fitted.swing, kOwnSmoothing);
  const auto first = swing.begin() + static_cast<std::ptrdiff_t>(rows.begin);
  const double least = kMinFittedSwing * median({first, first + static_cast<std::ptrdiff_t>(rows.size())});
  while (swing[rows.begin] < least) ++rows.begin;
  while (swing[rows.end - 1] < least) --rows.end;
  return rows;
}

std::size_t smoothing(const LightState& state) {
  const double chips = kProfileChips * state.rows_per_chip.value_or(1.0);
  return static_cast<std::size_t>(std::max(chips, 2 * state.model.exposure_rows.value_or(0.0)));
}

// Light of other lamps, less the profile: it is divided by the lamp's swing.
std::vector<double> scale_of_beside(const LearnedProfile& learned) {
  if (!learned.beside) return {};
  std::vector<double> scale(learned.rows.size());
  for (std::size_t n = 0; n < scale.size(); ++n) scale[n] = 1 / learned.profile.swing[learned.rows.begin + n];
  return scale;
}

std::size_t frames_at_least(Trust trust, const std::deque<KeptFrame>& frames) {
  return static_cast<std::size_t>(
      std::ranges::count_if(frames, [trust](const KeptFrame& kept) { return kept.trust >= trust; }));
}

// All frames read again, less the profile; the searches are bounded. Readings of at least this trust lead to the
// next frame's. Returns what is left of them, relative to the swing.
double read_frames(const RowReader& reader, std::size_t first_row, Learned& now, Trust followed = Trust::unsound) {
  now.state.scale_nuisance(scale_of_beside(now.profile));
  double noise = 0;
  const SearchEffort effort = reader.effort(now.state, now.profile.rows.size());
  std::vector<double> tones(now.state.model.nuisance.tones.size());  // their sums: a wrong profile moves them
  for (KeptFrame& kept : now.frames) {
    FrameRows rows{.may_search = now.searches > 0, .effort = effort, .effort_of_others = effort};
    const auto reading = read_kept(reader, now.profile, now.state, first_row, kept, rows);
    if (std::isfinite(effort.rows)) now.searches -= 1 - rows.effort.rows / effort.rows;
    noise += (reading ? reading->relative_noise : kMaxRelativeNoise) / static_cast<double>(now.frames.size());
    if (!reading || reading->trust < followed) continue;
    for (std::size_t k = 0; k < tones.size(); ++k) tones[k] += reading->nuisance.tones[k];
    now.state.track(reading->channel, rows.first_row, kept.time);
    now.state.accept(*reading, rows.signal);
    now.state.relative_noise = reading->relative_noise;
  }
  const std::size_t read = frames_at_least(Trust::unsound, now.frames);
  for (std::size_t k = 0; k < tones.size() && read > 0; ++k)
    now.state.model.nuisance.tones[k] = tones[k] / static_cast<double>(read);
  return noise;
}

// Each frame less their mean: the still light is gone, and what changes is not divided by a profile.
std::vector<std::vector<double>> changes(const std::deque<KeptFrame>& frames) {
  std::vector<double> mean(frames.back().signal.size());
  for (const KeptFrame& kept : frames)
    for (std::size_t n = 0; n < mean.size(); ++n) mean[n] += kept.signal[n] / static_cast<double>(frames.size());
  std::vector<std::vector<double>> changes;
  for (const KeptFrame& kept : frames) changes.push_back(difference(kept.signal, mean));
  return changes;
}

// The first profile, 0 where the lamp is too dark. `beside`: of a light as bright in all rows, which is no part of it.
std::optional<LearnedProfile> first_learned(const std::deque<KeptFrame>& frames, std::size_t smooth,
                                            const RowNuisance& beside) {
  std::vector<std::vector<double>> lamps;
  for (const KeptFrame& kept : frames) lamps.push_back(kept.signal);
  if (!beside.empty()) {
    const auto all = changes(frames);
    for (std::size_t k = 0; k < lamps.size(); ++k)
      if (const auto fit = remove_nuisance(all[k], beside))
        for (std::size_t n = 0; n < all[k].size(); ++n) lamps[k][n] -= all[k][n] - fit->rest[n];
  }
  std::vector<ProfileFrame> signals;
  for (const auto& lamp : lamps) signals.push_back({lamp, {}});
  auto first = first_profile(signals, smooth);
  if (!first) return std::nullopt;
  const RowRange bright = swinging_rows(*first, signals);
  std::fill_n(first->swing.begin(), bright.begin, 0.0);
  std::fill(first->swing.begin() + static_cast<std::ptrdiff_t>(bright.end), first->swing.end(), 0.0);
  return LearnedProfile{.profile = std::move(*first), .rows = bright, .beside = !beside.empty()};
}

// The frames, divided by a profile.
std::vector<double> divided(const std::deque<KeptFrame>& frames, const LearnedProfile& learned) {
  std::vector<double> rests;
  for (const KeptFrame& kept : frames) {
    const auto rest = without_profile(kept.signal, learned.profile, learned.rows);
    rests.insert(rests.end(), rest.begin(), rest.end());
  }
  return rests;
}

// A profile that divides a tone as well, and one with the tone beside it. The more probable first: the wrong one
// modulates the tone, which stands out less then. With a channel where the frames' own readings are mostly right.
std::vector<Learned> starts(const RowReader& reader, const FrameHistory& history, const LightState& state) {
  LightState restarted = reader.restarted(state);
  const auto known = [](const KeptFrame& kept) { return !kept.exposed.empty(); };
  if (!history.profile && std::ranges::count_if(history.frames, known) >= std::ssize(history.frames) / 2) {
    restarted.channel = state.channel;
    restarted.relative_noise = state.relative_noise;
    restarted = with_new_phase(std::move(restarted));
  }
  std::vector<Learned> starts;
  const auto start = [&](LearnedProfile profile, const StrongestTone& tone) {
    Learned now{.profile = std::move(profile), .frames = history.frames, .state = restarted};
    if (tone.prominence > 0) now.state.model.nuisance.tones = {tone.frequency};
    return now;
  };
  const std::size_t smooth = smoothing(state);
  if (auto alike = first_learned(history.frames, smooth, {})) {
    const auto tone = reader.prominent_tone(divided(history.frames, *alike), alike->rows.size(), state);
    starts.push_back(start(std::move(*alike), tone));
  }
  std::vector<double> all;
  for (const auto& change : changes(history.frames)) all.insert(all.end(), change.begin(), change.end());
  const auto tone = reader.prominent_tone(all, history.frames.back().signal.size(), state);
  auto beside = tone.prominence > 0 ? first_learned(history.frames, smooth, {0, {tone.frequency}}) : std::nullopt;
  if (!beside) return starts;
  const auto modulated = reader.prominent_tone(divided(history.frames, *beside), beside->rows.size(), state);
  const auto place = tone.prominence > modulated.prominence ? starts.begin() : starts.end();
  starts.insert(place, start(std::move(*beside), tone));
  return starts;
}

// The frames' own readings leave noise of this mean, relative to the swing.
double noise_without(const std::deque<KeptFrame>& frames) {
  double sum = 0;
  for (const KeptFrame& kept : frames) sum += kept.noise;
  return sum / static_cast<double>(frames.size());
}

// True if the residual falls by more than two unknowns a row cost (Schwarz's criterion).
bool is_worth(const Learned& learned) {
  const auto count = static_cast<double>(learned.frames.size());
  return std::log(noise_without(learned.frames) / learned.profile.noise) > std::log(count) / count;
}

// True if a tone stands out of what profile and chips leave, and none was known: it belongs to the model from now on.
bool finds_tone_left(const RowReader& reader, Learned& now) {
  if (!now.state.model.nuisance.empty()) return false;
  LearnedProfile& learned = now.profile;
  std::vector<double> all;
  for (const KeptFrame& kept : now.frames)
    for (std::size_t n = learned.rows.begin; n < learned.rows.end && !kept.exposed.empty(); ++n)
      all.push_back(kept.signal[n] - learned.profile.dark[n] - learned.profile.swing[n] * kept.exposed[n]);
  const auto tone = reader.prominent_tone(all, learned.rows.size(), now.state);
  learned.beside = tone.prominence > 0;
  if (learned.beside) now.state.model.nuisance.tones = {tone.frequency};
  return learned.beside;
}

// Rise and fall belong to the model from now on, starting from those of a moderately slow light. False where they do,
// where no frame was read, and where the first frame does not show them.
bool start_slow_light(const RowReader& reader, std::size_t first_row, Learned& now) {
  if (now.state.model.slow_light || !now.state.channel) return false;
  LightState slower = now.state;
  slower.model.slow_light = true;
  slower.channel->clock.rise = slower.channel->clock.fall = kModeratelySlow;
  const auto left_by = [&](const LightState& state) {
    Learned first{.profile = now.profile, .frames = {now.frames.front()}, .state = state};
    return read_frames(reader, first_row, first);
  };
  if (!(left_by(slower) < kLessNoise * left_by(now.state))) return false;
  now.state = std::move(slower);
  return true;
}

std::optional<RowProfile> fitted_profile(const std::deque<KeptFrame>& frames, std::span<const double> shape,
                                         const LightState& state, double weight) {
  std::vector<ProfileFrame> known;
  std::vector<double> mean(shape.size());
  double count = 0;
  for (const KeptFrame& kept : frames) count += !kept.exposed.empty();
  for (const KeptFrame& kept : frames)
    for (std::size_t n = 0; n < kept.exposed.size(); ++n) mean[n] += kept.level[n] / count;
  std::vector<std::vector<double>> lights;
  for (const KeptFrame& kept : frames) {
    auto& light = lights.emplace_back(kept.exposed);
    for (std::size_t n = 0; n < light.size(); ++n) light[n] += kept.level[n] - mean[n];
    known.push_back({kept.lamp, light});
  }
  return fit_profile(known, shape, smoothing(state), weight);
}

std::size_t enough_of(const std::deque<KeptFrame>& frames) { return frames.size() / 2; }

// The rows of the longest lamp as they are, where most frames fit so: one that ends sharply, near another lamp or in a
// veil of its own light, needs no profile, which the chips' mean over few frames disturbs.
std::optional<Learned> learn_rows(const RowReader& reader, const FrameHistory& history, const LightState& state) {
  std::vector<ProfileFrame> signals;
  for (const KeptFrame& kept : history.frames) signals.push_back({kept.signal, {}});
  auto own = first_profile(signals, 0);
  if (!own) return std::nullopt;
  const std::size_t count = own->swing.size();  // some chips are alike in all frames by chance:
  RowRange rows = profile_rows({own->dark, moving_mean(own->swing, smoothing(state) / 4)}, kSmallShare);
  rows = lamp_rows(*own, rows);
  if (rows.begin > 0) rows.begin += kOwnSmoothing;
  if (rows.end < count) rows.end -= kOwnSmoothing;
  if (rows.begin >= rows.end || rows.size() == count) return std::nullopt;
  std::ranges::fill(own->dark, 0.0);
  std::ranges::fill(own->swing, 1.0);
  Learned learned{.profile = {.profile = std::move(*own), .rows = rows, .plain = true},
                  .frames = history.frames,
                  .state = reader.restarted(state)};
  learned.profile.noise = read_frames(reader, history.first_row, learned, Trust::fits);
  learned.profile.fits = frames_at_least(Trust::fits, learned.frames) >= enough_of(learned.frames);
  learned.state = with_new_phase(std::move(learned.state));
  return learned.profile.fits ? std::optional(std::move(learned)) : std::nullopt;
}

// Alternates chips of all frames and the profile, from the frames' own readings or from their mean and standard
// deviation on. The first rounds have wrong chips: they keep near the first shape; one that leaves more then than the
// frames' own readings is none. A tone in what is left is fitted, and where a settled profile leaves more than noise,
// rise and fall of the light, too.
std::optional<Learned> learn_from(const RowReader& reader, std::size_t first_row, Learned now) {
  const auto shape = now.profile.profile.swing;
  const std::size_t enough = enough_of(now.frames);
  std::optional<Learned> best;
  double before = std::numeric_limits<double>::infinity();
  for (std::size_t round = 0; round < kProfileRounds; ++round) {
    const bool are_read = round == 0 && now.state.channel;
    const double noise = are_read ? noise_without(now.frames) : read_frames(reader, first_row, now);
    const bool readable = frames_at_least(Trust::unsound, now.frames) >= enough;
    now.state = with_new_phase(std::move(now.state));
    if (!readable) now.state.channel.reset();
    now.profile.noise = noise;
    now.profile.fits = frames_at_least(Trust::fits, now.frames) >= enough && round > 0;
    const bool slower = best && now.state.model.slow_light && !best->state.model.slow_light;
    const double highest = best ? (slower ? kLessNoise : 1.0) * best->profile.noise : kMaxRelativeNoise;
    if (round > 0 && readable && (noise < highest || (now.profile.fits && !slower))) best = now;
    if ((best && best->profile.fits) || (round > 0 && noise > noise_without(now.frames))) break;
    const bool finds_tone = readable && finds_tone_left(reader, now);
    if (round >= kShapeWeights.size() && noise > kProfileGain * before && !finds_tone &&
        !start_slow_light(reader, first_row, now))
      break;
    before = noise;
    const double weight = kShapeWeights[std::min(round, kShapeWeights.size() - 1)];
    auto profile = fitted_profile(now.frames, shape, now.state, weight);
    if (!profile || !is_bright(*profile, now.profile.rows)) break;
    now.profile.rows = lamp_rows(*profile, now.profile.rows);
    now.profile.profile = std::move(*profile);
  }
  if (!best || !(best->profile.fits || is_worth(*best))) return std::nullopt;
  return best;
}

}  // namespace

void KeptFrame::expose(const FrameReading& reading, const LearnedProfile& learned) {
  const auto begin = static_cast<std::ptrdiff_t>(learned.rows.begin);
  const auto light = exposed_rows(reading, learned.rows.size());
  exposed.assign(signal.size(), 0.0);
  std::ranges::copy(light, exposed.begin() + begin);
  level.assign(signal.size(), 0.0);
  for (std::size_t n = 0; n < light.size(); ++n) {
    const auto row = static_cast<double>(n);
    level[learned.rows.begin + n] =
        reading.channel.dark_at(row, light.size()) / reading.channel.swing_at(row, light.size());
  }
  lamp = signal;
  if (reading.nuisance.empty()) return;
  const auto rest = without_profile(signal, learned.profile, learned.rows);
  const auto fit = remove_nuisance(rest, reading.nuisance, light);
  for (std::size_t n = 0; fit && n < rest.size(); ++n)
    lamp[learned.rows.begin + n] -= learned.profile.swing[learned.rows.begin + n] * (rest[n] - fit->rest[n]);
}

void FrameHistory::keep(KeptFrame now, std::size_t first_row_of_now) {
  if (!frames.empty() && (first_row != first_row_of_now || frames.front().signal.size() != now.signal.size())) {
    frames.clear();
    profile.reset();
  }
  first_row = first_row_of_now;
  if (!frames.empty() && frames.back().signal != now.signal)
    now.before = frames.back().signal;  // a copy shows nothing else
  if (frames.size() == kKeptFrames) frames.pop_front();
  now.lamp = now.signal;
  frames.push_back(std::move(now));
}

bool FrameHistory::compares_rows(bool can_move) const {
  if (profile) return true;
  const bool seen = std::ranges::any_of(
      frames, [&](const KeptFrame& kept) { return kept.trust || (kept.bright && frames.size() < kKeptFrames); });
  return seen && !attempts.is_exhausted() && std::ranges::none_of(frames, [can_move](const KeptFrame& kept) {
           return kept.trust >= (can_move ? Trust::sure : Trust::fits);
         });
}

std::size_t FrameHistory::doubtful() const {
  return static_cast<std::size_t>(
      std::ranges::count_if(frames, [](const KeptFrame& kept) { return kept.trust < Trust::sure; }));
}

std::vector<double> rows_before(const KeptFrame& kept, const std::optional<LearnedProfile>& learned, RowRange rows) {
  if (kept.before.empty()) return {};
  const auto seen = std::span(kept.before).subspan(rows.begin, rows.size());
  std::vector<double> before =
      learned ? without_profile(kept.before, learned->profile, rows) : std::vector<double>(seen.begin(), seen.end());
  return without_mean(before);
}

std::vector<std::span<const double>> FrameHistory::rows_of_all(std::size_t begin, std::size_t rows) const {
  std::vector<std::span<const double>> all;
  for (const KeptFrame& kept : frames) all.push_back(std::span(kept.signal).subspan(begin, rows));
  return all;
}

// The current frame, the last one, is dropped by its receiver.
void FrameHistory::drop_repeated() {
  const auto current = std::prev(frames.end());
  frames.erase(std::remove_if(frames.begin(), current, [](const KeptFrame& kept) { return kept.repeats; }), current);
}

bool FrameHistory::comes_due() {
  attempts.pass_frame();
  return attempts.is_due() && is_long_enough() && 2 * doubtful() > frames.size() && !(profile && profile->fits);
}

std::int64_t FrameHistory::drop_given_again() {
  const auto repeated = repeated_frames(rows_of_all(0, frames.back().signal.size()));
  std::int64_t dropped = 0;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const bool again = repeated[k] && !frames[k].counted;
    if (again) frames[k - 1].repeats = true;
    dropped += again;
    frames[k].time -= static_cast<double>(dropped);
  }
  drop_repeated();
  return dropped;
}

std::optional<std::int64_t> FrameHistory::drop_mean() {
  if (frames.size() < 3) return std::nullopt;
  const auto between = frames.end() - 2;
  if (std::prev(between)->number + 1 != between->number || between->number + 1 != frames.back().number ||
      !is_mean(std::prev(between)->signal, between->signal, frames.back().signal))
    return std::nullopt;
  const KeptFrame mean = *between;
  frames.erase(between);
  return mean.trust ? std::nullopt : std::optional(mean.number);
}

std::optional<FrameReading> read_kept(const RowReader& reader, const LearnedProfile& learned, const LightState& state,
                                      std::size_t first_row, KeptFrame& kept, FrameRows& rows) {
  rows.signal = without_profile(kept.signal, learned.profile, learned.rows);
  rows.first_row = first_row + learned.rows.begin;
  rows.time = kept.time;
  SignalModel model = state.model;
  rows.before = rows_before(kept, learned, learned.rows);
  if (!model.nuisance.before.empty()) model.nuisance.before = rows.before;
  auto reading = reader.read_with(model, rows, state);
  kept.exposed.clear();
  kept.trust.reset();
  if (!reading) return reading;
  kept.trust = reading->trust;
  kept.expose(*reading, learned);
  return reading;
}

std::optional<Learned> learn_profile(const RowReader& reader, const FrameHistory& history, const LightState& state) {
  if (auto learned = learn_rows(reader, history, state)) return learned;
  std::optional<Learned> learned;
  for (Learned& start : starts(reader, history, state))
    if ((learned = learn_from(reader, history.first_row, std::move(start)))) break;
  const auto& used = history.profile;
  if (learned && used && !learned->profile.fits && !(learned->profile.noise < kLessNoise * used->noise))
    return std::nullopt;
  return learned;
}

LightState with_new_phase(LightState state) {
  if (state.tracker) state.tracker->reset();
  state.mean = 0;  // not to be compared
  if (!state.channel) return state;
  state.channel->noise = state.relative_noise;
  state.channel->dark = {0.0};
  state.channel->swing = {1.0};
  return state;
}

bool follow_profile(const RowReader& reader, const std::optional<FrameReading>& reading, FrameHistory& history,
                    LightState& state) {
  KeptFrame& now = history.frames.back();
  now.noise = reading ? reading->relative_noise : kMaxRelativeNoise;
  if (reading) now.trust = reading->trust;
  auto& learned = history.profile;
  if (!learned) return true;
  const bool explained =
      reading && (reading->trust == Trust::fits ||
                  (reading->trust != Trust::unsound && reading->relative_noise < kMaxProfileGrowth * learned->noise));
  if (explained) now.expose(*reading, *learned);
  if (explained && !learned->plain && now.number % kProfileInterval == 0) {
    auto again = fitted_profile(history.frames, learned->profile.swing, state, kShapeWeights.back());
    if (again && is_bright(*again, learned->rows)) {
      learned->profile = std::move(*again);
      state.scale_nuisance(scale_of_beside(*learned));
    }
  }
  history.unexplained = explained ? 0 : history.unexplained + 1;
  if (history.unexplained < kMaxProfileMisfits) return true;
  learned.reset();
  history.frames.clear();
  history.unexplained = 0;
  state = reader.restarted(state);
  return false;
}

}  // namespace ocisac
