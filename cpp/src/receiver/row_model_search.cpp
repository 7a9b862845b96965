#include "ocisac/receiver/row_model_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "ocisac/core/require.hpp"
#include "ocisac/receiver/receive.hpp"
#include "ocisac/rows/chip_clock.hpp"
#include "receiver/chip_reliability.hpp"
#include "receiver/rows_of_noise.hpp"

namespace ocisac {

namespace {

constexpr double kFrameTimeError = 1e-4;   // relative standard error of a nominal frame time
constexpr double kSurePrediction = 0.15;   // chips; max standard error at which a predicted phase is used alone
constexpr double kSameExposure = 0.1;      // chips; a change by which a predicted phase is not sure
constexpr double kBrighter = 0.08;         // relative, of the mean from frame to frame: exposure or gain changed
constexpr double kMinVariance = 0.25;      // of a frame's rows over that of the last one with the same light
constexpr double kNarrowTolerance = 2e-3;  // relative, of a rate estimated from frames
constexpr double kWideTolerance = 0.02;    // relative, of a nominal rate
constexpr double kAsNoisy = 1.2, kMaxNoiseRatio = 2;  // ratio to the last frame
constexpr double kLittleNoise = 0.06;                 // relative to the swing: excludes a lost clock in any part
constexpr double kNoNoise = 0.005;
constexpr double kSearchPasses = 2000, kSearchPassesUnknownExposure = 7000;
constexpr double kMaxSearchRows = 2048;      // rows that count for the bound of the search
constexpr double kPreambleShare = 0.3;       // of the effort, for an exposure that a preamble shows
constexpr std::size_t kPhases = 6;           // tried per chip without a prediction
constexpr double kMinChips = 12;             // in a frame
constexpr std::size_t kMaxVainTries = 4;     // doublings of the frames from one try of other models to the next
constexpr std::size_t kEnoughTries = 4;      // of other models in vain, where chips are sure
constexpr double kFollowedEffort = 0.1;      // of the others' effort, where a clock is tracked
constexpr double kWarpEffort = 3;            // of the other models'
constexpr double kBetter = 0.8;              // ratio of the residual noise required of another model
constexpr std::array kSlownesses{1.0, 0.6};  // chips; initial rise and fall, right within half a chip
constexpr double kModeratelySlow = 0.3;      // chips
constexpr double kMaxWrongExposure = 2;      // ratio; a stated one is believed so far
constexpr std::array kExposures{1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0};  // chips, for an unknown exposure

constexpr double kMinCorrelatedRows = 2;  // of a chip or an exposure: shorter light may be as white as noise

double mean_of(std::span<const double> signal) {
  return std::accumulate(signal.begin(), signal.end(), 0.0) / static_cast<double>(signal.size());
}

double variance_of(std::span<const double> signal) {
  const double mean = mean_of(signal);
  double squares = 0;
  for (const double value : signal) squares += (value - mean) * (value - mean);
  return squares / static_cast<double>(signal.size());
}

// Slow light and tones beside chips that are not known yet: their mean is that of a similar frame. Its trend along the
// rows would be taken for a part of the tones.
std::optional<NuisanceFit> remove_beside_mean(std::span<const double> signal, const RowNuisance& nuisance,
                                              const ChannelEstimate& similar) {
  std::vector<double> mean(signal.size()), others(signal.begin(), signal.end());
  for (std::size_t n = 0; n < mean.size(); ++n) {
    const auto row = static_cast<double>(n);
    mean[n] = similar.dark_at(row, mean.size()) + 0.5 * similar.swing_at(row, mean.size());
    others[n] -= mean[n];
  }
  auto fit = remove_nuisance(others, nuisance);
  for (std::size_t n = 0; fit && n < mean.size(); ++n) fit->rest[n] += mean[n];
  return fit;
}

// Without the highest degree of its levels, where Schwarz's criterion drops it: tones that were not fitted yet when the
// degrees were chosen may have asked for it. A swing of degree 1 is dropped first, of higher degrees dark and swing
// alike.
void drop_idle_degree(ChannelEstimate& channel) {
  const std::size_t degree = channel.swing.size() - 1;
  if (degree == 0) return;
  const double swing = channel.swing.back(), dark = channel.dark.back();
  const double chips = channel.clock.exposure_rows / channel.clock.rows_per_chip;
  const double variance = 0.25 / std::max(chips, 1.0);  // of the rows, for random chips
  const bool both = degree > 1;
  const double squares = variance * swing * swing + (both ? std::pow(dark + 0.5 * swing, 2) : 0.0);
  const auto rows = static_cast<double>(channel.rows.size());
  const double gain = rows * squares / (2 * static_cast<double>(degree) + 1) / (channel.noise * channel.noise);
  if (!(gain < (both ? 2 : 1) * std::log(rows))) return;
  channel.swing.pop_back();
  if (both)
    channel.dark.pop_back();
  else
    channel.dark.back() += 0.5 * swing;
}

}  // namespace

RowModelSearch::RowModelSearch(const Camera& camera, RowSearchOptions options)
    : camera_(camera), options_(std::move(options)) {
  check(camera);
  if (options_.chip_rate) {
    require_positive("chip_rate", *options_.chip_rate);
    require(*options_.chip_rate * camera.row_time <= 1, "chip_rate", *options_.chip_rate, "at most the row rate");
  }
  if (options_.search_passes) require(*options_.search_passes > 0, "search_passes", *options_.search_passes, "above 0");
  const auto chips = preamble_chips(options_.format.preamble);
  preamble_.assign(chips.begin(), chips.end());
  restart_tracker(false);
  forget();
}

void RowModelSearch::restart_tracker(bool stamped) {
  state_.tracker.reset();
  if (!stamped && !camera_.frame_time) return;
  const double rows = camera_.frame_time.value_or(1.0) / camera_.row_time;
  state_.tracker.emplace(TrackerOptions{.frame_rows = rows, .frame_rows_std = kFrameTimeError * rows});
}

void RowModelSearch::restart_clock() {
  state_.channel.reset();
  if (state_.tracker) state_.tracker->reset();
  state_.model = {{}, {}, camera_.exposure.has_value()};
  if (camera_.exposure) state_.model.exposure_rows = *camera_.exposure / camera_.row_time;
  state_.relative_noise = 0;
  state_.scale_beside.clear();
}

void RowModelSearch::scale_beside(std::vector<double> scale) {
  state_.model.nuisance.scale = scale;
  state_.scale_beside = std::move(scale);
}

void RowModelSearch::restart_phase(bool readable) {
  if (state_.tracker) state_.tracker->reset();
  if (!readable) state_.channel.reset();
  state_.mean = 0;  // not to be compared
  if (!state_.channel) return;
  state_.channel->noise = state_.relative_noise;
  state_.channel->dark = {0.0};
  state_.channel->swing = {1.0};
}

bool RowModelSearch::start_slow_light() {
  if (state_.model.slow_light || !state_.channel) return false;
  state_.model.slow_light = true;
  state_.channel->clock.rise = state_.channel->clock.fall = kModeratelySlow;
  return true;
}

void RowModelSearch::forget() {
  rows_per_chip_.reset();
  if (options_.chip_rate) rows_per_chip_ = 1 / (*options_.chip_rate * camera_.row_time);
  vain_tries_ = until_try_ = examined_ = 0;
  unexplained_ = 0;
  restart_clock();
}

void RowModelSearch::use_exposure(std::optional<double> exposure) {
  if (exposure == camera_.exposure) return;
  SignalModel& model = state_.model;
  if (exposure && camera_.exposure && model.exposure_rows)
    *model.exposure_rows *= *exposure / *camera_.exposure;
  else
    model.exposure_rows = exposure ? std::optional(*exposure / camera_.row_time) : std::nullopt;
  if (!exposure || !camera_.exposure) model.exposure_known = exposure.has_value();
  camera_.exposure = exposure;
}

SearchEffort RowModelSearch::effort(std::size_t rows) const {
  const double passes =
      options_.search_passes.value_or(camera_.exposure ? kSearchPasses : kSearchPassesUnknownExposure);
  return {.rows = passes * std::min(static_cast<double>(rows), kMaxSearchRows)};
}

bool RowModelSearch::track(const ChannelEstimate& channel, double time) {
  ChipClock clock = channel.clock;
  clock.phase += static_cast<double>(state_.first_row);
  return state_.tracker && state_.tracker->update(time, clock, channel.errors);
}

std::optional<TrackedClock> RowModelSearch::predict(double time) const {
  return state_.tracker ? state_.tracker->predict(time) : std::nullopt;
}

void RowModelSearch::accept(const FrameReading& reading, std::span<const double> signal) {
  state_.channel = reading.channel;
  state_.mean = mean_of(signal);
  state_.variance = variance_of(signal);
}

// Of a frame over the last one that was read; 1 where a mean is not above 0: its dark level is not that of the light.
double RowModelSearch::brightness_ratio(std::span<const double> signal) const {
  const double mean = mean_of(signal);
  return mean > 0 && state_.mean > 0 ? mean / state_.mean : 1.0;
}

bool RowModelSearch::shows_no_light(std::span<const double> signal, FrameRows& frame) const {
  if (!frame.is_noise) {
    const double chip = rows_per_chip_.value_or(0.0), exposure = state_.model.exposure_rows.value_or(0.0);
    frame.is_noise = std::max(chip, exposure) >= kMinCorrelatedRows && is_noise(signal);
  }
  return *frame.is_noise;
}

// False for noise, in which nothing is searched.
bool RowModelSearch::may_search(std::span<const double> signal, FrameRows& frame) const {
  frame.may_search = frame.may_search && !shows_no_light(signal, frame);
  return frame.may_search;
}

// Rate before detection; estimated from the signal's edges if not given.
std::optional<double> RowModelSearch::nominal_rows_per_chip(const CombinedColumn& column) {
  if (!rows_per_chip_) rows_per_chip_ = blind_rows_per_chip(column, camera_);
  return rows_per_chip_;
}

// Detection from the channel of earlier frames: levels, rate and exposure, with the predicted phase or else several
// trials.
std::optional<FrameReading> RowModelSearch::follow(std::span<const double> signal, const SignalModel& model,
                                                   FrameRows& frame, const RowsBeside* beside) const {
  if (!state_.channel || !frame.may_follow) return std::nullopt;
  ChannelEstimate start = *state_.channel;
  const auto predicted = predict(frame.time);
  if (predicted) {
    start.clock = predicted->clock;
    start.clock.rise = state_.channel->clock.rise;
    start.clock.fall = state_.channel->clock.fall;
    start.clock.phase -= static_cast<double>(state_.first_row);
    start.errors = predicted->errors;
  }
  if (!model.slow_light) start.clock.rise = start.clock.fall = 0;
  if (model.exposure_rows) start.clock.exposure_rows = *model.exposure_rows;
  const double chip = start.clock.rows_per_chip;
  const double longer = (start.clock.exposure_rows - state_.channel->clock.exposure_rows) / chip;
  const bool sure =
      predicted && predicted->errors.phase_std(0) < kSurePrediction * chip && std::abs(longer) < kSameExposure;
  start.clock.phase += 0.5 * longer * chip;  // the phase is in the middle of the exposure
  const double brighter = brightness_ratio(signal);
  if (std::abs(brighter - 1) > kBrighter && variance_of(signal) > kMinVariance * brighter * brighter * state_.variance)
    for (auto* levels : {&start.dark, &start.swing})
      for (double& level : *levels) level *= brighter;
  std::optional<FrameReading> best;
  for (std::size_t phase = 0; phase < (sure && !model.warped ? 1 : kPhases); ++phase) {
    ChannelEstimate tried = start;
    tried.clock.phase += std::remainder(static_cast<double>(phase) / kPhases, 1.0) * chip;
    auto reading = read_frame(signal, tried, model.exposure_known, &frame.effort, beside);
    if (reading && model.warped) reading = refine_warp(signal, *reading, model.exposure_known, &frame.effort);
    if (reading && !is_sound(*reading) && !is_misfit(*reading)) reading->even = is_even(*reading);
    if (reading && (!best || reading->relative_noise < best->relative_noise)) best = std::move(reading);
    if (best && best->relative_noise < std::max(kAsNoisy * state_.relative_noise, kNoNoise) && is_sound(*best))
      return best;
  }
  if (!best || beside) return std::nullopt;
  const double as_before =
      std::max(kAsNoisy * state_.relative_noise, std::min(kMaxNoiseRatio * state_.relative_noise, kLittleNoise));
  if (best->relative_noise < as_before && is_sound(*best)) return best;
  if (shows_no_light(signal, frame)) return std::nullopt;
  auto extended = extend_reading(signal, best->channel, model.exposure_known, &frame.effort, {}, model.warped);
  if (extended && model.warped) extended = refine_warp(signal, *extended, model.exposure_known, &frame.effort);
  if (extended && extended->relative_noise < kMaxNoiseRatio * state_.relative_noise && is_sound(*extended))
    return extended;
  return std::nullopt;
}

// Where the last frame fitted: slow light and tones in each round of detection. Absent where more than noise is left.
std::optional<FrameReading> RowModelSearch::go_on(std::span<const double> signal, const SignalModel& model,
                                                  FrameRows& frame) const {
  if (model.nuisance.empty() || !state_.channel || !state_.fits) return std::nullopt;
  const auto fit = remove_beside_mean(signal, model.nuisance, *state_.channel);
  const RowsBeside beside{signal, model.nuisance};
  auto reading = fit ? follow(fit->rest, model, frame, &beside) : std::nullopt;
  if (!reading || is_misfit(*reading)) return std::nullopt;
  drop_idle_degree(reading->channel);
  return reading;
}

std::optional<FrameReading> RowModelSearch::search(std::span<const double> signal, const SignalModel& model,
                                                   FrameRows& frame) {
  const auto rows_per_chip = nominal_rows_per_chip(frame.column);
  if (!rows_per_chip || static_cast<double>(signal.size()) < kMinChips * *rows_per_chip) return std::nullopt;
  FrameSearch what{*rows_per_chip,      state_.channel && state_.fits ? kNarrowTolerance : kWideTolerance,
                   model.exposure_rows, preamble_,
                   &frame.effort,       model.warped};
  if (!model.exposure_rows && !(state_.channel && state_.fits)) return search_exposures(signal, what);
  auto reading = search_frame(signal, what);
  if (!reading || !model.exposure_rows || model.exposure_known || !reading->warp.empty()) return reading;
  return read_frame(signal, reading->channel, false, &frame.effort);
}

// As search, for light that rises and falls slowly: finds the chips of sharpened rows, then the shape in the rows.
std::optional<FrameReading> RowModelSearch::search_slow(std::span<const double> signal, const SignalModel& model,
                                                        FrameRows& frame) {
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

// Searches from several exposures: the chips of a line code, exposed for some, may be others exposed for fewer. The
// least residual decides, unless the first chips found are of the line code.
std::optional<FrameReading> RowModelSearch::search_exposures(std::span<const double> signal,
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
        options_.format.line_code.evidence_anywhere(best->llr) > 0)
      break;
  }
  return best;
}

