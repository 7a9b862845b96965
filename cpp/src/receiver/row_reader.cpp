#include "ocisac/receiver/row_reader.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "chips/channel_growth.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/rows/chip_clock.hpp"
#include "receiver/reading_trust.hpp"
#include "receiver/rows_of_noise.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr double kFrameTimeError = 1e-4;   // relative standard error of a nominal frame time
constexpr double kLittleNoise = 0.06;      // relative to the swing: excludes a lost clock in any part
constexpr double kNarrowTolerance = 2e-3;  // relative, of a rate estimated from frames
constexpr double kWideTolerance = 0.02;    // relative, of a nominal rate
constexpr double kMinVariance = 0.25;      // of a frame's rows over that of the last one with the same light
constexpr double kMaxNoiseRatio = 2;       // ratio to the last frame
constexpr double kMaxWrongExposure = 2;    // ratio; a stated one is believed so far
constexpr double kSearchPasses = 2000, kSearchPassesUnknownExposure = 7000;
constexpr double kMaxSearchRows = 2048;      // rows that count for the bound of the search
constexpr double kPreambleShare = 0.3;       // of the effort, for an exposure that a preamble shows
constexpr std::size_t kPhases = 6;           // tried per chip without a prediction
constexpr double kMinChips = 12;             // in a frame
constexpr double kEdgeStd = 0.15;            // chips, of edges that lie off the clock; right within a factor of two
constexpr std::array kSlownesses{1.0, 0.6};  // chips; initial rise and fall, right within half a chip
constexpr std::array kExposures{1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0};  // chips, for an unknown exposure

constexpr double kHeavyTails = 10;   // kurtosis
constexpr double kFarOff = 7;        // median magnitudes: 5 standard deviations of white noise
constexpr double kSteep = 10;        // the difference of rows in a part of an exposure, standard deviations of the rows
constexpr double kLongExposure = 6;  // rows, beyond which a single row shows no light of its own

constexpr double kMinCorrelatedRows = 2;  // of a chip or an exposure: shorter light may be as white as noise

// True where single rows hold most of the differences from those beside them: the kurtosis is far from that of noise.
bool has_spikes(std::span<const double> signal) {
  double squares = 0, fourths = 0;
  for (std::size_t n = 1; n + 1 < signal.size(); ++n) {
    const double difference = 2 * signal[n] - signal[n - 1] - signal[n + 1], square = difference * difference;
    squares += square;
    fourths += square * square;
  }
  return fourths * static_cast<double>(signal.size()) > kHeavyTails * squares * squares;
}

// Defects of the sensor: rows that differ from the median of those nearby by far more than most do, and by more than
// light does that is exposed for so many rows.
std::vector<double> without_spikes(std::span<const double> signal, double exposure_rows) {
  constexpr std::size_t kNearby = 2;  // rows either side
  std::vector<double> smooth(signal.begin(), signal.end()), off(signal.size());
  for (std::size_t n = kNearby; n + kNearby < signal.size(); ++n) {
    const auto near = signal.subspan(n - kNearby, 2 * kNearby + 1);
    smooth[n] = median({near.begin(), near.end()});
    off[n] = std::abs(signal[n] - smooth[n]);
  }
  const double most = std::max(kFarOff * median(off), kSteep * std::sqrt(variance_of(smooth)) / exposure_rows);
  for (std::size_t n = 0; n < off.size(); ++n)
    if (off[n] <= most) smooth[n] = signal[n];
  return smooth;
}

// A reading again, with edges that lie off the clock, which may be wrong by a part of a chip: without its nuisance, or
// else with it.
std::optional<FrameReading> loosened(std::span<const double> signal, const FrameReading& reading, bool exposure_known,
                                     SearchEffort* effort) {
  if (reading.channel.clock.shorter != 1) return std::nullopt;
  FrameReading start = reading;
  ChipClock& clock = start.channel.clock;
  clock.edge_std = kEdgeStd;
  clock.rise = clock.fall = 0;
  for (const double chips : {0.0, 0.25, -0.25}) {
    clock.phase = reading.channel.clock.phase + chips * clock.rows_per_chip;
    auto loose = read_frame(signal, start.channel, exposure_known, effort);
    if (loose && fits_off_clock(*loose)) return loose;
  }
  if (reading.nuisance.empty()) return std::nullopt;
  clock.phase = reading.channel.clock.phase;
  auto loose = refine_nuisance(signal, std::move(start), reading.nuisance, exposure_known, effort);
  return loose && loose->trust == Trust::fits ? std::move(loose) : std::nullopt;  // they take up a part of any misfit
}

