#include "ocisac/receiver/chip_receiver.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>
#include <utility>

#include "chips/chip_period.hpp"
#include "chips/lit_rows.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/receiver/receive.hpp"
#include "ocisac/rows/chip_clock.hpp"
#include "receiver/reading_trust.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kBlurredRows = 2;  // at a lamp's end, by a lens that blurs by up to a pixel
constexpr double kBrightLight = 10;      // power of the columns' common light over its noise
constexpr double kUnknownJump = 2;       // chips; standard error of the count where the clock jumped
constexpr double kAnyJump = 1e6;         // the same where frames may be missing
constexpr std::size_t kMinPairs = 6;     // of frames
constexpr int kAlternating = 2;          // frames in a row
constexpr int kSureRuns = 13;            // of even numbers of chips: chance is 1e-4
constexpr double kSureCount = 8;         // nats, of a chip after a pause
constexpr std::size_t kForgotten = 60;   // consecutive frames without chips, after which another light may appear

// The lit rows without those at a lamp's ends that the lens blurs.
RowRange sharp_rows(const CombinedColumn& column, const RowRange& region, const DarkRows& dark) {
  RowRange rows = lit_rows(column.signal, column.noise, region, dark).rows;
  if (rows.size() <= 2 * kBlurredRows) return rows;
  if (rows.begin != region.begin) rows.begin += kBlurredRows;
  if (rows.end != region.end) rows.end -= kBlurredRows;
  return rows;
}

// The longest part of the rows that does not repeat the frame before from row to row within the noise, over more chips
// than two frames have alike by chance: decoders fill slices that were lost with it. All rows, where all repeat it.
RowRange fresh_rows(const CombinedColumn& column, std::span<const double> before, std::optional<double> chip,
                    const RowRange& rows) {
  if (before.empty() || !chip) return rows;
  const auto most = static_cast<std::size_t>(kDarkChips * *chip);
  const double noise = std::isfinite(column.noise) ? column.noise : 0.0;  // one column, which has no weights
  RowRange fresh{rows.begin, rows.begin};
  for (std::size_t begin = rows.begin, n = rows.begin, alike = 0; n <= rows.end; ++n) {
    if (n < rows.end && std::abs(column.signal[n] - before[n]) <= noise) {
      ++alike;
      continue;
    }
    const bool repeats = alike > most;
    const std::size_t end = repeats ? n - alike : n;
    if (end - std::min(end, begin) > fresh.size()) fresh = {begin, end};
    if (repeats) begin = n;
    alike = 0;
  }
  return fresh.size() > 0 ? fresh : rows;
}

// Chips whose numbers a reading knows: of a misfit, the run that its clock explains, if that is before a pause whose
// count is not sure.
RowRange known_chips(const FrameReading& reading, std::span<const double> seen, std::size_t pause, double sureness) {
  if (reading.trust >= Trust::sure) return {0, seen.size()};
  const RowRange run = explained_chips(seen);
  return run.begin >= pause || sureness < kSureCount ? explained_chips(seen.first(pause)) : run;
}

// How sure a chip of a run can be, nats: the others have another clock, as far as they are expected to be wrong, and
// the run may have it, too.
double most_sure(std::span<const double> seen, const RowRange& run) {
  const auto count = static_cast<double>(seen.size());
  const double other = (1 - static_cast<double>(run.size()) / count) * expected_errors(seen) / count;
  return other > 0 ? std::log((1 - other) / other) : std::numeric_limits<double>::infinity();
}

// A misfit on one clock whose chips a profile can be learned from.
bool is_mostly_right(const FrameReading& reading) {
  const auto chips = static_cast<double>(reading.llr.size());
  return reading.trust == Trust::misfit && !reading.pause &&
         expected_errors(reliable_llr(reading)) < kNextToNone * chips;
}

// Without dark chips at either end of the rows that are more than the line code has in a row: the lamp does not reach
// there, its sender pauses, or a preamble is cut.
void drop_dark_ends(FrameReading& reading, std::size_t rows, std::size_t longest) {
  const std::vector<std::uint8_t> bits = whole_bits(reading, rows);
  const auto before = static_cast<std::size_t>(std::ranges::find(bits, 1) - bits.begin()),
             after = static_cast<std::size_t>(std::find(bits.rbegin(), bits.rend(), 1) - bits.rbegin());
  if (before == bits.size()) return;
  const std::ptrdiff_t first = whole_chips(reading, rows).first - reading.first;
  const std::ptrdiff_t begin = before > longest ? first + static_cast<std::ptrdiff_t>(before) : 0,
                       end = after > longest ? first + std::ssize(bits) - static_cast<std::ptrdiff_t>(after)
                                             : std::ssize(reading.llr);
  for (std::vector<double>* values : {&reading.llr, &reading.excess})
    *values = std::vector<double>(values->begin() + begin, values->begin() + end);
  reading.first += begin;
}

