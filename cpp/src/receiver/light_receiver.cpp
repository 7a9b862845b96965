#include "ocisac/receiver/light_receiver.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/chips/slicer.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/tones/find_frequency.hpp"
#include "receiver/colour_streams.hpp"

namespace ocisac {

namespace {

double first_of(const std::vector<double>& values) { return values.empty() ? kNaN : values.front(); }

// Offset in columns from the centre of the region to the centroid of the weights.
double offset_of(std::span<const double> weights) {
  const double least = kSmallShare * *std::ranges::max_element(weights);
  double sum = 0, moment = 0;
  for (std::size_t column = 0; column < weights.size(); ++column) {
    if (!(weights[column] >= least)) continue;
    sum += weights[column];
    moment += weights[column] * static_cast<double>(column);
  }
  return sum > 0 ? moment / sum - 0.5 * static_cast<double>(weights.size() - 1) : 0.0;
}

bool are_alike(const ColourStream& a, const ColourStream& b) {
  const double lengths = std::sqrt(scalar_product(a.weights, a.weights) * scalar_product(b.weights, b.weights));
  return scalar_product(a.weights, b.weights) > kNearlyAll * lengths;
}

// Agreement of a stream's chips with bits, −1 to 1.
double agreement(const std::vector<std::vector<double>>& values, const ColourStream& stream, std::string_view bits) {
  std::vector<double> chips(bits.size());
  for (std::size_t c = 0; c < values.size(); ++c)
    for (std::size_t k = 0; k < chips.size(); ++k) chips[k] += stream.weights[c] * values[c][k];
  const double mean = mean_of(chips);
  double same = 0, whole = 0;
  for (std::size_t k = 0; k < chips.size(); ++k) {
    same += (bits[k] == '1' ? 1 : -1) * (chips[k] - mean);
    whole += std::abs(chips[k] - mean);
  }
  return whole > 0 ? same / whole : 0.0;
}

bool has_tone(const LightGain& gain) {
  return std::isfinite(gain.gain) && !(gain.flags & (flag::weak | flag::no_tone | flag::no_light));
}

}  // namespace

LightReceiver::LightReceiver(const Camera& camera, const LightOptions& options, std::size_t source)
    : camera_(camera), options_(options), source_(source) {
  check(camera);
  if (options_.data) chips_.emplace(camera_, *options_.data);
  if (options_.sense_frequency) require_positive("sense_frequency", *options_.sense_frequency);
  if (!options_.gain) return;
  if (options_.gain->frequency) require_positive("frequency", *options_.gain->frequency);
  require_finite("background", options_.gain->background);
  require(options_.gain->duty > 0 && options_.gain->duty < 1, "duty", options_.gain->duty, "inside (0, 1)");
  tone_.frequency = options_.gain->frequency.value_or(kNaN);
}

void LightReceiver::place(const Region& region, bool can_move) {
  const bool same_rows = region.y == region_.y && region.height == region_.height;
  if (chips_ && region_.height > 0 && !same_rows) chips_->forget();
  region_ = region;
  can_move_ = can_move;
  forget_columns();
}

void LightReceiver::forget() {
  if (chips_) chips_->forget();
  forget_columns();
  unseen_ = 0;
}

// Resets what belongs to the region.
void LightReceiver::forget_columns() {
  for (auto& follower : followers_) follower.forget();
  forget_streams();
  tone_known_ = options_.gain && options_.gain->frequency;
}

// Moves the region by half of the light's offset from its centre.
void LightReceiver::follow(const CombinedColumn& column, std::size_t columns) {
  const auto min_step = -static_cast<std::ptrdiff_t>(region_.x);
  const auto max_step = static_cast<std::ptrdiff_t>(columns - region_.x - region_.width);
  const auto step = std::clamp(static_cast<std::ptrdiff_t>(0.5 * offset_of(column.weights)), min_step, max_step);
  if (step == 0) return;
  region_.x = static_cast<std::size_t>(static_cast<std::ptrdiff_t>(region_.x) + step);
  for (auto& follower : followers_) follower.move(step);
}

LightColumns LightReceiver::combine(std::span<const AnyFramesView> colours, RowRange free) {
  LightColumns seen;
  if (!chips_) return seen;
  seen.held = chips_->compares_rows(can_move_);
  seen.rows = can_move_ ? free : RowRange{region_.y, region_.y + region_.height};
  seen.region = {region_.y - seen.rows.begin, region_.y - seen.rows.begin + region_.height};
  while (followers_.size() < colours.size()) followers_.emplace_back(camera_.tone_curve);
  const Region read{region_.x, seen.rows.begin, region_.width, seen.rows.size()};
  for (std::size_t k = 0; k < colours.size(); ++k)
    seen.of_colour.push_back(followers_[k].combine(part_of(colours[k], read), seen.held));
  const auto strongest = std::ranges::max_element(seen.of_colour, std::ranges::less{}, &CombinedColumn::quality);
  const bool is_known = stream_.weights.size() == colours.size();
  seen.colour = is_known ? stream_.colour : static_cast<std::size_t>(strongest - seen.of_colour.begin());
  seen.best = is_known ? sum_of(seen.of_colour, stream_) : seen.of_colour[seen.colour];
  return seen;
}

void LightReceiver::forget_streams() {
  if (is_other_stream_) return;
  stream_ = {};
  proposed_.clear();
  agreed_ = 0;
}

void LightReceiver::receive_stream(ColourStream stream) {
  stream_ = std::move(stream);
  is_other_stream_ = true;
}

// Streams that consecutive frames agree on are those of the lamp.
void LightReceiver::learn_streams(const std::vector<CombinedColumn>& columns, const ReceivedFrame& received,
                                  std::size_t first_row) {
  const double exposure_rows = received.exposure / camera_.row_time;
  const bool is_short = exposure_rows <= kLongestSliced * received.rows_per_chip;
  if (received.outcome != FrameOutcome::received || received.bits.size() < kMinChipsOfStreams || !is_short) return;
  const ChipGrid grid{
      {received.rows_per_chip, received.phase - static_cast<double>(first_row)}, 0, received.bits.size()};
  std::vector<std::vector<double>> values;
  for (const CombinedColumn& column : columns) values.push_back(chip_values(column.signal, grid, exposure_rows));
  auto streams = colour_streams(values);
  std::ranges::sort(streams, std::ranges::greater{},
                    [&](const ColourStream& stream) { return agreement(values, stream, received.bits); });
  const bool agrees = !streams.empty() && std::ranges::equal(streams, proposed_, are_alike);
  agreed_ = agrees ? agreed_ + 1 : 1;
  proposed_ = std::move(streams);
  if (agreed_ < kFramesAgreed) return;
  stream_ = proposed_.front();
  other_streams_.assign(proposed_.begin() + 1, proposed_.end());
}

void LightReceiver::find_tone(const AnyFramesView& part) {
  tone_known_ = true;
  FrequencySearch wanted;
  wanted.saturation = saturation_level(part, camera_.tone_curve);
  const FoundFrequency found = find_frequency(part, wanted);
  tone_ = {.flags = found.flags};
  if (found.flags & flag::no_tone) return;
  tone_.frequency = found.frequency / camera_.row_time;
  tone_.frequency_std = found.frequency_std / camera_.row_time;
}

LightGain LightReceiver::measure_gain(const AnyFramesView& part) const {
  LightGain result = tone_;
  if (!std::isfinite(result.frequency)) return result;
  ToneGainOptions wanted;
  wanted.waveform = options_.gain->waveform;
  wanted.duty = options_.gain->duty;
  wanted.background = {&options_.gain->background, 1};
  wanted.pooled = true;
  const ToneGain measured = tone_gain(part, camera_, {&result.frequency, 1}, wanted);
  result.gain = first_of(measured.gain);
  result.gain_std = first_of(measured.gain_std);
  result.phase = first_of(measured.phase);
  result.mean = first_of(measured.mean);
  result.snr = first_of(measured.snr);
  result.flags |= measured.flags.front();
  return result;
}

// The highest tone of chips is half the chip rate.
void LightReceiver::suggest_exposure(const std::optional<ReceivedFrame>& received) {
  double comm = tone_.frequency;
  if (received && std::isfinite(received->rows_per_chip))
    comm = 0.5 / (received->rows_per_chip * camera_.row_time);
  else if (options_.data && options_.data->chip_rate)
    comm = 0.5 * *options_.data->chip_rate;
  if (!std::isfinite(comm) || !(comm > 0) || std::abs(comm - suggested_for_) <= 1e-4 * suggested_for_) return;
  suggested_for_ = comm;
  suggestion_ = options_.sense_frequency ? best_exposure_exact(comm, *options_.sense_frequency)
                                         : best_exposure_exact(comm, comm, 1, 0);
}

LightFrame LightReceiver::finish(std::span<const AnyFramesView> colours, const LightColumns& seen,
                                 std::optional<ReceivedFrame> received, std::int64_t frame) {
  LightFrame result{.frame = frame, .source = source_, .region = region_, .received = std::move(received)};
  if (options_.gain && !tone_known_) find_tone(part_of(colours[seen.colour], region_));
  const bool has_chips = result.received && result.received->outcome == FrameOutcome::received;
  if (result.received) {
    result.received->colour = seen.colour;
    if (stream_.weights.size() != colours.size() && colours.size() > 1)
      learn_streams(seen.of_colour, *result.received, seen.rows.begin);
    if (!has_chips && !seen.held)
      for (auto& follower : followers_) follower.forget();
    else if (can_move_ && !seen.held)
      follow(seen.best, shape_of(colours[seen.colour]).columns);
    result.region = region_;
  }
  if (options_.gain) result.gain = measure_gain(part_of(colours[seen.colour], region_));
  suggest_exposure(result.received);
  result.suggestion = suggestion_;
  // A tone in the whole picture, without a detected light, has no position.
  const bool tone = can_move_ && result.gain && has_tone(*result.gain);
  unseen_ = has_chips || tone ? 0 : unseen_ + 1;
  if (is_lost()) forget_streams();
  return result;
}

}  // namespace ocisac