// The rows of the longer of two exposures, and straight lines between them.
std::vector<double> with_long_rows(std::span<const double> signal, std::ptrdiff_t long_row) {
  std::vector<double> rows(signal.begin(), signal.end());
  const ChipClock turns{.shorter = 0.5, .long_row = long_row};
  const auto last = std::ssize(signal) - 1;
  for (std::ptrdiff_t n = 0; n <= last; ++n) {
    if (turns.is_long(n)) continue;
    std::ptrdiff_t before = n, after = n;
    while (before >= 0 && !turns.is_long(before)) --before;
    while (after <= last && !turns.is_long(after)) ++after;
    if (before < 0) before = after;
    if (after > last) after = before;
    const double part =
        static_cast<double>(n - before) / static_cast<double>(std::max<std::ptrdiff_t>(after - before, 1));
    const auto at = [&](std::ptrdiff_t row) { return signal[static_cast<std::size_t>(row)]; };
    rows[static_cast<std::size_t>(n)] = std::lerp(at(before), at(after), part);
  }
  return rows;
}

std::ptrdiff_t row_of_pairs(const SignalModel& model, const FrameRows& frame) {
  return model.long_row.value_or(0) - static_cast<std::ptrdiff_t>(frame.first_row);
}

// Light of all rows, which does not fit those before or after a pause.
bool is_of_whole_frames(const RowNuisance& nuisance) { return !nuisance.scale.empty() || !nuisance.before.empty(); }

// Any number of chips may be lost by a pause that a reading is not about.
void put_in_doubt(const RowPause& pause, FrameReading& reading) {
  const ChipClock& clock = reading.channel.clock;
  reading.after_pause =
      static_cast<std::ptrdiff_t>((static_cast<double>(pause.row) - clock.phase) / clock.rows_per_chip);
  reading.pause = pause;
  reading.trust = std::min(reading.trust, Trust::misfit);
}

}  // namespace

FrameRows part_of(FrameRows rows, const RowRange& part) {
  const auto cut = [&](const std::vector<double>& values) {
    const auto seen = std::span(values).subspan(part.begin, part.size());
    return std::vector<double>(seen.begin(), seen.end());
  };
  rows.signal = cut(rows.signal);
  rows.first_row += part.begin;
  for (auto& other : rows.recent) other = other.subspan(part.begin, part.size());
  if (!rows.before.empty()) rows.before = without_mean(cut(rows.before));
  rows.is_noise.reset();
  return rows;
}

RowReader::RowReader(const Camera& camera, ChipOptions options) : camera_(camera), options_(std::move(options)) {
  check(camera);
  if (options_.chip_rate) {
    require_positive("chip_rate", *options_.chip_rate);
    require(*options_.chip_rate * camera.row_time <= 1, "chip_rate", *options_.chip_rate, "at most the row rate");
  }
  if (options_.search_passes) require(*options_.search_passes > 0, "search_passes", *options_.search_passes, "above 0");
  const auto chips = preamble_chips(options_.format.preamble);
  preamble_.assign(chips.begin(), chips.end());
}

std::optional<ClockTracker> RowReader::new_tracker(bool stamped) const {
  if (!stamped && !camera_.frame_time) return std::nullopt;
  const double rows = frame_rows_.value_or(camera_.frame_time.value_or(1.0) / camera_.row_time);
  return ClockTracker(TrackerOptions{.frame_rows = rows, .frame_rows_std = kFrameTimeError * rows});
}

void RowReader::set_frame_rows(double rows, ClockTracker& tracker) {
  frame_rows_ = rows;
  tracker.set_frame_rows(rows, kFrameTimeError * rows);
}