// A reading's chips that lie whole in the rows, and its channel.
void describe(const FrameReading& reading, const FrameRows& rows, const RowReader& reader, ReceivedFrame& result) {
  const ChannelEstimate& channel = reading.channel;
  const ChipGrid whole = whole_chips(reading, rows.signal.size());
  const std::vector<double> all = reliable_llr(reading);
  const auto seen = std::span(all).subspan(static_cast<std::size_t>(whole.first - reading.first), whole.count);
  const double sureness = reading.pause ? reading.pause->sureness() : std::numeric_limits<double>::infinity();
  const auto before = std::clamp<std::ptrdiff_t>(reading.after_pause - whole.first, 0, std::ssize(seen));
  const std::size_t pause = reading.pause ? static_cast<std::size_t>(before) : whole.count;
  const RowRange run = known_chips(reading, seen, pause, sureness);
  const double most = most_sure(seen, run);
  for (std::size_t k = run.begin; k < run.end; ++k) result.llr.push_back(std::clamp(seen[k], -most, most));
  if (run.size() > 0)
    result.phase = picture_row(whole.start(run.begin), reading.warp) + static_cast<double>(rows.first_row);
  const bool agrees = agree_with_code(result.llr, reader.options().format);
  for (std::size_t k = 0; k < run.size(); ++k) {
    double& llr = result.llr[k];
    if (run.begin + k >= pause) llr = std::clamp(llr, -sureness, sureness);
    result.bits += llr > 0 ? '1' : '0';
  }
  result.rows_per_chip = channel.clock.rows_per_chip;
  result.rows_per_chip_std = channel.errors.rows_per_chip_std();
  result.exposure = channel.clock.exposure_rows * reader.camera().row_time;
  result.exposure_std = channel.errors.exposure_rows_std() * reader.camera().row_time;
  result.snr = std::min(std::pow(0.5 / std::max(reading.relative_noise, 1e-300), 2), kMaxSnr);
  result.error_rate = expected_errors(result.llr) / static_cast<double>(result.llr.size());
  if (result.snr < kWeakSnr) result.flags |= flag::weak;
  if (reading.trust != Trust::fits || reading.clock_in_doubt || !agrees || sureness < kSureCount)
    result.flags |= flag::model_misfit;
  if (chip_period(whole_bits(reading, rows.signal.size()))) result.flags |= flag::periodic;
}

}  // namespace

void ChipRuns::add(std::span<const std::uint8_t> bits) {
  std::size_t last = 0;
  for (std::size_t k = 1; k < bits.size(); ++k) {
    if (bits[k] == bits[k - 1]) continue;
    if (last > 0) common_ = std::gcd(common_, k - last), ++runs_;
    last = k;
  }
  if (common_ == 1) common_ = 0, runs_ = -kSureRuns;
}

bool ChipRuns::are_repeated() const {
  return common_ > 1 && static_cast<double>(runs_) * std::log2(common_) >= kSureRuns;
}

double FrameTimes::next(double stamped) {
  even_ = stamped_ < stamped ? even_ + std::max(std::nearbyint(stamped - stamped_), 1.0) : stamped;
  stamped_ = stamped;
  return are_even_ ? even_ : stamped_;
}

bool FrameTimes::add(double time, const ChipClock& clock, double frame_rows) {
  if (are_even_ || time != stamped_) return false;
  const auto turn = [&](double frames) {
    return std::polar(1.0, kTwoPi * (frames * frame_rows + clock.phase - last_phase_) / clock.rows_per_chip);
  };
  const double rows = (stamped_ - even_) * frame_rows;
  most_late_ = std::max(most_late_, rows);
  most_early_ = std::max(most_early_, -rows);
  if (last_stamped_ < stamped_) {
    stamped_turns_ += turn(stamped_ - last_stamped_);
    even_turns_ += turn(even_ - last_even_);
    ++pairs_;
  }
  last_stamped_ = stamped_;
  last_even_ = even_;
  last_phase_ = clock.phase;
  if (pairs_ < kMinPairs) return false;
  const auto turning = [this](std::complex<double> turns) { return 1 - std::abs(turns) / static_cast<double>(pairs_); };
  const double off = most_late_ + most_early_;
  const bool may_be_rounded = off > kSmallShare * clock.rows_per_chip;  // even by whole chips
  const double most = may_be_rounded ? kNextToNone : 0.0;
  are_even_ = turning(even_turns_) < std::max(most, kSmallShare * turning(stamped_turns_));
  return are_even_;
}

