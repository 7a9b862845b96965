#include "ocisac/receiver/chip_receiver.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "chips/chip_period.hpp"
#include "chips/lit_rows.hpp"
#include "ocisac/rows/chip_clock.hpp"
#include "receiver/chip_reliability.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kBlurredRows = 2;  // at a lamp's end, by a lens that blurs by up to a pixel

// The lit rows without those at a lamp's ends that the lens blurs.
RowRange sharp_rows(const CombinedColumn& column, const RowRange& region) {
  RowRange rows = lit_rows(column.signal, column.noise, region).rows;
  if (rows.size() <= 2 * kBlurredRows) return rows;
  if (rows.begin != region.begin) rows.begin += kBlurredRows;
  if (rows.end != region.end) rows.end -= kBlurredRows;
  return rows;
}

constexpr double kUnknownJump = 2;      // chips; standard error of the count where the clock jumped
constexpr double kAnyJump = 1e6;        // the same where frames may be missing
constexpr double kSamePhase = 0.1;      // chips
constexpr double kNoiseKept = 0.9;      // decay per frame: noise varies where the light fills only some of the rows
constexpr double kOthersEffort = 0.5;   // of a frame's: the effort for each of the other models
constexpr std::size_t kMaxWait = 7;     // frames
constexpr std::size_t kForgotten = 60;  // consecutive frames without chips, after which another light may appear

double mean_error_rate(std::span<const double> llr) {
  double sum = 0;
  for (double value : llr) sum += 1 / (1 + std::exp(std::abs(value)));
  return llr.empty() ? std::numeric_limits<double>::quiet_NaN() : sum / static_cast<double>(llr.size());
}

}  // namespace

ChipReceiver::ChipReceiver(const Camera& camera, ChipOptions options)
    : options_(std::move(options)),
      rows_(camera, {options_.chip_rate, options_.search_passes, options_.format}),
      assembler_(options_.format),
      stated_exposure_(camera.exposure) {}

void ChipReceiver::forget() {
  rows_.forget();
  kept_.forget();
  lost_ = fruitless_ = wait_ = 0;
  assembler_.lose_clock();
}

// On the tracker's clock, in frames: by its stamp, else by its number less the frames that were given twice.
double ChipReceiver::time_of(std::int64_t frame, const FrameStamp& stamp) {
  const bool goes_on = stamp.time.has_value() == last_stamp_.has_value() && (!stamp.time || *stamp.time > *last_stamp_);
  if (!goes_on) {
    rows_.restart_tracker(stamp.time.has_value());
    assembler_.lose_clock();
  }
  last_stamp_ = stamp.time;
  counted_ = stamp.time || stamp.number;
  return stamp.time ? *stamp.time / rows_.camera().frame_time.value_or(1.0) : static_cast<double>(frame - repeats_);
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
  if (result.stretch && result.stretch->outcome == StretchOutcome::repeated) kept_.drop_last();
}