// Alternates estimates of chips and nuisance until the chips converge.
std::optional<FrameReading> RowModelSearch::read_with(std::span<const double> signal, SignalModel& model,
                                                      FrameRows& frame) {
  if (auto reading = go_on(signal, model, frame)) {
    model.nuisance = reading->nuisance;
    return camera_.exposure ? std::move(reading) : with_shortest_exposure(std::move(*reading), &frame.effort);
  }
  const auto fit = model.nuisance.empty() ? std::nullopt : remove_nuisance(signal, model.nuisance);
  const std::span<const double> rest = fit ? std::span<const double>(fit->rest) : signal;
  const bool has_shape =
      frame.may_follow && state_.channel && (state_.channel->clock.rise > 0 || state_.channel->clock.fall > 0);
  std::optional<FrameReading> reading;
  if (!model.slow_light || has_shape) {
    reading = follow(rest, model, frame);
    if (!reading && may_search(rest, frame)) reading = search(rest, model, frame);
  } else if (may_search(rest, frame)) {
    reading = search_slow(rest, model, frame);
  }
  if (!model.nuisance.empty() && reading)
    reading = refine_nuisance(signal, *reading, model.nuisance, model.exposure_known, &frame.effort);
  if (model.slow_light && reading && is_misfit(*reading) && !is_sure(*reading)) {
    auto shaped = refine_shape(rest, *reading, model.exposure_known, &frame.effort);
    if (shaped && shaped->relative_noise < reading->relative_noise) reading = std::move(shaped);
  }
  if (reading && !camera_.exposure) reading = with_shortest_exposure(std::move(*reading), &frame.effort);
  return reading;
}