SignalModel RowReader::given_model(std::optional<double> exposure) const {
  return {.exposure_rows = exposure ? std::optional(*exposure / camera_.row_time) : std::nullopt,
          .exposure_known = exposure.has_value()};
}

LightState RowReader::first_state(std::optional<ClockTracker> tracker) const {
  LightState state{.exposure = camera_.exposure, .tracker = tracker, .model = given_model(camera_.exposure)};
  if (options_.chip_rate) state.rows_per_chip = 1 / (*options_.chip_rate * camera_.row_time);
  if (state.tracker) state.tracker->reset();
  return state;
}

LightState RowReader::restarted(const LightState& state) const {
  LightState fresh = first_state(state.tracker);
  fresh.exposure = state.exposure;
  fresh.model = given_model(state.exposure);
  fresh.model.long_row = state.model.long_row;
  fresh.rows_per_chip = state.rows_per_chip;
  fresh.other_models = state.other_models;
  return fresh;
}

LightState RowReader::with_exposure(LightState state, std::optional<double> exposure) const {
  if (exposure == state.exposure) return state;
  SignalModel& model = state.model;
  const auto rows = [&](double time) { return std::max(time / camera_.row_time, kShortestExposure); };
  if (exposure && state.exposure && model.exposure_rows)
    *model.exposure_rows *= rows(*exposure) / rows(*state.exposure);
  else
    model.exposure_rows = given_model(exposure).exposure_rows;
  if (!exposure || !state.exposure) model.exposure_known = exposure.has_value();
  state.exposure = exposure;
  return state;
}

SearchEffort RowReader::effort(const LightState& state, std::size_t rows) const {
  const double passes = options_.search_passes.value_or(state.exposure ? kSearchPasses : kSearchPassesUnknownExposure);
  return {.rows = passes * std::min(static_cast<double>(rows), kMaxSearchRows)};
}

void LightState::accept(const FrameReading& reading, std::span<const double> signal) {
  channel = reading.channel;
  if (reading.trust == Trust::fits && !reading.warp.empty()) warp = reading.warp;
  mean = mean_of(signal);
  variance = variance_of(signal);
}

double LightState::brightness_ratio(std::span<const double> signal) const {
  const double now = mean_of(signal);
  return now > 0 && mean > 0 ? now / mean : 1.0;
}

std::optional<TrackedClock> LightState::predict(double time) const {
  return tracker && !(tracker->last_frame() > time) ? tracker->predict(time) : std::nullopt;
}

bool LightState::track(const ChannelEstimate& of_frame, std::size_t first_row, double time) {
  ChipClock clock = of_frame.clock;
  clock.phase += static_cast<double>(first_row);
  if (!tracker) return false;
  const bool is_later = !(tracker->last_frame() >= time);
  if (!is_later) tracker->reset();  // begins again with this frame
  return tracker->update(time, clock, of_frame.errors) && is_later;
}

void LightState::scale_nuisance(std::vector<double> scale) {
  model.nuisance.scale = scale;
  scale_beside = std::move(scale);
}

bool RowReader::shows_no_light(std::span<const double> signal, FrameRows& frame, const LightState& state) const {
  if (!frame.is_noise) {
    const auto &chip = state.rows_per_chip, &exposure = state.model.exposure_rows;
    const bool is_known = chip || exposure;  // else edges of noise would say that chips are short
    const bool is_correlated = std::max(chip.value_or(0.0), exposure.value_or(0.0)) >= kMinCorrelatedRows;
    const auto stands_still = [&] { return !frame.before.empty() && is_noise(difference(frame.signal, frame.before)); };
    frame.is_noise = (is_correlated || !is_known) && (is_noise(signal) || stands_still());
  }
  return *frame.is_noise;
}