// Index, on the light's clock, of the chip that begins at the estimated phase, and the doubt about it.
std::pair<std::ptrdiff_t, PlaceErrors> ChipReceiver::chip_number(const ChannelEstimate& channel, double time) {
  const auto predicted = rows_.predict(time);
  const bool sure = rows_.track(channel, time);
  if (!predicted) {
    assembler_.lose_clock();
    count_base_ = 0;
    if (!rows_.state().tracker) return {};
  }
  const double phase = channel.clock.phase + static_cast<double>(rows_.state().first_row),
               chip = channel.clock.rows_per_chip;
  const auto number = [&](const TrackedClock& clock) {
    const double chips = (phase - clock.clock.phase) / chip, whole = std::nearbyint(chips);
    return std::pair{static_cast<std::ptrdiff_t>(clock.chip) + static_cast<std::ptrdiff_t>(whole), chips - whole};
  };
  const auto after = number(*rows_.predict(time)).first;
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
  std::vector<double> llr = reliable_llr(reading);
  agree_with_code(llr, options_.format);
  std::vector<double> weights = code_weights(reading);
  agree_with_code(weights, options_.format);
  const ChipGrid whole = whole_chips(channel.clock, signal.size());
  for (std::size_t k = 0; k < whole.count; ++k) {
    const std::ptrdiff_t at = whole.first + static_cast<std::ptrdiff_t>(k) - reading.first;
    if (at < 0 || at >= static_cast<std::ptrdiff_t>(llr.size())) continue;
    if (result.bits.empty()) result.phase = whole.start(k) + static_cast<double>(rows_.state().first_row);
    result.llr.push_back(llr[static_cast<std::size_t>(at)]);
    result.bits += result.llr.back() > 0 ? '1' : '0';
  }
  result.rows_per_chip = channel.clock.rows_per_chip;
  result.rows_per_chip_std = channel.errors.rows_per_chip_std();
  result.exposure = channel.clock.exposure_rows * rows_.camera().row_time;
  result.exposure_std = channel.errors.exposure_rows_std() * rows_.camera().row_time;
  result.snr = std::min(std::pow(0.5 / std::max(reading.relative_noise, 1e-300), 2), 1e12);
  result.error_rate = mean_error_rate(result.llr);
  if (result.snr < kWeakSnr) result.flags |= flag::weak;
  if (is_misfit(reading)) result.flags |= flag::model_misfit;
  if (chip_period(whole_bits(reading, signal.size()))) result.flags |= flag::periodic;
  if (repeats_last(result)) {
    result.stretch.emplace().outcome = StretchOutcome::repeated;
  } else {
    const auto [number, errors] = chip_number(channel, time);
    result.stretch = assembler_.push(number + reading.first, weights, errors);
  }
  rows_.accept(reading, signal);
  LightState& state = rows_.state();
  state.fits = !is_misfit(reading);
  if (state.model.exposure_rows) state.model.exposure_rows = channel.clock.exposure_rows;
  state.relative_noise = std::max(reading.relative_noise, kNoiseKept * state.relative_noise);
  if (state.fits) rows_.keep_rate(channel);
  lost_ = fruitless_ = wait_ = 0;
}

