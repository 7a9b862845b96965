#include "ocisac/receiver/profile_learning.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <utility>

#include "receiver/chip_reliability.hpp"
#include "receiver/repeated_frames.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kKeptFrames = 16, kMinProfileFrames = 8;
constexpr double kBrightLight = 10;                           // power of the columns' common light over its noise
constexpr std::size_t kProfilePause = 2, kQuickAttempts = 4;  // frames between the first attempts to learn a profile
constexpr std::int64_t kProfileInterval = 4;                  // frames between fits of a profile in use
constexpr std::size_t kMaxHeldAttempts = 8;  // in vain, until the columns' weights follow each frame again
constexpr std::size_t kMaxProfileMisfits = 6;
constexpr std::size_t kProfileRounds = 12;
constexpr std::array kShapeWeights{1.0, 1.0, 0.1, 0.01, 0.001};  // by round: prior of the first shape
constexpr double kProfileSearches = 6;                           // frames' efforts for the kept frames, in a round
constexpr double kProfileGain = 0.95;         // max ratio of the noise of a round to that of the round before
constexpr double kBetterProfile = 0.8;        // the same of a profile that replaces one in use
constexpr double kMaxProfileNoise = 1.0 / 3;  // of a frame that cannot be read
constexpr double kMaxLearnedErrors = 0.08;    // expected error rate of chips that a profile is learned from
constexpr double kMaxProfileGrowth = 1.5;     // ratio of a frame's noise to that of those that the profile is of
constexpr double kMinProfileSwing = 0.1;      // of the largest: darker rows are not read
constexpr std::size_t kOwnSmoothing = 3;      // rows either side, of the swing at a lamp's ends
constexpr double kMinOwnSwing = 0.5;          // of the smoothed swing, of a row at a lamp's end
constexpr double kProfileFrameShare = 0.5;    // of the kept frames that a profile must explain
constexpr double kProfileChips = 8;           // chips either side over which a profile's swing is smoothed, at least

bool is_bright(const RowProfile& profile, RowRange rows) {
  return std::ranges::all_of(std::span(profile.swing).subspan(rows.begin, rows.size()),
                             [](double swing) { return swing > 0; });
}

// The first profile's bright rows. Its smoothing reaches beyond the end of a lamp, where chips could be invented that
// show nothing of themselves: rows at the ends must swing by themselves about as much as those nearby.
RowRange swinging_rows(const RowProfile& first, std::span<const ProfileFrame> frames) {
  RowRange rows = profile_rows(first, kMinProfileSwing);
  const auto own = first_profile(frames, kOwnSmoothing);
  if (!own) return rows;
  const auto swings = [&](std::size_t row) { return own->swing[row] > kMinOwnSwing * first.swing[row]; };
  while (rows.size() > 0 && !swings(rows.begin)) ++rows.begin;
  while (rows.size() > 0 && !swings(rows.end - 1)) --rows.end;
  return rows;
}

std::size_t smoothing(const RowModelSearch& rows) {
  const double chips = kProfileChips * rows.rows_per_chip().value_or(1.0);
  return static_cast<std::size_t>(std::max(chips, 2 * rows.state().model.exposure_rows.value_or(0.0)));
}

// No more than noise is left, and the chips are no guesses.
bool fits_well(const std::optional<FrameReading>& reading) {
  return reading && !is_misfit(*reading) && reading->error_rate < kMaxLearnedErrors;
}

// True if as little is left as of the frames that the profile was learned from, or no more than noise.
bool explains(const LearnedProfile& learned, const std::optional<FrameReading>& reading) {
  return fits_well(reading) || (reading && reading->error_rate < kMaxLearnedErrors &&
                                reading->relative_noise < kMaxProfileGrowth * learned.noise);
}

// Tones in the frames of a round. Those of mains stay; others become their mean over the frames, in each of which a
// wrong profile moves them.
class ToneMeans {
 public:
  ToneMeans(const std::vector<double>& tones, double row_time) : means_(tones), row_time_(row_time) {}