// Detection from the channel of earlier frames: levels, rate and exposure, with the predicted phase or else several
// trials.
std::optional<FrameReading> RowReader::follow(std::span<const double> signal, const SignalModel& model,
                                              FrameRows& frame, const LightState& state,
                                              const RowsBeside* beside) const {
  if (!state.channel || !frame.may_follow) return std::nullopt;
  ChannelEstimate start = *state.channel;
  const auto predicted = state.predict(frame.time);
  if (predicted) {
    start.clock = predicted->clock;
    start.clock.rise = state.channel->clock.rise;
    start.clock.fall = state.channel->clock.fall;
    start.clock.shorter = state.channel->clock.shorter;
    start.clock.later = state.channel->clock.later;
    start.clock.phase -= static_cast<double>(frame.first_row);
    start.errors = predicted->errors;
  }
  if (!model.slow_light) start.clock.rise = start.clock.fall = 0;
  start.clock.edge_std = model.loose_edges ? kEdgeStd : 0;
  if (!model.long_row) {
    start.clock.shorter = 1;
    start.clock.later = 0;
  }
  start.clock.long_row = row_of_pairs(model, frame);
  if (model.exposure_rows) start.clock.exposure_rows = *model.exposure_rows;
  const double chip = start.clock.rows_per_chip;
  const double longer = (start.clock.exposure_rows - state.channel->clock.exposure_rows) / chip;
  const bool sure = predicted && predicted->errors.phase_std(0) < kSmallShare * chip && std::abs(longer) < kSmallShare;
  start.clock.phase += 0.5 * longer * chip;  // the phase is in the middle of the exposure
  std::vector<ChannelEstimate> starts{start};
  const double brighter = state.brightness_ratio(signal);
  const double change = state.mean != 0 ? mean_of(signal) - state.mean : 0;  // of other light, where it is not the gain
  if (std::abs(brighter - 1) > kSmallShare &&
      variance_of(signal) > kMinVariance * brighter * brighter * state.variance) {
    for (auto* levels : {&starts.front().dark, &starts.front().swing})
      for (double& level : *levels) level *= brighter;
  } else if (std::abs(change) > kSmallShare * start.swing[0] && variance_of(signal) > kMinVariance * state.variance) {
    starts.front().dark[0] += change;
  }
  // The mean of the frame's chips is another, too, by so much: then the levels may be as before.
  const double by_chips = start.swing[0] * std::sqrt(0.5 * chip / static_cast<double>(signal.size()));
  if (starts.front().dark != start.dark && std::abs(change) < kWeak * by_chips) starts.push_back(start);
  // Where chips are easily confused, another clock may fit as well.
  const std::size_t phases = sure && !model.warped ? 1 : kPhases;
  const bool close = phases * starts.size() > 1 && closeness(start, signal.size()) < kCloseSequences;
  const auto has_rate = [&](const std::optional<FrameReading>& reading) {
    return reading && reading->has_rate(state.rows_per_chip.value_or(chip));
  };
  std::optional<FrameReading> best;
  const auto is_as_good = [&](const std::optional<FrameReading>& reading) {
    return reading && keeps_clock(*reading) &&
           reading->relative_noise < std::max(kAsNoisy * state.relative_noise, kNoResidual);
  };
  for (std::size_t phase = 0; phase < phases; ++phase) {
    for (std::size_t k = 0; k < starts.size(); ++k) {
      ChannelEstimate tried = starts[k];
      tried.clock.phase += std::remainder(static_cast<double>(phase) / kPhases, 1.0) * chip;
      auto reading = read_frame(signal, tried, model.exposure_known, &frame.effort, beside);
      if (reading && model.warped) reading = refine_warp(signal, *reading, model.exposure_known, &frame.effort);
      if (!has_rate(reading) || (k > 0 && !is_as_good(reading))) continue;
      if (!best || reading->relative_noise < best->relative_noise) best = std::move(reading);
      if (!close && is_as_good(best)) return best;
    }
  }
  if (is_as_good(best)) return best;
  if (!best || beside) return std::nullopt;
  const double as_before =
      std::max(kAsNoisy * state.relative_noise, std::min(kMaxNoiseRatio * state.relative_noise, kLittleNoise));
  if (best->relative_noise < as_before && keeps_clock(*best)) return best;
  if (shows_no_light(signal, frame, state)) return std::nullopt;
  auto extended = extend_reading(signal, best->channel, model.exposure_known, &frame.effort, {}, model.warped);
  if (extended && model.warped) extended = refine_warp(signal, *extended, model.exposure_known, &frame.effort);
  if (has_rate(extended) && extended->relative_noise < kMaxNoiseRatio * state.relative_noise &&
      extended->trust != Trust::unsound)
    return extended;
  return std::nullopt;
}