// Searches are slow: the pause before the next one grows with the number of failures.
void ChipReceiver::lose(ReceivedFrame& result, const FrameRows& rows) {
  const bool paused = wait_ > 0;
  result.flags |= flag::no_signal;
  result.outcome = paused ? FrameOutcome::unsearched : FrameOutcome::no_signal;
  if (paused) {
    --wait_;
  } else if (!rows.is_noise.value_or(false)) {
    wait_ = std::min((std::size_t{1} << std::min<std::size_t>(fruitless_, 8)) - 1, kMaxWait);
    ++fruitless_;
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

// Chips of kept frames go to the packet, those of the current frame to `result`; `payload`: the first that is whole.
ProfileLearning::UseReading ChipReceiver::use_of_earlier(ReceivedFrame& result, std::optional<Payload>& payload) {
  last_bits_.clear();  // the frames are compared from the first one on
  return [this, &result, &payload](const KeptFrame& kept, const FrameReading& reading, std::span<const double> rest) {
    ReceivedFrame earlier = nothing_received(kept.number);
    ReceivedFrame& of_frame = kept.number == result.frame ? result : earlier;
    take(reading, kept.time, rest, of_frame);
    if (of_frame.stretch->payload && !payload) payload = of_frame.stretch->payload;
    return of_frame.stretch->outcome == StretchOutcome::repeated;
  };
}

// Reads the kept frames again where a new model explains the current one and did not explain earlier ones: their chips
// count from the beginning on. `reading`: of the current frame, in the `lit` rows.
void ChipReceiver::read_again(const FrameReading& reading, RowRange lit, const CombinedColumn& column,
                              std::size_t first_row, ReceivedFrame& result, std::optional<Payload>& payload) {
  if (kept_.doubtful() == 0) return;
  const LightState before = rows_.state();
  LightState& state = rows_.state();
  if (state.tracker) state.tracker->reset();
  state.fits = true;
  state.relative_noise = reading.relative_noise;
  rows_.accept(reading, std::span(column.signal).subspan(lit.begin, lit.size()));
  if (kept_.doubtful() + 1 == kept_.size())
    assembler_.restart();  // all its chips are in doubt
  else
    assembler_.lose_clock();
  kept_.read_again(rows_, column, first_row, lit, use_of_earlier(result, payload));
  if (!result.stretch) state = before;
}

// Kept frames that were given again had a wrong time, and all after them: the clock restarts. Returns their number.
double ChipReceiver::drop_given_again() {
  const std::int64_t dropped = kept_.drop_given_again();
  if (dropped == 0) return 0;
  repeats_ += dropped;
  if (rows_.state().tracker) rows_.state().tracker->reset();
  assembler_.lose_clock();
  return static_cast<double>(dropped);
}

// Follows the lamp's profile along the rows, or learns it from the kept frames; these are read again where it, or a new
// model, explains what was not explained before.
std::optional<Payload> ChipReceiver::learn(const std::optional<FrameReading>& reading, FrameRows& now,
                                           std::size_t first_row, RowRange lit, ReceivedFrame& result) {
  if (!kept_.follow(reading, rows_)) assembler_.lose_clock();
  const bool in_doubt = kept_.all_doubtful();
  std::optional<Payload> payload;
  const bool due = kept_.comes_due();
  if (due) now.time -= drop_given_again();
  if (due && kept_.learn_first(rows_, now.column, first_row)) {
    if (in_doubt)
      assembler_.restart();  // all its chips
    else
      assembler_.lose_clock();
    kept_.read_again(rows_, now.column, first_row, use_of_earlier(result, payload));
    rows_.state().first_row = first_row + lit.begin;
  } else if (reading && !is_misfit(*reading) && now.new_model && !kept_.profile()) {
    read_again(*reading, lit, now.column, first_row, result, payload);
  }
  return payload;
}

ReceivedFrame ChipReceiver::push(const CombinedColumn& seen, std::int64_t frame, std::size_t first_row, RowRange region,
                                 const FrameStamp& stamp) {
  rows_.use_exposure(stamp.exposure ? stamp.exposure : stated_exposure_);
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
  kept_.keep(column, frame, time, counted_, first_row);
  const auto& learned = kept_.profile();
  const bool has_profile = learned.has_value();
  const RowRange lit = has_profile ? learned->rows : sharp_rows(column, region);
  const auto rest = has_profile ? without_profile(column.signal, learned->profile, lit) : std::vector<double>{};
  const auto signal =
      has_profile ? std::span<const double>(rest) : std::span(column.signal).subspan(lit.begin, lit.size());
  rows_.state().first_row = first_row + lit.begin;
  if (column.saturated) result.flags |= flag::saturated;
  const auto recent = kept_.rows_of_all(lit.begin, lit.size());
  const SearchEffort effort = rows_.effort(signal.size());
  FrameRows now{column, time, wait_ == 0, effort, {.rows = kOthersEffort * effort.rows}, recent};
  const auto reading = rows_.read(signal, now);
  std::optional<Payload> payload;
  if (!reading && rows_.shows_no_light(signal, now))
    kept_.drop_last();  // darkness and noise teach no profile
  else
    payload = learn(reading, now, first_row, lit, result);
  if (!result.stretch && reading)
    take(*reading, now.time, signal, result);
  else if (!result.stretch)
    lose(result, now);
  if (payload && !result.stretch) result.stretch.emplace().outcome = StretchOutcome::unreadable;
  if (payload) result.stretch->payload = std::move(payload);
  forget_repeated(result);
  return result;
}

}  // namespace ocisac
