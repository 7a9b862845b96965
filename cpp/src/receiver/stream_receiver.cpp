#include "ocisac/receiver/stream_receiver.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "ocisac/camera/linear_light.hpp"
#include "ocisac/receiver/column_combination.hpp"
#include "ocisac/receiver/detector.hpp"
#include "ocisac/receiver/preamble.hpp"
#include "ocisac/receiver/receive.hpp"
#include "ocisac/receiver/sequence_detector.hpp"
#include "ocisac/require.hpp"

namespace ocisac {

namespace {

constexpr double kFrameTimeError = 1e-4;   // standard error of a nominal frame time, a share
constexpr double kSurePrediction = 0.15;   // chips; standard error up to which a predicted clock is begun with
constexpr double kNarrowTolerance = 2e-3;  // of a rate that frames have told
constexpr double kWideTolerance = 0.02;    // of a nominal one
constexpr double kLeastSwing = 3;          // standard deviations of a row
constexpr double kMostErrors = 2e-3;       // expected share of wrong chips
constexpr double kMostErrorsIfEven = 0.08;
constexpr double kAsNoisy = 1.2, kMostNoisier = 2;  // times the frame before
constexpr double kLeastNoise = 1e-4;                // of the swing, for the detector
constexpr std::size_t kPhases = 6;                  // tried in a chip where it cannot be predicted
constexpr int kSettlingRounds = 2;
constexpr std::size_t kPreamblesTried = 3;
constexpr double kFewestChips = 12;  // in a frame
constexpr double kWeakSnr = 9;

// The colour channel in which the light stands out most.
std::pair<CombinedColumn, std::size_t> best_column(std::span<const AnyFramesView> channels, const ToneCurve& curve) {
  std::pair<CombinedColumn, std::size_t> best;
  for (std::size_t channel = 0; channel < channels.size(); ++channel) {
    auto column = combine_columns(channels[channel], 0, curve);
    if (channel == 0 || column.quality > best.first.quality) best = {std::move(column), channel};
  }
  return best;
}

// Shapes are looked at before: what `check` is left to refuse are pixels that are no numbers.
bool are_numbers(std::span<const AnyFramesView> channels) try {
  for (const auto& channel : channels) check(channel);
  return true;
} catch (const std::invalid_argument&) {
  return false;
}

double middle_swing(const ChannelEstimate& channel, std::size_t rows) {
  return channel.swing_at(0.5 * static_cast<double>(rows), rows);
}

// The chips that all rows see, asked of a detector.
struct Question {
  std::vector<double> rows;
  ChipQuestion asked{};

  Question(std::span<const double> signal, const ChannelEstimate& channel) : rows(signal.size()) {
    const ChipClock& clock = channel.clock;
    for (std::size_t n = 0; n < rows.size(); ++n) {
      const auto row = static_cast<double>(n);
      rows[n] = (signal[n] - channel.dark_at(row, rows.size())) / channel.swing_at(row, rows.size());
    }
    const auto chip_at = [&](double row) {
      return static_cast<std::ptrdiff_t>(std::floor((row - clock.phase) / clock.rows_per_chip));
    };
    const double half = 0.5 * clock.exposure;
    const std::ptrdiff_t first = chip_at(-half), last = chip_at(static_cast<double>(rows.size()) - 1 + half);
    const double swing = channel.swing_at(0.5 * static_cast<double>(rows.size()), rows.size());
    asked = {rows, clock, std::max(channel.noise / swing, kLeastNoise), first,
             static_cast<std::size_t>(last - first + 1)};
  }
  Question(const Question&) = delete;
  Question& operator=(const Question&) = delete;