ReceivedFrame nothing_received(std::int64_t frame) {
  ReceivedFrame result;
  result.frame = frame;
  for (double* value : {&result.phase, &result.rows_per_chip, &result.rows_per_chip_std, &result.exposure,
                        &result.exposure_std, &result.snr, &result.error_rate})
    *value = kNaN;
  return result;
}

ChipReceiver::ChipReceiver(const Camera& camera, ChipOptions options)
    : reader_(camera, std::move(options)),
      state_(reader_.first_state(reader_.new_tracker(false))),
      assembler_(reader_.options().format) {}

void ChipReceiver::forget() {
  state_ = reader_.first_state(state_.tracker);
  history_ = {};
  dark_before_ = dark_after_ = 0;
  runs_ = {};
  lost_ = 0;
  search_.restart();
  assembler_.lose_clock();
}

// On the tracker's clock, in frames: by its stamp, else by its number less the frames that were given twice.
double ChipReceiver::time_of(std::int64_t frame, const FrameStamp& stamp) {
  const auto count = [&] { return static_cast<double>(frames_between(*first_frame_, frame)); };
  const bool goes_on = first_frame_ && count() < kMostCounted && stamp.time.has_value() == last_stamp_.has_value() &&
                       (!stamp.time || *stamp.time > *last_stamp_);
  if (!goes_on) {
    first_frame_ = frame;
    times_ = {};
    state_.tracker = reader_.new_tracker(stamp.time.has_value());
    assembler_.lose_clock();
  }
  last_stamp_ = stamp.time;
  const auto& frame_time = reader_.camera().frame_time;
  if (stamp.time) return frame_time ? times_.next(*stamp.time / *frame_time) : *stamp.time;
  return count() - static_cast<double>(repeats_);
}

// A frame shows nothing new and took no time, where it is not counted. Where each second one does, the film is of half
// its rate, if the clock does not say that it is not.
void ChipReceiver::pass_idle(std::int64_t frame, bool is_mean) {
  means_ = is_mean;
  const std::int64_t gap = frames_between(std::exchange(last_idle_, frame), frame);
  alternating_ = gap == 2 ? alternating_ + 1 : 0;
  idle_gap_ = gap;
  if (counted_) return;
  ++repeats_;
  if (alternating_ < kAlternating || !state_.tracker || !state_.channel || state_.tracker->is_steady()) return;
  const Camera& camera = reader_.camera();
  set_frame_rows(2 * camera.frame_time.value_or(1.0) / camera.row_time);
  alternating_ = std::numeric_limits<int>::min();  // once
}

// From the beginning of a frame to that of the next, other than frame time and row time say.
void ChipReceiver::set_frame_rows(double rows) {
  if (!state_.tracker) return;
  reader_.set_frame_rows(rows, *state_.tracker);
  assembler_.set_rate(rows / state_.channel->clock.rows_per_chip);
}

// As bright as with the exposure and the gain of the first frame that states them.
void ChipReceiver::make_as_bright(CombinedColumn& column, const FrameStamp& stamp) {
  if (!stamp.exposure && !stamp.gain) return;
  if (stamp.exposure && !reference_exposure_) reference_exposure_ = stamp.exposure;
  const double brightness = stamp.gain.value_or(1.0) * (stamp.exposure ? *stamp.exposure / *reference_exposure_ : 1.0);
  for (double& row : column.signal) row /= brightness;
  column.noise /= brightness;
}