  void add(const std::vector<double>& found) {
    ++frames_;
    for (std::size_t k = 0; k < means_.size(); ++k)
      if (!is_mains(means_[k])) means_[k] += (found[k] - means_[k]) / static_cast<double>(frames_);
  }
  [[nodiscard]] const std::vector<double>& means() const { return means_; }

 private:
  [[nodiscard]] bool is_mains(double tone) const {
    return std::ranges::any_of(kMains, [&](double mains) { return tone == mains * row_time_; });
  }

  std::vector<double> means_;  // cycles per row
  double row_time_;
  std::size_t frames_ = 0;
};

// Light of other lamps, less the profile: it is divided by the lamp's swing.
std::vector<double> scale_of_beside(const LearnedProfile& learned) {
  if (!learned.beside) return {};
  std::vector<double> scale(learned.rows.size());
  for (std::size_t n = 0; n < scale.size(); ++n) scale[n] = 1 / learned.profile.swing[learned.rows.begin + n];
  return scale;
}

}  // namespace

void KeptFrame::expose(const FrameReading& reading, const LearnedProfile& learned, const RowNuisance& nuisance) {
  const auto begin = static_cast<std::ptrdiff_t>(learned.rows.begin);
  const auto light = exposed_rows(reading, learned.rows.size());
  exposed.assign(signal.size(), 0.0);
  std::ranges::copy(light, exposed.begin() + begin);
  lamp = signal;
  if (nuisance.empty()) return;
  const auto rest = without_profile(signal, learned.profile, learned.rows);
  const auto fit = remove_nuisance(rest, nuisance, light);
  for (std::size_t n = 0; fit && n < rest.size(); ++n)
    lamp[learned.rows.begin + n] -= learned.profile.swing[learned.rows.begin + n] * (rest[n] - fit->rest[n]);
}

void ProfileLearning::forget() {
  kept_.clear();
  profile_.reset();
  attempts_ = until_attempt_ = profile_misfits_ = 0;
}

void ProfileLearning::keep(const CombinedColumn& column, std::int64_t frame, double time, bool counted,
                           std::size_t first_row) {
  if (!kept_.empty() && (kept_first_row_ != first_row || kept_.front().signal.size() != column.signal.size())) {
    kept_.clear();
    profile_.reset();
  }
  kept_first_row_ = first_row;
  KeptFrame now;
  if (kept_.size() == kKeptFrames) {  // its memory is used again
    now = std::move(kept_.front());
    kept_.pop_front();
  }
  now.number = frame;
  now.time = time;
  now.counted = counted;
  now.signal.assign(column.signal.begin(), column.signal.end());
  now.lamp = now.signal;
  now.exposed.clear();
  now.bright = column.quality > kBrightLight;
  now.seen = now.fits = now.sure = now.repeats = false;
  kept_.push_back(std::move(now));
}

bool ProfileLearning::compares_rows(bool can_move) const {
  if (profile_) return true;
  const bool seen = std::ranges::any_of(kept_, &KeptFrame::seen) ||
                    (kept_.size() < kKeptFrames && std::ranges::any_of(kept_, &KeptFrame::bright));
  return seen && attempts_ < kMaxHeldAttempts && std::ranges::none_of(kept_, [can_move](const KeptFrame& kept) {
           return kept.fits || (can_move && kept.sure);
         });
}

std::size_t ProfileLearning::doubtful() const {
  return static_cast<std::size_t>(
      std::ranges::count_if(kept_, [](const KeptFrame& kept) { return !kept.fits && !kept.sure; }));
}

std::vector<std::span<const double>> ProfileLearning::rows_of_all(std::size_t first_row, std::size_t rows) const {
  std::vector<std::span<const double>> all;
  for (const KeptFrame& kept : kept_) all.push_back(std::span(kept.signal).subspan(first_row, rows));
  return all;
}

std::vector<ProfileFrame> ProfileLearning::frames() const {
  std::vector<ProfileFrame> frames;
  for (const KeptFrame& kept : kept_) frames.push_back({kept.lamp, kept.exposed});
  return frames;
}