  [[nodiscard]] bool allowed() const {
    return std::isfinite(asked.noise) && std::ranges::all_of(rows, [](double row) { return std::isfinite(row); }) &&
           asked.clock.exposure <= kLongestDetectedExposure * asked.clock.rows_per_chip;
  }
};

// No chips, so no channel, where the exposure is estimated too long for the trellis.
std::vector<double> detect(const ChipQuestion& question) {
  if (!(question.clock.exposure <= kLongestDetectedExposure * question.clock.rows_per_chip))
    return std::vector<double>(question.count);
  return detect_sequence_levels(question);
}

// Detection and least squares in turn on the whole frame, from a channel that is nearly right.
std::optional<RefinedChannel> settle(std::span<const double> signal, ChannelEstimate channel, bool exposure_known) {
  const ChannelModel model{channel.dark.size() - 1, channel.swing.size() - 1, exposure_known};
  RefinedChannel result;
  for (int round = 0; round < kSettlingRounds; ++round) {
    const Question question(signal, channel);
    if (!question.allowed()) return std::nullopt;
    auto chips = detect(question.asked);
    auto fitted = fit_channel(signal, {chips, question.asked.first}, channel.clock, model);
    if (!fitted) return std::nullopt;
    result.settled = chips == result.chips && question.asked.first == result.first;
    result.chips = std::move(chips);
    result.first = question.asked.first;
    channel = std::move(*fitted);
  }
  result.channel = std::move(channel);
  return result;
}

double error_rate(std::span<const double> llr) {
  double sum = 0;
  for (double value : llr) sum += 1 / (1 + std::exp(std::abs(value)));
  return llr.empty() ? std::numeric_limits<double>::quiet_NaN() : sum / static_cast<double>(llr.size());
}

// Chips of which few are expected to be wrong: hardly any, unless the channel explains all parts of the frame alike.
// Chips made of nothing but noise let expect that a fifth is wrong.
bool is_sound(std::span<const double> signal, const RefinedChannel& found) {
  const ChannelEstimate& channel = found.channel;
  if (!(middle_swing(channel, signal.size()) > kLeastSwing * channel.noise)) return false;
  const Question question(signal, channel);
  if (!question.allowed()) return false;
  const auto llr = detect_sequence(question.asked).log_likelihood_ratios;
  const auto edge = static_cast<std::size_t>(std::ceil(channel.clock.exposure / channel.clock.rows_per_chip)) + 1;
  return llr.size() > 3 * edge && error_rate(std::span(llr).subspan(edge, llr.size() - 2 * edge)) <
                                      (found.even ? kMostErrorsIfEven : kMostErrors);
}

}  // namespace

Receiver::Receiver(const Camera& camera, ReceiverOptions options)
    : camera_(camera), options_(std::move(options)), assembler_(options_.format) {
  check(camera);
  if (options_.chip_rate) {
    require_positive("chip_rate", *options_.chip_rate);
    rows_per_chip_ = 1 / (*options_.chip_rate * camera.row_time);
    require(*rows_per_chip_ >= 1, "chip_rate", *options_.chip_rate, "at most the row rate");
  }
  const auto chips = preamble_chips(options_.format.preamble);
  preamble_.assign(chips.begin(), chips.end());
  if (camera.frame_time) {
    const double rows = *camera.frame_time / camera.row_time;
    tracker_.emplace(TrackerOptions{.frame_rows = rows, .frame_rows_std = kFrameTimeError * rows});
  }
}

// What is known of the rate before a frame is looked at; blind, where it was not given.
std::optional<double> Receiver::nominal_rows_per_chip(std::span<const AnyFramesView> channels) {
  if (!rows_per_chip_) {
    const Received blind = receive(channels, camera_).front();
    if (!blind.bits.empty()) rows_per_chip_ = blind.rows_per_chip;
  }
  return rows_per_chip_;
}

// With what the frames before told: levels, rate and exposure, and the phase where it can be predicted, else several.
std::optional<RefinedChannel> Receiver::follow(std::span<const double> signal, std::int64_t frame) const {
  if (!channel_) return std::nullopt;
  ChannelEstimate start = *channel_;
  const auto predicted = tracker_ ? tracker_->predict(frame) : std::nullopt;
  if (predicted) {
    start.clock = predicted->clock;
    start.errors = predicted->errors;
  }
  const double chip = start.clock.rows_per_chip;
  const bool sure = predicted && predicted->errors.phase_std(0) < kSurePrediction * chip;
  const bool exposure_known = camera_.exposure.has_value();
  std::optional<RefinedChannel> best;
  for (std::size_t phase = 0; phase < (sure ? 1 : kPhases); ++phase) {
    ChannelEstimate tried = start;
    tried.clock.phase += static_cast<double>(phase) / kPhases * chip;
    auto settled = settle(signal, tried, exposure_known);
    if (settled && (!best || settled->channel.noise < best->channel.noise)) best = std::move(settled);
  }
  if (!best) return std::nullopt;
  const double before = channel_->noise / middle_swing(*channel_, signal.size());
  const auto noise_of = [&](const RefinedChannel& found) {
    return found.channel.noise / std::max(middle_swing(found.channel, signal.size()), 1e-300) / before;
  };
  if (noise_of(*best) < kAsNoisy && is_sound(signal, *best)) return best;
  auto found = refine_channel(signal, best->channel, detect, {.exposure_known = exposure_known});
  if (found && noise_of(*found) < kMostNoisier && is_sound(signal, *found)) return found;
  return std::nullopt;
}

// From a preamble, else from the rate alone.
std::optional<RefinedChannel> Receiver::search(std::span<const double> signal, double rows_per_chip) const {
  std::optional<double> exposure;
  if (camera_.exposure) exposure = *camera_.exposure / camera_.row_time;
  if (exposure && *exposure > kLongestDetectedExposure * (1 - kWideTolerance) * rows_per_chip) return std::nullopt;
  const double tolerance = channel_ ? kNarrowTolerance : kWideTolerance;
  const RefineOptions options{.exposure_known = exposure.has_value()};
  const double seen = static_cast<double>(preamble_.size()) - (exposure ? *exposure / rows_per_chip : 0.0);
  if (seen >= kFewestChipsSeen) {
    const double longest = std::min(14.0, static_cast<double>(preamble_.size()) - kFewestChipsSeen);
    const auto matches = find_preamble(signal, preamble_,
                                       {.rows_per_chip = rows_per_chip,
                                        .tolerance = tolerance,
                                        .exposure = exposure,
                                        .longest_exposure = longest,
                                        .most = kPreamblesTried});
    for (const auto& match : matches) {
      auto found = refine_channel(signal, match.channel, detect, options);
      if (found && is_sound(signal, *found)) return found;
    }
  }
  auto found = find_channel(signal, {.rows_per_chip = rows_per_chip, .tolerance = tolerance, .exposure = exposure},
                            detect, options);
  if (found && is_sound(signal, *found)) return found;
  return std::nullopt;
}

std::optional<RefinedChannel> Receiver::find(std::span<const double> signal, std::int64_t frame, double rows_per_chip) {
  if (auto found = follow(signal, frame)) return found;
  return search(signal, rows_per_chip);
}

// Number of the chip that begins at the found clock's phase, on the light's own clock.
std::ptrdiff_t Receiver::chip_number(const RefinedChannel& found, std::int64_t frame) {
  const ChipClock& clock = found.channel.clock;
  if (!tracker_) {
    assembler_.lose_clock();
    return 0;
  }
  if (!tracker_->update(frame, clock, found.channel.errors)) assembler_.lose_clock();
  const auto tracked = tracker_->predict(frame);
  const double chips = (clock.phase - tracked->clock.phase) / clock.rows_per_chip;
  return static_cast<std::ptrdiff_t>(tracked->chip) + static_cast<std::ptrdiff_t>(std::llround(chips));
}

// Chips of the whole frame, and what the packet takes of them.
void Receiver::read(std::span<const double> signal, const RefinedChannel& found, ReceivedFrame& result) {
  const ChannelEstimate& channel = found.channel;
  const double swing = middle_swing(channel, signal.size());
  const Question question(signal, channel);
  const auto llr = detect_sequence(question.asked).log_likelihood_ratios;
  result.stretch = assembler_.push(chip_number(found, result.frame) + question.asked.first, llr);

  const ChipLattice lattice{channel.clock.rows_per_chip, channel.errors.rows_per_chip_std(), channel.clock.phase, 0};
  const ChipGrid whole = whole_chips(lattice, signal.size());
  for (std::size_t k = 0; k < whole.count; ++k) {
    const std::ptrdiff_t at = whole.first + static_cast<std::ptrdiff_t>(k) - question.asked.first;
    if (at < 0 || at >= static_cast<std::ptrdiff_t>(llr.size())) continue;
    if (result.bits.empty()) result.phase = whole.start(k);
    result.llr.push_back(llr[static_cast<std::size_t>(at)]);
    result.bits += result.llr.back() > 0 ? '1' : '0';
  }
  result.rows_per_chip = channel.clock.rows_per_chip;
  result.rows_per_chip_std = channel.errors.rows_per_chip_std();
  result.exposure = channel.clock.exposure;
  result.exposure_std = channel.errors.exposure_std();
  result.snr = std::min(std::pow(0.5 * swing / std::max(channel.noise, 1e-300), 2), 1e12);
  result.error_rate = error_rate(result.llr);
  if (result.snr < kWeakSnr) result.flags |= flag::weak;
}

ReceivedFrame Receiver::push(std::span<const AnyFramesView> channels, std::optional<std::int64_t> frame) {
  require(!channels.empty(), "frame", "no channels", "at least one channel");
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  ReceivedFrame result;
  result.frame = frame.value_or(last_ ? *last_ + 1 : 0);
  for (double* value : {&result.phase, &result.rows_per_chip, &result.rows_per_chip_std, &result.exposure,
                        &result.exposure_std, &result.snr, &result.error_rate})
    *value = nan;
  const auto leave = [&](FrameOutcome outcome) {
    result.outcome = outcome;
    return result;
  };
  const Shape shape = shape_of(channels.front());
  require(shape.frames == 1 && shape.rows > 0 && shape.columns > 0, "frame",
          std::to_string(shape.frames) + " frames of " + std::to_string(shape.rows) + " rows and " +
              std::to_string(shape.columns) + " columns",
          "one frame that is not empty");
  for (const auto& channel : channels) {
    const Shape other = shape_of(channel);
    require(other.frames == 1 && other.rows == shape.rows && other.columns == shape.columns, "frame",
            "channels of different shapes", "one shape");
  }
  if (last_ && result.frame <= *last_) return leave(FrameOutcome::repeated);
  const std::array<std::size_t, 3> lengths{channels.size(), shape.rows, shape.columns};
  if (last_ && lengths != shape_) return leave(FrameOutcome::other_shape);
  shape_ = lengths;
  last_ = result.frame;

  if (!are_numbers(channels)) return leave(FrameOutcome::not_finite);
  const auto [column, channel] = best_column(channels, camera_.tone_curve);
  result.channel = channel;
  if (column.saturated) result.flags |= flag::saturated;
  const auto rows_per_chip = nominal_rows_per_chip(channels);
  std::optional<RefinedChannel> found;
  if (rows_per_chip && static_cast<double>(shape.rows) >= kFewestChips * *rows_per_chip)
    found = find(column.signal, result.frame, *rows_per_chip);
  if (!found) {
    result.flags |= flag::no_signal;
    return leave(FrameOutcome::no_signal);
  }
  read(column.signal, *found, result);
  channel_ = found->channel;
  rows_per_chip_ = found->channel.clock.rows_per_chip;
  return result;
}

}  // namespace ocisac