ChipFrame ChipReceiver::explain(CombinedColumn column, std::int64_t frame, std::size_t first_row, RowRange region,
                                const FrameStamp& stamp) {
  state_ = reader_.with_exposure(std::move(state_), stamp.exposure ? stamp.exposure : reader_.camera().exposure);
  make_as_bright(column, stamp);
  search_.pass_frame();
  ChipFrame now{.result = nothing_received(frame)};
  if (column.saturated) now.result.flags |= flag::saturated;
  FrameRows& rows = now.rows;
  history_.keep({.number = frame,
                 .time = 0,
                 .signal = column.signal,
                 .bright = column.quality > kBrightLight,
                 .counted = counted_},
                first_row);
  counted_ = stamp.time || stamp.number;
  if (const auto mean = history_.drop_mean()) pass_idle(*mean, true);
  now.may_be_mean = means_ && frames_between(last_idle_, frame) == idle_gap_;
  rows.time = history_.frames.back().time = time_of(frame, stamp);
  const auto& learned = history_.profile;
  const RowRange lit = learned ? learned->rows
                               : fresh_rows(column, history_.frames.back().before, state_.rows_per_chip,
                                            sharp_rows(column, region, {.before = dark_before_, .after = dark_after_}));
  rows.first_row = first_row + lit.begin;
  const auto lit_signal = std::span(column.signal).subspan(lit.begin, lit.size());
  rows.signal = learned ? without_profile(column.signal, learned->profile, lit)
                        : std::vector<double>(lit_signal.begin(), lit_signal.end());
  rows.recent = history_.rows_of_all(lit.begin, lit.size());
  rows.before = rows_before(history_.frames.back(), learned, lit);
  const RowRange fewer = learned ? lit : sharp_rows(column, region, {.expected = true});
  now.lamp = {std::max(fewer.begin, lit.begin) - lit.begin, std::min(fewer.end, lit.end) - lit.begin};
  rows.may_search = search_.is_due();
  rows.effort = reader_.effort(state_, lit.size());
  rows.effort_of_others = {.rows = kMostly * rows.effort.rows};
  if (!state_.rows_per_chip && rows.may_search && !reader_.shows_no_light(rows, state_)) {
    Camera camera = reader_.camera();
    camera.exposure = state_.exposure;
    state_.rows_per_chip = blind_rows_per_chip(column, camera);
  }
  return now;
}

// Kept frames that were given again had a wrong time, and all after them: the clock restarts. Returns their number.
double ChipReceiver::drop_given_again() {
  const std::int64_t dropped = history_.drop_given_again();
  if (dropped == 0) return 0;
  repeats_ += dropped;
  if (state_.tracker) state_.tracker->reset();
  assembler_.lose_clock();
  return static_cast<double>(dropped);
}

// Reads the kept frames again, less a profile, by the model of a state that explains the current one and did not
// explain earlier ones: their chips count from the beginning on.
void ChipReceiver::read_again(ChipFrame& frame, const LearnedProfile& profile, LightState state) {
  std::swap(state_, state);
  last_bits_.clear();  // the frames are compared from the first one on
  runs_ = {};
  double repeated = 0;
  for (KeptFrame& kept : history_.frames) {
    kept.time -= repeated;
    ChipFrame again{.result = nothing_received(kept.number)};
    again.rows.effort = again.rows.effort_of_others = reader_.effort(state_, profile.rows.size());
    again.reading = read_kept(reader_, profile, state_, history_.first_row, kept, again.rows);
    if (&kept == &history_.frames.back()) {
      if (!again.reading) break;
      frame.reading = std::move(again.reading);
      frame.rows = std::move(again.rows);
      return history_.drop_repeated();
    }
    if (!again.reading) continue;
    place(again);
    const ReceivedFrame earlier = decode(std::move(again));
    kept.repeats = earlier.stretch->outcome == StretchOutcome::repeated;
    repeated += kept.repeats;
    if (earlier.stretch->payload && !frame.earlier) frame.earlier = earlier.stretch->payload;
  }
  history_.drop_repeated();
  if (history_.profile)
    frame.reading.reset();
  else
    state_ = std::move(state);
}

// True for a frame that may be a mean of its neighbours, which has no chips, and is not on the clock.
bool ChipReceiver::is_mean(const ChipFrame& frame) const {
  if (!frame.may_be_mean) return false;
  FrameRows followed = frame.rows;
  followed.may_search = false;
  const auto reading = reader_.read_with(state_.model, followed, state_);
  return !reading || reading->trust != Trust::fits;
}

// Learns the lamp's profile from the kept frames, and reads them by it.
bool ChipReceiver::learn(ChipFrame& frame) {
  if (!history_.comes_due()) return false;
  const bool in_doubt = history_.doubtful() == history_.frames.size();
  frame.rows.time -= drop_given_again();
  if (!history_.is_long_enough()) return false;
  auto learned = learn_profile(reader_, history_, state_);
  if (!learned) {
    history_.attempts.fail();
    return false;
  }
  restart_packet(in_doubt);
  history_.attempts.restart();
  history_.frames = std::move(learned->frames);
  history_.profile = std::move(learned->profile);
  read_again(frame, *history_.profile, with_new_phase(std::move(learned->state)));
  return true;
}