// Where the last frame fitted: slow light and tones in each round of detection. Absent where more than noise is left.
std::optional<FrameReading> RowReader::follow_beside(const SignalModel& model, FrameRows& frame,
                                                     const LightState& state) const {
  if (model.nuisance.empty() || !state.channel || !state.fits) return std::nullopt;
  const auto fit = remove_nuisance(frame.signal, model.nuisance);
  const RowsBeside beside{frame.signal, model.nuisance};
  auto reading = fit ? follow(fit->rest, model, frame, state, &beside) : std::nullopt;
  return reading && reading->trust == Trust::fits ? std::move(reading) : std::nullopt;
}

std::optional<FrameReading> RowReader::search(std::span<const double> signal, const SignalModel& model,
                                              FrameRows& frame, const LightState& state) const {
  if (!state.rows_per_chip || static_cast<double>(signal.size()) < kMinChips * *state.rows_per_chip)
    return std::nullopt;
  const bool is_tracked = state.channel && state.fits;
  const FrameSearch what{.rows_per_chip = *state.rows_per_chip,
                         .tolerance = is_tracked ? kNarrowTolerance : kWideTolerance,
                         .exposure_rows = model.exposure_rows,
                         .preamble = preamble_,
                         .effort = &frame.effort,
                         .warped = model.warped};
  const bool as_told = options_.chip_rate && *state.rows_per_chip == 1 / (*options_.chip_rate * camera_.row_time);
  const auto with_row_time = [&](std::optional<FrameReading> found) {
    if (!as_told || (found && found->trust == Trust::fits)) return found;
    SearchEffort own = frame.effort_of_others;
    FrameSearch wide = what;
    wide.tolerance = kRowTimeTolerance;
    wide.effort = &own;
    wide.blind = false;
    auto other = search_frame(signal, wide);
    return other && other->trust == Trust::fits ? std::move(other) : std::move(found);
  };
  if (!model.exposure_rows && !is_tracked) return with_row_time(search_exposures(signal, what));
  auto reading = with_row_time(search_frame(signal, what));
  if (!reading || !model.exposure_rows || model.exposure_known || !reading->warp.empty()) return reading;
  return read_frame(signal, reading->channel, false, &frame.effort);
}

// As search, for light that rises and falls slowly: finds the chips of sharpened rows, then the shape in the rows.
std::optional<FrameReading> RowReader::search_slow(std::span<const double> signal, const SignalModel& model,
                                                   FrameRows& frame, const LightState& state) const {
  std::optional<FrameReading> best;
  for (const double chips : kSlownesses) {
    frame.effort = frame.effort_of_others;
    auto start = search(sharpened(signal, chips * state.rows_per_chip.value_or(0.0)), model, frame, state);
    if (!start) continue;
    start->channel.clock.rise = start->channel.clock.fall = chips;
    auto reading = refine_shape(signal, std::move(*start), model.exposure_known, &frame.effort);
    if (!reading || (best && best->relative_noise <= reading->relative_noise)) continue;
    best = std::move(reading);
    if (best->trust == Trust::fits) break;
  }
  return best;
}

// As search, of the rows of the longer exposure, then of both.
std::optional<FrameReading> RowReader::search_turns(std::span<const double> signal, const SignalModel& model,
                                                    FrameRows& frame, const LightState& state) const {
  const std::ptrdiff_t long_row = row_of_pairs(model, frame);
  const auto reading = search(with_long_rows(signal, long_row), model, frame, state);
  return reading ? refine_turns(signal, *reading, long_row, model.exposure_known, &frame.effort) : std::nullopt;
}

// Searches from several exposures: the chips of a line code, exposed for some, may be others exposed for fewer. The
// least residual decides.
std::optional<FrameReading> RowReader::search_exposures(std::span<const double> signal,
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
    if (reading && what.exposure_rows) reading = extend_reading(signal, reading->channel, false, &own);
    if (std::isfinite(share)) effort.rows -= share - own.rows;
    if (reading && (!best || reading->relative_noise < best->relative_noise)) best = std::move(reading);
  }
  return best;
}