// Without `use`, only s of each row is kept, and the searches are bounded. A frame that turns out to repeat the one
// before it has its time: later ones are as much earlier.
ProfileLearning::KeptFit ProfileLearning::read_kept(RowModelSearch& rows, const LearnedProfile& learned,
                                                    const CombinedColumn& column, std::size_t first_row,
                                                    const UseReading& use) {
  rows.state().first_row = first_row + learned.rows.begin;
  rows.scale_beside(scale_of_beside(learned));
  KeptFit fit;
  const SearchEffort effort = rows.effort(learned.rows.size());
  double searches = use ? std::numeric_limits<double>::infinity() : kProfileSearches;
  const RowNuisance nuisance = rows.state().model.nuisance;
  ToneMeans tones(nuisance.tones, rows.camera().row_time);
  double repeated = 0;
  for (KeptFrame& kept : kept_) {
    kept.time -= repeated;
    rows.state().model.nuisance = nuisance;
    const auto rest = without_profile(kept.signal, learned.profile, learned.rows);
    FrameRows now{column, kept.time, searches > 0, effort, effort};
    const auto reading = rows.read_with_last(rest, now);
    if (std::isfinite(effort.rows)) searches -= 1 - now.effort.rows / effort.rows;
    kept.exposed.clear();
    kept.fits = fits_well(reading);
    kept.sure = !kept.fits && reading && is_sure(*reading);
    fit.frames += kept.fits;
    fit.read += reading.has_value();
    fit.noise += (reading ? reading->relative_noise : kMaxProfileNoise) / static_cast<double>(kept_.size());
    if (!reading) continue;
    tones.add(rows.state().model.nuisance.tones);
    kept.expose(*reading, learned, rows.state().model.nuisance);
    if (use) {
      kept.repeats = use(kept, *reading, rest);
      repeated += kept.repeats;
      continue;
    }
    rows.track(reading->channel, kept.time);
    rows.accept(*reading, rest);
    rows.state().relative_noise = reading->relative_noise;
  }
  if (!use) rows.state().model.nuisance.tones = tones.means();
  drop_repeated();
  return fit;
}

// The current frame, the last one, is dropped by its receiver.
void ProfileLearning::drop_repeated() {
  const auto current = std::prev(kept_.end());
  kept_.erase(std::remove_if(kept_.begin(), current, std::mem_fn(&KeptFrame::repeats)), current);
}

// Each kept frame less their mean: the still light is gone, and what changes is not divided by a profile.
std::vector<std::vector<double>> ProfileLearning::changes() const {
  std::vector<double> mean(kept_.back().signal.size());
  for (const KeptFrame& kept : kept_)
    for (std::size_t n = 0; n < mean.size(); ++n) mean[n] += kept.signal[n] / static_cast<double>(kept_.size());
  std::vector<std::vector<double>> changes;
  for (const KeptFrame& kept : kept_) {
    changes.push_back(kept.signal);
    for (std::size_t n = 0; n < mean.size(); ++n) changes.back()[n] -= mean[n];
  }
  return changes;
}