// `all`: all its chips are in doubt.
void ChipReceiver::restart_packet(bool all) {
  if (all)
    assembler_.restart();
  else
    assembler_.lose_clock();
}

// Where all rows do not fit, and those of a lamp that dark rows end do: these.
RowsRead ChipReceiver::read_lamp(ChipFrame& frame) {
  const auto fits = [](const RowsRead& read) { return read.reading && read.reading->trust == Trust::fits; };
  std::optional<FrameRows> of_lamp;
  if (frame.lamp.size() < frame.rows.signal.size()) of_lamp = part_of(frame.rows, frame.lamp);
  RowsRead read = reader_.read(frame.rows, state_);  // a copy: a reading may be interrupted
  if (of_lamp && !fits(read)) {
    RowsRead within = reader_.read(*of_lamp, state_);
    if (fits(within)) frame.rows = std::move(*of_lamp), read = std::move(within);
  }
  if (!fits(read) || history_.profile) return read;
  const std::size_t before = frame.rows.first_row - history_.first_row,
                    after = history_.frames.back().signal.size() - before - frame.rows.signal.size();
  if (before > 0) dark_before_ = before;
  if (after > 0) dark_after_ = after;
  return read;
}

void ChipReceiver::read(ChipFrame& frame) {
  if (is_mean(frame)) return;
  RowsRead read = read_lamp(frame);
  state_ = std::move(read.state);
  frame.reading = std::move(read.reading);
  if (!frame.reading && reader_.shows_no_light(frame.rows, state_)) {
    history_.frames.pop_back();  // darkness and noise teach no profile
    return;
  }
  if (!follow_profile(reader_, frame.reading, history_, state_)) return assembler_.lose_clock();  // no frame is kept
  const auto none = [&] {
    const std::size_t count = history_.frames.back().signal.size(), begin = frame.rows.first_row - history_.first_row;
    return LearnedProfile{.profile = {std::vector<double>(count), std::vector<double>(count, 1.0)},
                          .rows = {begin, begin + frame.rows.signal.size()}};
  };
  if (frame.reading && !history_.profile && is_mostly_right(*frame.reading))
    history_.frames.back().expose(*frame.reading, none());
  if (learn(frame) || !read.is_new_model || !frame.reading) return;
  if (state_.model.pause)  // another count of lost chips, too
    for (KeptFrame& kept : history_.frames)
      if (&kept != &history_.frames.back()) kept.trust.reset();
  if (frame.reading->trust != Trust::fits || history_.profile || history_.doubtful() == 0) return;
  restart_packet(history_.doubtful() + 1 == history_.frames.size());
  LightState state = state_;
  if (state.tracker) state.tracker->reset();
  state.fits = true;
  state.relative_noise = frame.reading->relative_noise;
  state.accept(*frame.reading, frame.rows.signal);
  read_again(frame, none(), std::move(state));
}

// A frame with the last one's chips at their place is the same; not counted, it took no time.
bool ChipReceiver::repeats_last(const ReceivedFrame& result) {
  const bool same = result.bits == last_bits_ && !(result.flags & flag::periodic) &&
                    std::abs(result.phase - last_phase_) < kSamePhase * result.rows_per_chip;
  if (same) pass_idle(result.frame, false);
  last_bits_ = result.bits;
  last_phase_ = result.phase;
  return same;
}