// Rows that are displaced as those of an earlier frame, and about so.
std::optional<FrameReading> RowReader::read_as_displaced_before(const SignalModel& model, FrameRows& frame,
                                                                const LightState& state) const {
  if (!model.warped || state.warp.size() != frame.signal.size()) return std::nullopt;
  SignalModel even_model = model;
  even_model.warped = false;
  FrameRows even = frame;
  even.signal = unwarped(frame.signal, state.warp);
  even.may_search = false;
  auto reading = read_with(even_model, even, state);
  if (!reading || reading->trust < Trust::sure) return std::nullopt;
  reading->warp = state.warp;
  if (reading->nuisance.empty()) reading = refine_warp(frame.signal, *reading, model.exposure_known, &frame.effort);
  return reading->trust == Trust::fits ? reading : std::nullopt;
}

std::optional<FrameReading> RowReader::read_unmixed(const SignalModel& model, FrameRows& frame,
                                                    const LightState& state) const {
  SignalModel plain = model;
  plain.mixing.reset();
  FrameRows own = frame;
  if (!frame.before.empty()) own.signal = unmixed(frame, *model.mixing);
  auto reading = read_with(plain, own, state);
  frame.effort = own.effort;
  frame.may_search = own.may_search;
  return reading;
}

// Alternates estimates of chips and nuisance until the chips converge.
std::optional<FrameReading> RowReader::read_with(const SignalModel& model, FrameRows& frame,
                                                 const LightState& state) const {
  if (model.mixing) return read_unmixed(model, frame, state);
  if (model.pause) return read_about(*model.pause, model, frame, state);
  if (auto reading = read_as_displaced_before(model, frame, state)) return reading;
  auto reading = follow_beside(model, frame, state);
  if (!reading) {
    const auto fit = model.nuisance.empty() ? std::nullopt : remove_nuisance(frame.signal, model.nuisance);
    const std::span<const double> rest = fit ? fit->rest : frame.signal;
    const bool may_follow = frame.may_follow && state.channel;
    const bool has_shape = may_follow && (state.channel->clock.rise > 0 || state.channel->clock.fall > 0);
    const bool has_turns = may_follow && state.channel->clock.shorter < 1;
    if ((!model.slow_light || has_shape) && (!model.long_row || has_turns)) reading = follow(rest, model, frame, state);
    frame.may_search = frame.may_search && (reading || !shows_no_light(rest, frame, state));
    if (!reading && frame.may_search)
      reading = model.long_row                   ? search_turns(rest, model, frame, state)
                : model.slow_light && !has_shape ? search_slow(rest, model, frame, state)
                                                 : search(rest, model, frame, state);
    if (!model.nuisance.empty() && reading)
      reading = refine_nuisance(frame.signal, std::move(*reading), model.nuisance, model.exposure_known, &frame.effort);
    if (model.slow_light && reading && reading->trust < Trust::sure) {
      auto shaped = refine_shape(rest, *reading, model.exposure_known, &frame.effort);
      if (shaped && shaped->relative_noise < reading->relative_noise) reading = std::move(shaped);
    }
  }
  if (reading && !model.long_row && longer_rows(frame, reading))
    reading->trust = std::min(reading->trust, Trust::misfit);
  if (reading && !state.exposure) return with_shortest_exposure(std::move(*reading), &frame.effort);
  return reading;
}