// The first profile, 0 where the lamp is too dark. `beside`: of a light as bright in all rows, which is no part of it.
std::optional<LearnedProfile> ProfileLearning::first_learned(std::size_t smooth, const RowNuisance& beside) const {
  std::vector<std::vector<double>> lamps;
  for (const KeptFrame& kept : kept_) lamps.push_back(kept.signal);
  if (!beside.empty()) {
    const auto all = changes();
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
  return LearnedProfile{std::move(*first), bright, 0, false, !beside.empty()};
}

// The kept frames, divided by a profile.
std::vector<double> ProfileLearning::divided(const LearnedProfile& learned) const {
  std::vector<double> rests;
  for (const KeptFrame& kept : kept_) {
    const auto rest = without_profile(kept.signal, learned.profile, learned.rows);
    rests.insert(rests.end(), rest.begin(), rest.end());
  }
  return rests;
}

// A profile that divides a tone as well, and one with the tone beside it. The more probable first: the wrong one
// modulates the tone, which stands out less then.
std::vector<ProfileLearning::Start> ProfileLearning::starts(const RowModelSearch& rows) const {
  const auto tone_of = [](const StrongestTone& tone) {
    return tone.prominence > 0 ? std::vector{tone.frequency} : std::vector<double>{};
  };
  const std::size_t smooth = smoothing(rows);
  std::vector<Start> starts;
  if (auto alike = first_learned(smooth, {})) {
    const auto tone = rows.prominent_tone(divided(*alike), alike->rows.size());
    starts.push_back({std::move(*alike), tone_of(tone)});
  }
  std::vector<double> all;
  for (const auto& change : changes()) all.insert(all.end(), change.begin(), change.end());
  const auto tone = rows.prominent_tone(all, kept_.back().signal.size());
  auto beside = tone.prominence > 0 ? first_learned(smooth, {0, tone_of(tone)}) : std::nullopt;
  if (!beside) return starts;
  const auto modulated = rows.prominent_tone(divided(*beside), beside->rows.size());
  const auto place = tone.prominence > modulated.prominence ? starts.begin() : starts.end();
  starts.insert(place, {std::move(*beside), tone_of(tone)});
  return starts;
}

// True if the residual falls by more than two unknowns a row cost (Schwarz's criterion).
bool ProfileLearning::is_worth(const LearnedProfile& learned) const {
  double without = 0;
  for (const KeptFrame& kept : kept_) without += kept.noise / static_cast<double>(kept_.size());
  const auto count = static_cast<double>(kept_.size());
  return 2 * std::log(without / learned.noise) > 2 * std::log(count) / count;
}

// True if a tone stands out of what profile and chips leave, and none was known: it belongs to the model from now on.
bool ProfileLearning::finds_tone_left(LearnedProfile& learned, RowModelSearch& rows) const {
  if (!rows.state().model.nuisance.empty()) return false;
  std::vector<double> all;
  for (const KeptFrame& kept : kept_)
    for (std::size_t n = learned.rows.begin; n < learned.rows.end && !kept.exposed.empty(); ++n)
      all.push_back(kept.signal[n] - learned.profile.dark[n] - learned.profile.swing[n] * kept.exposed[n]);
  const auto tone = rows.prominent_tone(all, learned.rows.size());
  learned.beside = tone.prominence > 0;
  if (learned.beside) rows.state().model.nuisance.tones = {tone.frequency};
  return learned.beside;
}

// Alternates chips of all kept frames and the profile, from the frames' mean and standard deviation on. The first
// rounds have wrong chips: they keep near the first shape. A tone in what is left is fitted, and where a settled
// profile leaves more than noise, rise and fall of the light, too.
std::optional<LearnedProfile> ProfileLearning::learn(RowModelSearch& rows, const CombinedColumn& column,
                                                     std::size_t first_row, const Start& start) {
  LearnedProfile learned = start.learned;
  const RowProfile& first = start.learned.profile;
  rows.restart_clock();
  rows.state().model.nuisance.tones = start.tones;
  const auto enough = static_cast<std::size_t>(kProfileFrameShare * static_cast<double>(kept_.size()));
  std::optional<std::pair<LearnedProfile, SignalModel>> best;
  double noise = std::numeric_limits<double>::infinity();
  for (std::size_t round = 0; round < kProfileRounds; ++round) {
    const KeptFit fit = read_kept(rows, learned, column, first_row, {});
    rows.restart_phase(fit.read >= enough);
    learned.noise = fit.noise;
    learned.fits = fit.frames >= enough && round > 0;
    const bool slower = best && rows.state().model.slow_light && !best->second.slow_light;
    const double highest = best ? (slower ? kBetterProfile : 1.0) * best->first.noise : kMaxProfileNoise;
    if (round > 0 && fit.read >= enough && (fit.noise < highest || (learned.fits && !slower)))
      best.emplace(learned, rows.state().model);
    if (best && best->first.fits) break;
    const bool finds_tone = fit.read >= enough && finds_tone_left(learned, rows);
    if (round >= kShapeWeights.size() && fit.noise > kProfileGain * noise && !finds_tone && !rows.start_slow_light())
      break;
    noise = fit.noise;
    const double weight = kShapeWeights[std::min(round, kShapeWeights.size() - 1)];
    auto profile = fit_profile(frames(), first.swing, smoothing(rows), weight);
    if (!profile || !is_bright(*profile, learned.rows)) break;
    learned.profile = std::move(*profile);
  }
  if (!best || !(best->first.fits || is_worth(best->first))) return std::nullopt;
  rows.state().model = std::move(best->second);
  rows.scale_beside(scale_of_beside(best->first));
  return std::move(best->first);
}

bool ProfileLearning::comes_due() {
  if (until_attempt_ > 0) --until_attempt_;
  const double most = kProfileFrameShare * static_cast<double>(kept_.size());
  const bool poor = static_cast<double>(std::ranges::count(kept_, false, &KeptFrame::fits)) > most,
             in_doubt = static_cast<double>(doubtful()) > most;
  return until_attempt_ == 0 && kept_.size() >= kMinProfileFrames && poor &&
         (profile_ ? in_doubt && !profile_->fits : in_doubt || attempts_ < kQuickAttempts);
}

std::int64_t ProfileLearning::drop_given_again() {
  const auto repeated = repeated_frames(rows_of_all(0, kept_.back().signal.size()));
  std::int64_t dropped = 0;
  for (std::size_t k = 0; k < kept_.size(); ++k) {
    const bool again = repeated[k] && !kept_[k].counted;
    if (again) kept_[k - 1].repeats = true;
    dropped += again;
    kept_[k].time -= static_cast<double>(dropped);
  }
  drop_repeated();
  return dropped;
}

bool ProfileLearning::learn_first(RowModelSearch& rows, const CombinedColumn& column, std::size_t first_row) {
  if (kept_.size() < kMinProfileFrames) return false;
  const LightState before = rows.state();
  auto kept = kept_;
  std::optional<LearnedProfile> learned;
  for (const Start& start : starts(rows)) {
    rows.state() = before;
    kept_ = kept;
    learned = learn(rows, column, first_row, start);
    if (learned) break;
  }
  const bool better = learned && (!profile_ || learned->fits || learned->noise < kBetterProfile * profile_->noise);
  if (better) {
    profile_ = std::move(learned);
  } else {
    rows.state() = before;
    kept_ = std::move(kept);
  }
  attempts_ = better ? 0 : attempts_ + 1;
  const std::size_t slower = attempts_ - std::min(attempts_, kQuickAttempts);
  until_attempt_ = kProfilePause << std::min<std::size_t>(slower, 5);
  return better;
}

void ProfileLearning::read_again(RowModelSearch& rows, const CombinedColumn& column, std::size_t first_row,
                                 const UseReading& use) {
  rows.restart_phase(true);
  read_kept(rows, *profile_, column, first_row, use);
}

void ProfileLearning::read_again(RowModelSearch& rows, const CombinedColumn& column, std::size_t first_row,
                                 RowRange lit, const UseReading& use) {
  const std::size_t count = column.signal.size();
  read_kept(rows, {{std::vector<double>(count), std::vector<double>(count, 1.0)}, lit}, column, first_row, use);
}

bool ProfileLearning::follow(const std::optional<FrameReading>& reading, RowModelSearch& rows) {
  KeptFrame& now = kept_.back();
  now.seen = reading.has_value();
  now.noise = reading ? reading->relative_noise : kMaxProfileNoise;
  now.fits = fits_well(reading);
  now.sure = !now.fits && reading && is_sure(*reading);
  if (!profile_) return true;
  const bool explained = explains(*profile_, reading);
  if (explained) {
    now.expose(*reading, *profile_, rows.state().model.nuisance);
    if (now.number % kProfileInterval == 0) {
      auto again = fit_profile(frames(), profile_->profile.swing, smoothing(rows), kShapeWeights.back());
      if (again && is_bright(*again, profile_->rows)) {
        profile_->profile = std::move(*again);
        rows.scale_beside(scale_of_beside(*profile_));
      }
    }
  }
  profile_misfits_ = explained ? 0 : profile_misfits_ + 1;
  if (profile_misfits_ < kMaxProfileMisfits) return true;
  profile_.reset();
  kept_.clear();
  profile_misfits_ = 0;
  rows.restart_clock();
  return false;
}

}  // namespace ocisac