// True where another model fits, from the tracked clock or by a search.
bool RowModelSearch::try_models(std::span<const double> signal, bool searches, FrameRows& frame,
                                std::optional<FrameReading>& best) {
  for (SignalModel& model : other_models(signal, frame, searches)) {
    FrameRows tried{frame.column, frame.time, searches, frame.effort_of_others, frame.effort_of_others, frame.recent};
    tried.may_follow = state_.fits;
    if (!searches) tried.effort.rows *= kFollowedEffort;
    if (model.warped) tried.effort.rows *= kWarpEffort;
    auto other = read_with(signal, model, tried);
    if (!other || (best && other->relative_noise > kBetter * best->relative_noise)) continue;
    const double exposure = other->channel.clock.exposure_rows * camera_.row_time;
    if (camera_.exposure && std::max(exposure / *camera_.exposure, *camera_.exposure / exposure) > kMaxWrongExposure)
      continue;
    best = std::move(other);
    state_.model = std::move(model);
    frame.new_model = true;
    if (!is_misfit(*best)) return true;
  }
  return false;
}

// Takes note of what no model explains; forgets it where one does.
void RowModelSearch::examine(const FrameReading& reading, bool in_vain) {
  examined_ = in_vain ? examined_ + 1 : 0;
  unexplained_ = in_vain ? std::max(reading.relative_noise, unexplained_) : 0.0;
}