// True where the best reading is now that by the hypothesis, or this one is sure that there is no pause.
bool RowReader::try_hypothesis(const Hypothesis& hypothesis, const FrameRows& frame, RowsRead& best) const {
  const auto& [model, searches, refines] = hypothesis;
  FrameRows tried = frame;
  tried.may_search = searches;
  tried.may_follow = best.state.fits;
  tried.effort = frame.effort_of_others;
  tried.is_noise.reset();
  if (!searches && !refines) tried.effort.rows *= kSmallShare;
  std::optional<FrameReading> other;
  if (model.pause && !model.pause->rows)
    other = read_with(model, tried, refines ? about_pause(best, frame) : restarted(best.state));
  else if (!refines)
    other = read_with(model, tried, best.state);
  else if (best.reading && model.mixing)
    other = read_frame(unmixed(frame, *model.mixing), best.reading->channel, model.exposure_known, &tried.effort);
  else if (best.reading && model.warped)
    other = refine_warp(frame.signal, *best.reading, model.exposure_known, &tried.effort);
  else if (best.reading)
    other = loosened(frame.signal, *best.reading, model.exposure_known, &tried.effort);
  if (!other || (refines && !model.pause && !model.mixing && other->trust != Trust::fits && !fits_off_clock(*other)))
    return false;
  const bool loses_chips = other->pause && other->pause->loses_chips();
  if (best.reading && other->relative_noise > (loses_chips ? 1.0 : kLessNoise) * best.reading->relative_noise)
    return other->trust >= Trust::sure && other->pause && other->pause->loses_none();
  const double exposure = other->channel.clock.exposure_rows * camera_.row_time;
  const auto& told = best.state.exposure;
  if (told && std::max(exposure / *told, *told / exposure) > kMaxWrongExposure) return false;
  best.state.model = model;
  if (!model.nuisance.empty() || model.loose_edges) best.state.model.nuisance = other->nuisance;
  if (is_of_whole_frames(best.state.model.nuisance)) best.state.model.pause.reset();
  best.reading = std::move(other);
  best.is_new_model = true;
  return true;
}

RowsRead RowReader::read(FrameRows& frame, LightState before) const {
  RowsRead best{.state = std::move(before)};
  std::optional<FrameReading>& reading = best.reading;
  LightState& state = best.state;
  SignalModel& model = state.model;
  if (!model.nuisance.before.empty()) model.nuisance.before = frame.before;
  const double exposure_rows = model.exposure_rows.value_or(0.0);
  if (exposure_rows > kLongExposure && has_spikes(frame.signal))
    frame.signal = without_spikes(frame.signal, exposure_rows);
  const auto fits = [&best] { return best.reading && best.reading->trust == Trust::fits; };
  reading = read_with(model, frame, state);
  if (reading && !model.nuisance.empty()) model.nuisance = reading->nuisance;
  best.is_new_model = reading && reading->pause && model.pause && reading->pause->chips() != model.pause->chips();
  state.other_models.pass_frame();
  const bool light_jumps = jumps_in_middle(frame);
  const auto clock_does = [&] { return reading && clock_jumps(*reading, frame.signal); };
  const auto try_pause = [&](bool searches, bool jumps) {
    Hypothesis pausing{model, frame.may_search, true};
    auto& pause = pausing.model.pause = possible_pause(frame, state);
    searches = searches && !is_of_whole_frames(model.nuisance);
    if (!pause || (searches && try_hypothesis(pausing, frame, best)) || !jumps || !reading || reading->pause) return;
    put_in_doubt(*pause, *reading);
  };
  // Chips that are mostly right show what is mixed in; less of it shows more of them.
  const auto try_mixing = [&](bool searches) {
    Hypothesis mixed{given_model(state.exposure), false, true};
    const auto finds = [&] { return !fits() && (mixed.model.mixing = mixing_of(frame, best)); };
    while (finds() && try_hypothesis(mixed, frame, best)) {
    }
    mixed.searches = searches;
    mixed.refines = false;
    if (searches && mixed.model.mixing && !fits()) try_hypothesis(mixed, frame, best);
  };
  if (light_jumps) try_pause(true, true);
  try_mixing(false);
  if (fits() || (reading ? !state.other_models.is_due() : !frame.may_search)) {
    if (!light_jumps && clock_does()) try_pause(false, true);
    return best;
  }
  for (const Hypothesis& hypothesis : hypotheses(frame, best))
    if (!fits()) try_hypothesis(hypothesis, frame, best);
  try_mixing(frame.may_search);
  const bool jumps = light_jumps || clock_does();
  if (best.is_new_model ? jumps || model.warped : jumps && !light_jumps) try_pause(true, jumps);
  if (reading && model.pause && !reading->pause) put_in_doubt(*model.pause, *reading);
  if (fits())
    state.other_models.restart();
  else
    state.other_models.fail();
  return best;
}

}  // namespace ocisac