// The number of the chip that begins at the estimated phase, and the doubt about it.
void ChipReceiver::count_chips(ChipFrame& frame) {
  const ChannelEstimate& channel = frame.reading->channel;
  frame.first_chip = frame.reading->first;
  const auto predicted = state_.predict(frame.rows.time);
  const bool sure = state_.track(channel, frame.rows.first_row, frame.rows.time);
  if (!predicted) {
    assembler_.lose_clock();
    count_base_ = 0;
    if (!state_.tracker) return;
  }
  const double phase = channel.clock.phase + static_cast<double>(frame.rows.first_row),
               chip = channel.clock.rows_per_chip;
  const Camera& camera = reader_.camera();
  const auto chips_after = [&](const TrackedClock& clock) { return (phase - clock.clock.phase) / chip; };
  const auto number = [&](const TrackedClock& clock) {
    return static_cast<std::ptrdiff_t>(clock.chip) + static_cast<std::ptrdiff_t>(std::nearbyint(chips_after(clock)));
  };
  const std::ptrdiff_t after = number(*state_.predict(frame.rows.time));
  if (predicted) {
    if (!sure) count_base_ += number(*predicted) - after;
    const double chips = chips_after(*predicted);
    frame.place_errors = {.offset = chips - std::nearbyint(chips),
                          .scatter = predicted->errors.phase_std(0) / chip,
                          .slip = sure       ? 0.0
                                  : counted_ ? kUnknownJump
                                             : kAnyJump};
  }
  frame.place_errors.time = frame.rows.time;
  if (const auto& rate = reader_.options().chip_rate)
    frame.place_errors.told_drift = camera.frame_time.value_or(1.0) * (1 / (camera.row_time * chip) - *rate);
  // No chip is seen before the last one of the frame before, whatever the frame time says.
  if (predicted) count_base_ += std::max(end_chip_ - (frame.first_chip + count_base_ + after), std::ptrdiff_t{0});
  frame.first_chip += count_base_ + after;
  end_chip_ = frame.first_chip + std::ssize(frame.reading->llr);
  if (!last_stamp_ || !camera.frame_time) return;
  ChipClock clock = channel.clock;
  clock.phase = phase;
  const double frame_rows = *camera.frame_time / camera.row_time;
  if (!times_.add(frame.rows.time, clock, frame_rows)) return;
  reader_.set_frame_rows(frame_rows, *state_.tracker);
  state_.tracker->reset();
  assembler_.restart();
}

void ChipReceiver::place(ChipFrame& frame) {
  if (!frame.reading) return lose(frame);
  drop_dark_ends(*frame.reading, frame.rows.signal.size(), reader_.options().format.line_code.longest_run());
  const FrameReading& reading = *frame.reading;
  describe(reading, frame.rows, reader_, frame.result);
  frame.repeats = repeats_last(frame.result);
  if (!frame.repeats) {
    count_chips(frame);
    if (reading.trust >= Trust::sure) runs_.add(whole_bits(reading, frame.rows.signal.size()));
  }
  if (runs_.are_repeated()) frame.result.flags |= flag::model_misfit;
  state_.accept(reading, frame.rows.signal);
  state_.fits = reading.trust == Trust::fits;
  if (state_.model.pause) state_.model.pause = reading.pause;
  if (!state_.model.nuisance.empty()) state_.model.nuisance = reading.nuisance;
  if (state_.model.exposure_rows) state_.model.exposure_rows = reading.channel.clock.exposure_rows;
  state_.relative_noise = std::max(reading.relative_noise, kNearlyAll * state_.relative_noise);
  if (state_.fits) state_.rows_per_chip = reading.channel.clock.rows_per_chip;
  lost_ = 0;
  search_.restart();
}

// Searches are slow: the pause before the next one grows with the number of failures.
void ChipReceiver::lose(ChipFrame& frame) {
  const bool paused = !search_.is_due();
  frame.result.flags |= flag::no_signal;
  frame.result.outcome = FrameOutcome::no_signal;
  if (frame.may_be_mean) return;
  frame.result.outcome = paused ? FrameOutcome::unsearched : FrameOutcome::no_signal;
  if (!paused && !frame.rows.is_noise.value_or(false)) search_.fail();
  if (++lost_ < kForgotten) return;
  const BackOff search = search_;
  forget();
  search_ = search;
}

ReceivedFrame ChipReceiver::decode(ChipFrame frame) {
  ReceivedFrame& result = frame.result;
  if (frame.repeats) {
    result.stretch.emplace().outcome = StretchOutcome::repeated;
  } else if (frame.reading) {
    std::vector<double> weights = code_weights(*frame.reading);
    agree_with_code(weights, reader_.options().format);
    result.stretch = assembler_.push(frame.first_chip, weights, frame.place_errors);
    if (const auto chips = assembler_.even_rate()) set_frame_rows(*chips * frame.reading->channel.clock.rows_per_chip);
  }
  // A frame that repeats the last one has its time, too.
  if (result.stretch && result.stretch->outcome == StretchOutcome::repeated && !history_.frames.empty() &&
      history_.frames.back().number == result.frame)
    history_.frames.pop_back();
  if (!frame.earlier) return std::move(result);
  if (!result.stretch) result.stretch.emplace().outcome = StretchOutcome::unreadable;
  result.stretch->payload = std::move(frame.earlier);
  return std::move(result);
}

}  // namespace ocisac