// Where several tries were in vain in frames whose chips were sure, no model is tried until more is left than then.
bool RowModelSearch::is_examined(const FrameReading& reading) const {
  return examined_ >= kEnoughTries && reading.relative_noise < kAsNoisy * unexplained_;
}

// Reads with the model of the last frame; if its residual exceeds noise, tries other models until one fits.
std::optional<FrameReading> RowModelSearch::read(std::span<const double> signal, FrameRows& frame) {
  auto best = read_with(signal, state_.model, frame);
  if (best ? !is_misfit(*best) : !frame.may_search) return best;
  const bool sure = best && is_sure(*best);
  if (sure && is_examined(*best)) {
    until_try_ = 0;
    return best;
  }
  if (best && until_try_ > 0) {
    --until_try_;
    return best;
  }
  if (best && !sure && state_.model.nuisance.empty()) {
    auto even = refine_warp(signal, *best, state_.model.exposure_known, &frame.effort_of_others);
    if (!is_misfit(even) && is_sound(even)) {
      best = std::move(even);
      state_.model.warped = frame.new_model = true;
      vain_tries_ = 0;
      return best;
    }
  }
  // All from the tracked clock, then all by a search for another clock, where chips are in doubt.
  for (const bool searches : {false, true}) {
    if (searches ? !frame.may_search || sure : !(state_.channel && state_.fits)) continue;
    if (try_models(signal, searches, frame, best)) break;
  }
  vain_tries_ = best && !is_misfit(*best) ? 0 : vain_tries_ + 1;
  if (best && (sure || vain_tries_ == 0)) examine(*best, vain_tries_ > 0);
  until_try_ = (std::size_t{1} << std::min<std::size_t>((vain_tries_ + 1) / 2, kMaxVainTries)) - 1;
  return best;
}

}  // namespace ocisac
