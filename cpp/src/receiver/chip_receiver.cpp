#include "ocisac/receiver/chip_receiver.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>

#include "chips/chip_period.hpp"
#include "chips/lit_rows.hpp"
#include "ocisac/chips/chip_clock.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/receiver/receive.hpp"

namespace ocisac {

namespace {

constexpr double kFrameTimeError = 1e-4;   // relative standard error of a nominal frame time
constexpr double kSurePrediction = 0.15;   // chips; max standard error at which a predicted phase is used alone
constexpr double kUnknownJump = 2;         // chips; standard error of the count where the clock jumped
constexpr double kAnyJump = 1e6;           // the same where frames may be missing
constexpr double kSamePhase = 0.1;         // chips
constexpr double kSameExposure = 0.1;      // chips; a change by which a predicted phase is not sure
constexpr double kBrighter = 0.08;         // relative, of the mean from frame to frame: exposure or gain changed
constexpr double kNarrowTolerance = 2e-3;  // relative, of a rate estimated from frames
constexpr double kWideTolerance = 0.02;    // relative, of a nominal rate
constexpr double kAsNoisy = 1.2, kMaxNoiseRatio = 2;  // ratio to the last frame
constexpr double kLittleNoise = 0.06;                 // relative to the swing: excludes a lost clock in any part
constexpr double kNoNoise = 0.005;
constexpr double kNoiseKept = 0.9;  // decay per frame: noise varies where the light fills only some of the rows
constexpr double kSearchPasses = 2000, kSearchPassesUnknownExposure = 7000;
constexpr double kPreambleShare = 0.3;                     // of the effort, for an exposure that a preamble shows
constexpr std::size_t kPhases = 6;                         // tried per chip without a prediction
constexpr double kMinChips = 12;                           // in a frame
constexpr double kSlowLight = 260;                         // Hz; hum of mains of 50 and 60 Hz and its first harmonic
constexpr double kMinSlow = 2e-3;                          // min fraction of a signal's variance for slow light
constexpr double kHighestTone = 0.25, kMinProminence = 6;  // cycles per chip; ratio to its neighbourhood; chips reach 4
constexpr std::size_t kMaxVainTries = 4;     // doublings of the frames from one try of other models to the next
constexpr double kOthersEffort = 0.5;        // of a frame's: the effort for each of the other models
constexpr double kFollowedEffort = 0.1;      // of that, where a clock is tracked
constexpr double kBetter = 0.8;              // ratio of the residual noise required of another model
constexpr std::array kSlownesses{1.0, 0.6};  // chips; initial rise and fall, right within half a chip
constexpr std::array kExposureFactors{0.8, 1.2, 0.9, 1.1, 0.7, 1.35};  // of an exposure that is not right any more
constexpr std::size_t kSearchedFactors = 2;                            // in a frame, the next ones in another
constexpr double kMaxWrongExposure = 2;                                // ratio; a stated one is believed so far
constexpr std::array kExposures{1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0};    // chips, for an unknown exposure
constexpr std::size_t kMaxWait = 7;                                    // frames
constexpr double kMaxSearchRows = 2048;                                // rows that count for the bound of the search
constexpr std::size_t kKeptFrames = 16, kMinProfileFrames = 8;
constexpr std::size_t kProfilePause = 2, kQuickAttempts = 4;  // frames between the first attempts to learn a profile
constexpr std::int64_t kProfileInterval = 4;                  // frames between fits of a profile in use
constexpr std::size_t kMaxHeldAttempts = 8;  // in vain, until the columns' weights follow each frame again
constexpr std::size_t kMaxProfileMisfits = 6;
constexpr int kProfileRounds = 8;
constexpr std::array kShapeWeights{1.0, 1.0, 0.1, 0.01, 0.001};  // by round: prior of the first shape
constexpr double kProfileSearches = 6;                           // frames' efforts for the kept frames, in a round
constexpr double kBrightLight = 10;                              // power of the columns' common light over its noise
constexpr double kProfileGain = 0.95;         // max ratio of the noise of a round to that of the round before
constexpr double kMaxProfileNoise = 1.0 / 3;  // of a frame that cannot be read
constexpr double kMinProfileSwing = 0.1;      // of the largest: darker rows are not read
constexpr double kProfileFrameShare = 0.5;    // of the kept frames that a profile must explain
constexpr double kMinVariance = 0.25;         // of a frame's rows over that of the last one with the same light
constexpr double kProfileChips = 8;           // chips either side over which a profile's swing is smoothed, at least
constexpr std::size_t kForgotten = 60;        // consecutive frames without chips, after which another light may appear

double mean_error_rate(std::span<const double> llr) {
  double sum = 0;
  for (double value : llr) sum += 1 / (1 + std::exp(std::abs(value)));
  return llr.empty() ? std::numeric_limits<double>::quiet_NaN() : sum / static_cast<double>(llr.size());
}

double mean_of(std::span<const double> signal) {
  return std::accumulate(signal.begin(), signal.end(), 0.0) / static_cast<double>(signal.size());
}

double variance_of(std::span<const double> signal) {
  const double mean = mean_of(signal);
  double squares = 0;
  for (const double value : signal) squares += (value - mean) * (value - mean);
  return squares / static_cast<double>(signal.size());
}

bool is_bright(const RowProfile& profile, RowRange rows) {
  return std::ranges::all_of(std::span(profile.swing).subspan(rows.begin, rows.size()),
                             [](double swing) { return swing > 0; });
}

}  // namespace

ChipReceiver::ChipReceiver(const Camera& camera, ChipOptions options)
    : camera_(camera), options_(std::move(options)), assembler_(options_.format) {
  check(camera);
  if (options_.chip_rate) {
    require_positive("chip_rate", *options_.chip_rate);
    require(*options_.chip_rate * camera.row_time <= 1, "chip_rate", *options_.chip_rate, "at most the row rate");
  }
  if (options_.search_passes) require(*options_.search_passes > 0, "search_passes", *options_.search_passes, "above 0");
  const auto chips = preamble_chips(options_.format.preamble);
  preamble_.assign(chips.begin(), chips.end());
  stated_exposure_ = camera.exposure;
  restart_tracker(false);
  forget();
}

// `stamped`: frames have times, so that the frame time need not be known.
void ChipReceiver::restart_tracker(bool stamped) {
  tracker_.reset();
  assembler_.lose_clock();
  if (!stamped && !camera_.frame_time) return;
  const double rows = camera_.frame_time.value_or(1.0) / camera_.row_time;
  tracker_.emplace(TrackerOptions{.frame_rows = rows, .frame_rows_std = kFrameTimeError * rows});
}

void ChipReceiver::forget() {
  rows_per_chip_.reset();
  if (options_.chip_rate) rows_per_chip_ = 1 / (*options_.chip_rate * camera_.row_time);
  vain_tries_ = until_try_ = 0;
  kept_.clear();
  profile_.reset();
  profile_attempts_ = until_attempt_ = profile_misfits_ = 0;
  restart_clock();
  lost_ = fruitless_ = wait_ = 0;
  assembler_.lose_clock();
}

// Rate before detection; estimated from the signal's edges if not given.
std::optional<double> ChipReceiver::nominal_rows_per_chip(const CombinedColumn& column) {
  if (!rows_per_chip_) rows_per_chip_ = blind_rows_per_chip(column, camera_);
  return rows_per_chip_;
}

// Detection from the channel of earlier frames: levels, rate and exposure, with the predicted phase or else several
// trials.
std::optional<FrameReading> ChipReceiver::follow(std::span<const double> signal, const RowModel& model,
                                                 Frame& frame) const {
  if (!channel_ || !frame.may_follow) return std::nullopt;
  ChannelEstimate start = *channel_;
  const auto predicted = tracker_ ? tracker_->predict(frame.time) : std::nullopt;
  if (predicted) {
    start.clock = predicted->clock;
    start.clock.rise = channel_->clock.rise;
    start.clock.fall = channel_->clock.fall;
    start.clock.phase -= static_cast<double>(first_row_);
    start.errors = predicted->errors;
  }
  if (!model.slow_light) start.clock.rise = start.clock.fall = 0;
  if (model.exposure_rows) start.clock.exposure_rows = *model.exposure_rows;
  const double chip = start.clock.rows_per_chip;
  const double longer = (start.clock.exposure_rows - channel_->clock.exposure_rows) / chip;
  const bool sure =
      predicted && predicted->errors.phase_std(0) < kSurePrediction * chip && std::abs(longer) < kSameExposure;
  start.clock.phase += 0.5 * longer * chip;  // the phase is in the middle of the exposure
  const double brighter = mean_of(signal) / mean_;
  if (std::abs(brighter - 1) > kBrighter && variance_of(signal) > kMinVariance * brighter * brighter * variance_)
    for (auto* levels : {&start.dark, &start.swing})
      for (double& level : *levels) level *= brighter;
  std::optional<FrameReading> best;
  for (std::size_t phase = 0; phase < (sure ? 1 : kPhases); ++phase) {
    ChannelEstimate tried = start;
    tried.clock.phase += std::remainder(static_cast<double>(phase) / kPhases, 1.0) * chip;
    auto reading = read_frame(signal, tried, model.exposure_known, &frame.effort);
    if (reading && (!best || reading->relative_noise < best->relative_noise)) best = std::move(reading);
    if (best && best->relative_noise < std::max(kAsNoisy * relative_noise_, kNoNoise) && is_sound(*best)) return best;
  }
  if (!best) return std::nullopt;
  const double as_before =
      std::max(kAsNoisy * relative_noise_, std::min(kMaxNoiseRatio * relative_noise_, kLittleNoise));
  if (best->relative_noise < as_before && is_sound(*best)) return best;
  auto extended = extend_reading(signal, best->channel, model.exposure_known, &frame.effort);
  if (extended && extended->relative_noise < kMaxNoiseRatio * relative_noise_ && is_sound(*extended)) return extended;
  return std::nullopt;
}

std::optional<FrameReading> ChipReceiver::search(std::span<const double> signal, const RowModel& model, Frame& frame) {
  const auto rows_per_chip = nominal_rows_per_chip(frame.column);
  if (!rows_per_chip || static_cast<double>(signal.size()) < kMinChips * *rows_per_chip) return std::nullopt;
  FrameSearch what{*rows_per_chip, channel_ && fits_ ? kNarrowTolerance : kWideTolerance, model.exposure_rows,
                   preamble_, &frame.effort};
  if (!model.exposure_rows && !(channel_ && fits_)) return search_exposures(signal, what);
  auto reading = search_frame(signal, what);
  if (!reading || !model.exposure_rows || model.exposure_known) return reading;
  return read_frame(signal, reading->channel, false, &frame.effort);
}

// As search, for light that rises and falls slowly: finds the chips of sharpened rows, then the shape in the rows.
std::optional<FrameReading> ChipReceiver::search_slow(std::span<const double> signal, const RowModel& model,
                                                      Frame& frame) {
  std::optional<FrameReading> best;
  for (const double chips : kSlownesses) {
    frame.effort = frame.effort_of_others;
    auto start = search(sharpened(signal, chips * rows_per_chip_.value_or(0.0)), model, frame);
    if (!start) continue;
    start->channel.clock.rise = start->channel.clock.fall = chips;
    auto reading = refine_shape(signal, std::move(*start), model.exposure_known, &frame.effort);
    if (!reading || (best && best->relative_noise <= reading->relative_noise)) continue;
    best = std::move(reading);
    if (!is_misfit(*best)) break;
  }
  return best;
}

// The lit rows of the recent frames, each less its slow light.
std::vector<double> ChipReceiver::kept_rows(std::size_t rows, double slow) const {
  std::vector<double> all;
  for (const KeptFrame& kept : kept_) {
    const auto signal = std::span(kept.signal).subspan(first_row_ - kept_first_row_, rows);
    if (const auto fit = remove_nuisance(signal, {slow, {}})) all.insert(all.end(), fit->rest.begin(), fit->rest.end());
  }
  return all;
}

// Searches from several exposures: the chips of a line code, exposed for some, may be others exposed for fewer. The
// least residual decides, unless the first chips found are of the line code.
std::optional<FrameReading> ChipReceiver::search_exposures(std::span<const double> signal,
                                                           const FrameSearch& wanted) const {
  SearchEffort& effort = *wanted.effort;
  const double first = kPreambleShare * effort.rows;
  const double others = (1 - kPreambleShare) * effort.rows / static_cast<double>(kExposures.size());
  std::optional<FrameReading> best;
  for (std::size_t k = 0; k <= kExposures.size(); ++k) {
    const double share = k > 0 ? others : first;
    SearchEffort own{share};
    FrameSearch what = wanted;
    what.effort = &own;
    if (k > 0) what.exposure_rows = kExposures[k - 1] * wanted.rows_per_chip;
    auto reading = search_frame(signal, what);
    if (reading && what.exposure_rows) reading = read_frame(signal, reading->channel, false, &own);
    if (std::isfinite(share)) effort.rows -= share - own.rows;
    if (!reading || (best && reading->relative_noise >= best->relative_noise)) continue;
    best = std::move(reading);
    if (options_.format.line_code.bits_per_word() < options_.format.line_code.chips_per_word() && !is_misfit(*best) &&
        line_code_evidence(*best) > 0)
      break;
  }
  return best;
}

// That of the most likely places of the words.
double ChipReceiver::line_code_evidence(const FrameReading& reading) const {
  const LineCode& code = options_.format.line_code;
  double evidence = -std::numeric_limits<double>::infinity();
  for (std::size_t skipped = 0; skipped < std::min(code.chips_per_word(), reading.llr.size()); ++skipped)
    evidence = std::max(evidence, code.evidence(std::span(reading.llr).subspan(skipped)));
  return evidence;
}

// Alternative models of the rows: slow light, a tone, another exposure.
std::vector<ChipReceiver::RowModel> ChipReceiver::other_models(std::span<const double> signal, bool searches) const {
  const RowModel given{{},
                       camera_.exposure ? std::optional(*camera_.exposure / camera_.row_time) : std::nullopt,
                       camera_.exposure.has_value()};
  std::vector<RowModel> models;
  const auto another_exposure = [&](std::optional<double> rows) { models.push_back({model_.nuisance, rows, false}); };
  if (!model_.nuisance.empty() || model_.exposure_known != given.exposure_known || model_.slow_light)
    models.push_back(given);
  const double slow = kSlowLight * camera_.row_time, row_time = camera_.row_time;
  const auto fit = remove_nuisance(signal, {slow, {}});
  const auto plain = remove_nuisance(signal, {});
  const double highest = kHighestTone / rows_per_chip_.value_or(1 / kHighestTone);
  std::vector<RowNuisance> nuisances;
  if (fit && plain && fit->squares < (1 - kMinSlow) * plain->squares) {
    for (const double mains : kMains) nuisances.push_back({0, {mains * row_time}});
    nuisances.push_back({slow, {}});
  }
  if (fit && slow < highest) {
    const auto tone = strongest_tone(kept_rows(signal.size(), slow), signal.size(), slow, highest);
    if (tone.prominence > kMinProminence) nuisances.push_back({0, {tone.frequency}});
  }
  // The most likely first, by Schwarz's criterion.
  std::vector<std::pair<double, std::size_t>> order;
  for (std::size_t k = 0; k < nuisances.size(); ++k) {
    const auto rows = static_cast<double>(signal.size());
    const double unknowns = 2 * static_cast<double>(nuisances[k].tones.size()) + 2 * rows * nuisances[k].slow;
    const auto left = remove_nuisance(signal, nuisances[k]);
    if (left) order.emplace_back(rows * std::log(std::max(left->squares, 1e-300)) + unknowns * std::log(rows), k);
  }
  std::ranges::sort(order);
  for (const auto& [criterion, k] : order)
    models.push_back({std::move(nuisances[k]), given.exposure_rows, given.exposure_known});
  if (!model_.slow_light) {
    models.push_back(model_);
    models.back().slow_light = true;
  }
  const double now = channel_ ? channel_->clock.exposure_rows : given.exposure_rows.value_or(0.0);
  if (channel_) another_exposure(mean_of(signal) / mean_ * now);  // the brightness changed alike
  if (given.exposure_rows) another_exposure({});                  // a preamble may show it
  const std::size_t factors = kExposureFactors.size(), count = searches ? kSearchedFactors : factors;
  for (std::size_t k = 0; now > 0 && k < count; ++k)
    another_exposure(kExposureFactors[(vain_tries_ * count + k) % factors] * now);
  return models;
}

// Alternates estimates of chips and nuisance until the chips converge.
std::optional<FrameReading> ChipReceiver::read_with(std::span<const double> signal, RowModel& model, Frame& frame) {
  const auto fit = model.nuisance.empty() ? std::nullopt : remove_nuisance(signal, model.nuisance);
  const std::span<const double> rest = fit ? std::span<const double>(fit->rest) : signal;
  const bool has_shape = frame.may_follow && channel_ && (channel_->clock.rise > 0 || channel_->clock.fall > 0);
  std::optional<FrameReading> reading;
  if (!model.slow_light || has_shape) {
    reading = follow(rest, model, frame);
    if (!reading && frame.may_search) reading = search(rest, model, frame);
  } else if (frame.may_search) {
    reading = search_slow(rest, model, frame);
  }
  if (!model.nuisance.empty() && reading)
    reading = refine_nuisance(signal, *reading, model.nuisance, model.exposure_known, &frame.effort);
  if (model.slow_light && reading && is_misfit(*reading)) {
    auto shaped = refine_shape(rest, *reading, model.exposure_known, &frame.effort);
    if (shaped && shaped->relative_noise < reading->relative_noise) reading = std::move(shaped);
  }
  if (reading && !camera_.exposure) reading = with_shortest_exposure(rest, std::move(*reading), &frame.effort);
  return reading;
}

// True where another model fits, from the tracked clock or by a search.
bool ChipReceiver::try_models(std::span<const double> signal, bool searches, Frame& frame,
                              std::optional<FrameReading>& best) {
  for (RowModel& model : other_models(signal, searches)) {
    Frame tried{frame.column, frame.time, searches, frame.effort_of_others, frame.effort_of_others};
    tried.may_follow = fits_;
    if (!searches) tried.effort.rows *= kFollowedEffort;
    auto other = read_with(signal, model, tried);
    if (!other || (best && other->relative_noise > kBetter * best->relative_noise)) continue;
    const double exposure = other->channel.clock.exposure_rows * camera_.row_time;
    if (camera_.exposure && std::max(exposure / *camera_.exposure, *camera_.exposure / exposure) > kMaxWrongExposure)
      continue;
    best = std::move(other);
    model_ = std::move(model);
    frame.new_model = true;
    if (!is_misfit(*best)) return true;
  }
  return false;
}

// Reads with the model of the last frame; if its residual exceeds noise, tries other models until one fits.
std::optional<FrameReading> ChipReceiver::read(std::span<const double> signal, Frame& frame) {
  auto best = read_with(signal, model_, frame);
  if (best ? !is_misfit(*best) : !frame.may_search) return best;
  if (best && until_try_ > 0) {
    --until_try_;
    return best;
  }
  // All from the tracked clock, then all by a search.
  for (const bool searches : {false, true}) {
    if (searches ? !frame.may_search : !(channel_ && fits_)) continue;
    if (try_models(signal, searches, frame, best)) break;
  }
  vain_tries_ = best && !is_misfit(*best) ? 0 : vain_tries_ + 1;
  until_try_ = (std::size_t{1} << std::min<std::size_t>((vain_tries_ + 1) / 2, kMaxVainTries)) - 1;
  return best;
}

// False where the tracker's count of chips restarts.
bool ChipReceiver::track(const ChannelEstimate& channel, double time) {
  ChipClock clock = channel.clock;
  clock.phase += static_cast<double>(first_row_);
  return tracker_ && tracker_->update(time, clock, channel.errors);
}

// On the tracker's clock, in frames: by its stamp, else by its number less the frames that were given twice.
double ChipReceiver::time_of(std::int64_t frame, const FrameStamp& stamp) {
  const bool goes_on = stamp.time.has_value() == last_stamp_.has_value() && (!stamp.time || *stamp.time > *last_stamp_);
  if (!goes_on) restart_tracker(stamp.time.has_value());
  last_stamp_ = stamp.time;
  counted_ = stamp.time || stamp.number;
  return stamp.time ? *stamp.time / camera_.frame_time.value_or(1.0) : static_cast<double>(frame - repeats_);
}

// An uncounted frame with the last one's chips at their place is the same.
bool ChipReceiver::repeats_last(const ReceivedFrame& result) {
  const bool same = !counted_ && result.bits == last_bits_ && !(result.flags & flag::periodic) &&
                    std::abs(result.phase - last_phase_) < kSamePhase * result.rows_per_chip;
  repeats_ += same;
  last_bits_ = result.bits;
  last_phase_ = result.phase;
  return same;
}

// A frame that repeats the last one has its time, too.
void ChipReceiver::forget_repeated(const ReceivedFrame& result) {
  if (result.stretch && result.stretch->outcome == StretchOutcome::repeated) kept_.pop_back();
}

// Index, on the light's clock, of the chip that begins at the estimated phase, and the doubt about it.
std::pair<std::ptrdiff_t, PlaceErrors> ChipReceiver::chip_number(const ChannelEstimate& channel, double time) {
  const auto predicted = tracker_ ? tracker_->predict(time) : std::nullopt;
  const bool sure = track(channel, time);
  if (!predicted) {
    assembler_.lose_clock();
    count_base_ = 0;
    if (!tracker_) return {};
  }
  const double phase = channel.clock.phase + static_cast<double>(first_row_), chip = channel.clock.rows_per_chip;
  const auto number = [&](const TrackedClock& clock) {
    const double chips = (phase - clock.clock.phase) / chip, whole = std::nearbyint(chips);
    return std::pair{static_cast<std::ptrdiff_t>(clock.chip) + static_cast<std::ptrdiff_t>(whole), chips - whole};
  };
  const auto after = number(*tracker_->predict(time)).first;
  if (!predicted) return {after, {}};
  const auto [expected, offset] = number(*predicted);
  if (!sure) count_base_ += expected - after;
  return {count_base_ + after,
          {offset, predicted->errors.phase_std(0) / chip,
           sure       ? 0.0
           : counted_ ? kUnknownJump
                      : kAnyJump}};
}

// Chips of the whole frame and their use by the packet.
void ChipReceiver::take(const FrameReading& reading, double time, std::span<const double> signal,
                        ReceivedFrame& result) {
  const ChannelEstimate& channel = reading.channel;
  // Correlated residuals reduce the effective number of rows.
  const double independent = is_misfit(reading) ? (1 - reading.correlation) / (1 + reading.correlation) : 1.0;
  std::vector<double> llr = reading.llr;
  for (double& value : llr) value *= independent;
  const ChipGrid whole = whole_chips(channel.clock, signal.size());
  for (std::size_t k = 0; k < whole.count; ++k) {
    const std::ptrdiff_t at = whole.first + static_cast<std::ptrdiff_t>(k) - reading.first;
    if (at < 0 || at >= static_cast<std::ptrdiff_t>(llr.size())) continue;
    if (result.bits.empty()) result.phase = whole.start(k) + static_cast<double>(first_row_);
    result.llr.push_back(llr[static_cast<std::size_t>(at)]);
    result.bits += result.llr.back() > 0 ? '1' : '0';
  }
  result.rows_per_chip = channel.clock.rows_per_chip;
  result.rows_per_chip_std = channel.errors.rows_per_chip_std();
  result.exposure = channel.clock.exposure_rows * camera_.row_time;
  result.exposure_std = channel.errors.exposure_rows_std() * camera_.row_time;
  result.snr = std::min(std::pow(0.5 / std::max(reading.relative_noise, 1e-300), 2), 1e12);
  result.error_rate = mean_error_rate(result.llr);
  if (result.snr < kWeakSnr) result.flags |= flag::weak;
  if (is_misfit(reading)) result.flags |= flag::model_misfit;
  if (chip_period(whole_bits(reading, signal.size()))) result.flags |= flag::periodic;
  if (repeats_last(result)) {
    result.stretch.emplace().outcome = StretchOutcome::repeated;
  } else {
    const auto [number, errors] = chip_number(channel, time);
    result.stretch = assembler_.push(number + reading.first, llr, errors);
  }
  channel_ = channel;
  fits_ = !is_misfit(reading);
  mean_ = mean_of(signal);
  variance_ = variance_of(signal);
  if (model_.exposure_rows) model_.exposure_rows = channel.clock.exposure_rows;
  relative_noise_ = std::max(reading.relative_noise, kNoiseKept * relative_noise_);
  if (fits_) rows_per_chip_ = channel.clock.rows_per_chip;
  lost_ = fruitless_ = wait_ = 0;
}

// Searches are slow: the pause before the next one grows with the number of failures.
void ChipReceiver::lose(ReceivedFrame& result, bool searched) {
  result.flags |= flag::no_signal;
  result.outcome = searched ? FrameOutcome::no_signal : FrameOutcome::unsearched;
  if (searched) {
    wait_ = std::min((std::size_t{1} << std::min<std::size_t>(fruitless_, 8)) - 1, kMaxWait);
    ++fruitless_;
  } else {
    --wait_;
  }
  if (++lost_ == kForgotten) {
    const auto kept = std::pair{fruitless_, wait_};
    forget();
    std::tie(fruitless_, wait_) = kept;
  }
}

ReceivedFrame nothing_received(std::int64_t frame) {
  ReceivedFrame result;
  result.frame = frame;
  for (double* value : {&result.phase, &result.rows_per_chip, &result.rows_per_chip_std, &result.exposure,
                        &result.exposure_std, &result.snr, &result.error_rate})
    *value = std::numeric_limits<double>::quiet_NaN();
  return result;
}

SearchEffort ChipReceiver::search_effort(std::size_t rows) const {
  const double passes =
      options_.search_passes.value_or(camera_.exposure ? kSearchPasses : kSearchPassesUnknownExposure);
  return {.rows = passes * std::min(static_cast<double>(rows), kMaxSearchRows)};
}

// `rows`: those that were read.
void ChipReceiver::KeptFrame::expose(const FrameReading& reading, RowRange rows) {
  exposed.assign(signal.size(), 0.0);
  std::ranges::copy(exposed_rows(reading, rows.size()), exposed.begin() + static_cast<std::ptrdiff_t>(rows.begin));
}

void ChipReceiver::keep(const CombinedColumn& column, std::int64_t frame, double time, std::size_t first_row) {
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
  now.signal.assign(column.signal.begin(), column.signal.end());
  now.exposed.clear();
  now.bright = column.quality > kBrightLight;
  now.seen = now.fits = false;
  kept_.push_back(std::move(now));
}

bool ChipReceiver::compares_rows() const {
  if (profile_) return true;
  const bool seen = std::ranges::any_of(kept_, &KeptFrame::seen) ||
                    (kept_.size() < kKeptFrames && std::ranges::any_of(kept_, &KeptFrame::bright));
  return seen && profile_attempts_ < kMaxHeldAttempts && std::ranges::none_of(kept_, &KeptFrame::fits);
}

// The state before the first frame, but for the packet, the rate and the kept frames.
void ChipReceiver::restart_clock() {
  channel_.reset();
  if (tracker_) tracker_->reset();
  model_ = {{}, {}, camera_.exposure.has_value()};
  if (camera_.exposure) model_.exposure_rows = *camera_.exposure / camera_.row_time;
  relative_noise_ = 0;
}

std::vector<ProfileFrame> ChipReceiver::profile_frames() const {
  std::vector<ProfileFrame> frames;
  for (const KeptFrame& kept : kept_) frames.push_back({kept.signal, kept.exposed});
  return frames;
}

std::size_t ChipReceiver::profile_smoothing() const {
  const double chips = kProfileChips * rows_per_chip_.value_or(1.0);
  return static_cast<std::size_t>(std::max(chips, 2 * model_.exposure_rows.value_or(0.0)));
}

// Reads the kept frames again, less a profile, from a new clock on. Returns how many fit. `result`: the chips go to the
// packet, and those of the current frame there; nullptr: only s of each row is kept.
ChipReceiver::KeptFit ChipReceiver::read_kept(const LearnedProfile& learned, const CombinedColumn& column,
                                              std::size_t first_row, ReceivedFrame* result) {
  first_row_ = first_row + learned.rows.begin;
  KeptFit fit;
  std::optional<Payload> payload;
  const SearchEffort effort = search_effort(learned.rows.size());
  double searches = result ? std::numeric_limits<double>::infinity() : kProfileSearches;
  for (KeptFrame& kept : kept_) {
    const auto rest = without_profile(kept.signal, learned.profile, learned.rows);
    Frame now{column, kept.time, searches > 0, effort, effort};
    const auto reading = read_with(rest, model_, now);
    if (std::isfinite(effort.rows)) searches -= 1 - now.effort.rows / effort.rows;
    kept.exposed.clear();
    kept.fits = reading && !is_misfit(*reading);
    fit.frames += kept.fits;
    fit.noise += reading ? reading->relative_noise : kMaxProfileNoise;
    if (!reading) continue;
    kept.expose(*reading, learned.rows);
    if (!result) {
      track(reading->channel, kept.time);
      channel_ = reading->channel;
      mean_ = mean_of(rest);
      variance_ = variance_of(rest);
      relative_noise_ = reading->relative_noise;
      continue;
    }
    ReceivedFrame earlier = nothing_received(kept.number);
    ReceivedFrame& of_frame = kept.number == result->frame ? *result : earlier;
    take(*reading, kept.time, rest, of_frame);
    if (of_frame.stretch->payload && !payload) payload = of_frame.stretch->payload;
  }
  if (payload && result->stretch) result->stretch->payload = payload;
  return fit;
}

// Alternates chips of all kept frames and the profile, from the frames' mean and standard deviation on. The first
// rounds have wrong chips: they keep near the first shape.
bool ChipReceiver::learn_profile(const CombinedColumn& column, std::size_t first_row) {
  auto first = first_profile(profile_frames(), profile_smoothing());
  if (!first) return false;
  const auto before = std::tuple(channel_, mean_, variance_, tracker_, model_, relative_noise_, first_row_);
  const auto enough = static_cast<std::size_t>(kProfileFrameShare * static_cast<double>(kept_.size()));
  const RowRange rows = profile_rows(*first, kMinProfileSwing);
  std::fill_n(first->swing.begin(), rows.begin, 0.0);
  std::fill(first->swing.begin() + static_cast<std::ptrdiff_t>(rows.end), first->swing.end(), 0.0);
  LearnedProfile learned{*first, rows};
  double noise = std::numeric_limits<double>::infinity();
  for (int round = 0; round < kProfileRounds; ++round) {
    restart_clock();
    const KeptFit fit = read_kept(learned, column, first_row, nullptr);
    if (fit.frames >= enough && round > 0) {
      profile_ = std::move(learned);
      return true;
    }
    const auto step = static_cast<std::size_t>(round);
    if (step >= kShapeWeights.size() && fit.noise > kProfileGain * noise) break;
    noise = fit.noise;
    const double weight = kShapeWeights[std::min(step, kShapeWeights.size() - 1)];
    auto profile = fit_profile(profile_frames(), first->swing, profile_smoothing(), weight);
    if (!profile || !is_bright(*profile, rows)) break;
    learned.profile = std::move(*profile);
  }
  std::tie(channel_, mean_, variance_, tracker_, model_, relative_noise_, first_row_) = before;
  return false;
}

// Reads the kept frames again where a new model explains the current one and did not explain earlier ones: their chips
// count from the beginning on. `reading`: of the current frame, in the `lit` rows.
bool ChipReceiver::read_again(const FrameReading& reading, RowRange lit, const CombinedColumn& column,
                              std::size_t first_row, ReceivedFrame& result) {
  const auto poor = static_cast<std::size_t>(std::ranges::count(kept_, false, &KeptFrame::fits));
  if (poor == 0) return false;
  const auto before = std::tuple(channel_, mean_, variance_, tracker_, model_, relative_noise_, first_row_);
  if (tracker_) tracker_->reset();
  channel_ = reading.channel;
  fits_ = true;
  relative_noise_ = reading.relative_noise;
  mean_ = mean_of(std::span(column.signal).subspan(lit.begin, lit.size()));
  variance_ = variance_of(std::span(column.signal).subspan(lit.begin, lit.size()));
  const std::size_t rows = column.signal.size();
  if (poor + 1 == kept_.size()) assembler_ = PacketAssembler(options_.format);  // all its chips are in doubt
  assembler_.lose_clock();
  read_kept({{std::vector<double>(rows), std::vector<double>(rows, 1.0)}, lit}, column, first_row, &result);
  if (result.stretch) return true;
  std::tie(channel_, mean_, variance_, tracker_, model_, relative_noise_, first_row_) = before;
  return false;
}

// Drops a profile that explains the frames no longer.
void ChipReceiver::follow_profile(const std::optional<FrameReading>& reading) {
  kept_.back().seen = reading.has_value();
  kept_.back().fits = reading && !is_misfit(*reading);
  if (!profile_) return;
  if (kept_.back().fits) {
    kept_.back().expose(*reading, profile_->rows);
    if (kept_.back().number % kProfileInterval == 0) {
      auto again = fit_profile(profile_frames(), profile_->profile.swing, profile_smoothing(), kShapeWeights.back());
      if (again && is_bright(*again, profile_->rows)) profile_->profile = std::move(*again);
    }
  }
  profile_misfits_ = kept_.back().fits ? 0 : profile_misfits_ + 1;
  if (profile_misfits_ < kMaxProfileMisfits) return;
  profile_.reset();
  kept_.clear();
  profile_misfits_ = 0;
  restart_clock();
  assembler_.lose_clock();
}

// The stated exposure is the start of the estimate, if it is one.
void ChipReceiver::use_exposure(std::optional<double> exposure) {
  if (exposure == camera_.exposure) return;
  if (exposure && camera_.exposure && model_.exposure_rows)
    *model_.exposure_rows *= *exposure / *camera_.exposure;
  else
    model_.exposure_rows = exposure ? std::optional(*exposure / camera_.row_time) : std::nullopt;
  if (!exposure || !camera_.exposure) model_.exposure_known = exposure.has_value();
  camera_.exposure = exposure;
}

ReceivedFrame ChipReceiver::push(const CombinedColumn& seen, std::int64_t frame, std::size_t first_row, RowRange region,
                                 const FrameStamp& stamp) {
  use_exposure(stamp.exposure ? stamp.exposure : stated_exposure_);
  if (!stamp.exposure && !stamp.gain) return push_lit(seen, frame, first_row, region, stamp);
  if (stamp.exposure && !reference_exposure_) reference_exposure_ = stamp.exposure;
  const double brightness = stamp.gain.value_or(1.0) * (stamp.exposure ? *stamp.exposure / *reference_exposure_ : 1.0);
  CombinedColumn column = seen;
  for (double& row : column.signal) row /= brightness;
  column.noise /= brightness;
  return push_lit(column, frame, first_row, region, stamp);
}

ReceivedFrame ChipReceiver::push_lit(const CombinedColumn& column, std::int64_t frame, std::size_t first_row,
                                     RowRange region, const FrameStamp& stamp) {
  ReceivedFrame result = nothing_received(frame);
  const double time = time_of(frame, stamp);
  keep(column, frame, time, first_row);
  const RowRange lit = profile_ ? profile_->rows : lit_rows(column.signal, column.noise, region).rows;
  const auto rest = profile_ ? without_profile(column.signal, profile_->profile, lit) : std::vector<double>{};
  const auto signal =
      profile_ ? std::span<const double>(rest) : std::span(column.signal).subspan(lit.begin, lit.size());
  first_row_ = first_row + lit.begin;
  if (column.saturated) result.flags |= flag::saturated;
  const SearchEffort effort = search_effort(signal.size());
  const SearchEffort effort_of_others{.rows = kOthersEffort * effort.rows};  // each
  Frame now{column, time, wait_ == 0, effort, effort_of_others};
  const auto reading = read(signal, now);
  follow_profile(reading);
  const auto poor = static_cast<std::size_t>(std::ranges::count(kept_, false, &KeptFrame::fits));
  if (until_attempt_ > 0) --until_attempt_;
  if (!profile_ && until_attempt_ == 0 && kept_.size() >= kMinProfileFrames &&
      static_cast<double>(poor) > kProfileFrameShare * static_cast<double>(kept_.size())) {
    if (learn_profile(column, first_row)) {
      if (poor == kept_.size()) assembler_ = PacketAssembler(options_.format);  // all its chips are in doubt
      assembler_.lose_clock();
      restart_clock();
      read_kept(*profile_, column, first_row, &result);
      profile_attempts_ = 0;
      if (result.stretch) {
        forget_repeated(result);
        return result;
      }
    } else {
      ++profile_attempts_;
      const std::size_t slower = profile_attempts_ - std::min(profile_attempts_, kQuickAttempts);
      until_attempt_ = kProfilePause << std::min<std::size_t>(slower, 5);
    }
  }
  if (reading && !is_misfit(*reading) && now.new_model && !profile_ &&
      read_again(*reading, lit, column, first_row, result)) {
    forget_repeated(result);
    return result;
  }
  if (reading)
    take(*reading, time, signal, result);
  else
    lose(result, now.may_search);
  forget_repeated(result);
  return result;
}

}  // namespace ocisac
