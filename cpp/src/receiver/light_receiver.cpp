#include "ocisac/receiver/light_receiver.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string_view>
#include <utility>

#include "ocisac/camera/linear_light.hpp"
#include "ocisac/chips/slicer.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/tones/find_frequency.hpp"
#include "receiver/colour_streams.hpp"

namespace ocisac {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kMinWeight = 0.1;  // of the largest weight: columns below are outside of the light

constexpr std::size_t kFramesAgreed = 3, kMinChipsOfStreams = 16;
constexpr std::size_t kLost = 8;         // frames without the light, after which its colours may send other streams
constexpr double kShortExposure = 1.05;  // chips; in a longer one no chip shows its own level
constexpr double kSameWeights = 0.9;     // cosine between the weights of two frames

double first_of(const std::vector<double>& values) { return values.empty() ? kNaN : values.front(); }

// Offset in columns from the centre of the region to the centroid of the weights.
double offset_of(std::span<const double> weights) {
  const double least = kMinWeight * *std::ranges::max_element(weights);
  double sum = 0, moment = 0;
  for (std::size_t column = 0; column < weights.size(); ++column) {
    if (!(weights[column] >= least)) continue;
    sum += weights[column];
    moment += weights[column] * static_cast<double>(column);
  }
  return sum > 0 ? moment / sum - 0.5 * static_cast<double>(weights.size() - 1) : 0.0;
}

double scalar_product(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

bool are_alike(const ColourWeights& a, const ColourWeights& b) {
  const double lengths = std::sqrt(scalar_product(a.weights, a.weights) * scalar_product(b.weights, b.weights));
  return scalar_product(a.weights, b.weights) > kSameWeights * lengths;
}

// Agreement of a stream's chips with bits, −1 to 1.
double agreement(const std::vector<std::vector<double>>& values, const ColourStream& stream, std::string_view bits) {
  std::vector<double> chips(bits.size());
  for (std::size_t c = 0; c < values.size(); ++c)
    for (std::size_t k = 0; k < chips.size(); ++k) chips[k] += stream.weights[c] * values[c][k];
  const double mean = std::accumulate(chips.begin(), chips.end(), 0.0) / static_cast<double>(chips.size());
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
    : camera_(camera), options_(options), source_(source), frequency_(kNaN), frequency_std_(kNaN) {
  check(camera);
  if (options_.data) chips_.emplace(camera_, *options_.data);
  if (options_.sense_frequency) require_positive("sense_frequency", *options_.sense_frequency);
  if (!options_.gain) return;
  if (options_.gain->frequency) require_positive("frequency", *options_.gain->frequency);
  require_finite("background", options_.gain->background);
  require(options_.gain->duty > 0 && options_.gain->duty < 1, "duty", options_.gain->duty, "inside (0, 1)");
  frequency_ = options_.gain->frequency.value_or(kNaN);
}

void LightReceiver::place(const Region& region, bool can_move) {
  const bool same_rows = region.y == region_.y && region.height == region_.height;
  if (chips_ && region_.height > 0 && !same_rows) chips_->forget();
  region_ = region;
  can_move_ = can_move;
  for (auto& follower : followers_) follower.forget();
  forget_streams();
  tone_known_ = options_.gain && options_.gain->frequency;
}

void LightReceiver::forget() {
  if (chips_) chips_->forget();
  for (auto& follower : followers_) follower.forget();
  forget_streams();
  tone_known_ = options_.gain && options_.gain->frequency;
  unseen_ = 0;
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

// Returns the received colour.
std::size_t LightReceiver::receive_data(std::span<const AnyFramesView> colours, RowRange free, const FrameStamp& stamp,
                                        LightFrame& result) {
  const bool hold = chips_->compares_rows(can_move_);
  Region read = region_;
  if (can_move_) {
    read.y = free.begin;
    read.height = free.size();
  }
  while (followers_.size() < colours.size()) followers_.emplace_back(camera_.tone_curve);
  std::vector<CombinedColumn> columns;
  for (std::size_t k = 0; k < colours.size(); ++k)
    columns.push_back(followers_[k].combine(part_of(colours[k], read), hold));
  const bool is_known = stream_.weights.size() == colours.size();
  const auto strongest = std::ranges::max_element(columns, std::ranges::less{}, &CombinedColumn::quality);
  const std::size_t colour = is_known ? stream_.colour : static_cast<std::size_t>(strongest - columns.begin());
  const CombinedColumn best = is_known ? sum_of(columns, {stream_.weights, stream_.colour}) : columns[colour];
  result.received =
      chips_->push(best, result.frame, read.y, {region_.y - read.y, region_.y - read.y + region_.height}, stamp);
  result.received->colour = colour;
  if (!is_known && colours.size() > 1) learn_streams(columns, *result.received, read.y);
  if (result.received->outcome != FrameOutcome::received && !hold)
    for (auto& follower : followers_) follower.forget();
  else if (can_move_ && !hold)
    follow(best, shape_of(colours[colour]).columns);
  return colour;
}

void LightReceiver::forget_streams() {
  if (is_other_stream_) return;
  stream_ = {};
  proposed_.clear();
  agreed_ = 0;
}

void LightReceiver::receive_stream(ColourWeights stream) {
  stream_ = std::move(stream);
  is_other_stream_ = true;
}

// Streams that consecutive frames agree on are those of the lamp.
void LightReceiver::learn_streams(const std::vector<CombinedColumn>& columns, const ReceivedFrame& received,
                                  std::size_t first_row) {
  const double exposure_rows = received.exposure / camera_.row_time;
  const bool is_short = exposure_rows <= kShortExposure * received.rows_per_chip;
  if (received.outcome != FrameOutcome::received || received.bits.size() < kMinChipsOfStreams || !is_short) return;
  const ChipGrid grid{
      {received.rows_per_chip, received.phase - static_cast<double>(first_row)}, 0, received.bits.size()};
  std::vector<std::vector<double>> values;
  for (const CombinedColumn& column : columns) values.push_back(chip_values(column.signal, grid, exposure_rows));
  auto streams = colour_streams(values);
  std::ranges::sort(streams, std::ranges::greater{},
                    [&](const ColourStream& stream) { return agreement(values, stream, received.bits); });
  std::vector<ColourWeights> found;
  for (auto& stream : streams) found.push_back({std::move(stream.weights), stream.colour});
  const bool agrees = !found.empty() && std::ranges::equal(found, proposed_, are_alike);
  agreed_ = agrees ? agreed_ + 1 : 1;
  proposed_ = std::move(found);
  if (agreed_ < kFramesAgreed) return;
  stream_ = proposed_.front();
  other_streams_.assign(proposed_.begin() + 1, proposed_.end());
}

void LightReceiver::find_tone(const AnyFramesView& part) {
  tone_known_ = true;
  FrequencySearch wanted;
  wanted.saturation = saturation_level(part, camera_.tone_curve);
  const FoundFrequency found = find_frequency(part, wanted);
  const bool is_tone = (found.flags & flag::no_tone) == 0;
  frequency_ = is_tone ? found.frequency / camera_.row_time : kNaN;
  frequency_std_ = is_tone ? found.frequency_std / camera_.row_time : kNaN;
  frequency_flags_ = found.flags;
}

LightGain LightReceiver::measure_gain(const AnyFramesView& part) const {
  LightGain result{frequency_, frequency_std_, kNaN, kNaN, kNaN, kNaN, kNaN, frequency_flags_};
  if (!std::isfinite(frequency_)) return result;
  ToneGainOptions wanted;
  wanted.waveform = options_.gain->waveform;
  wanted.duty = options_.gain->duty;
  wanted.background = {&options_.gain->background, 1};
  const ToneGain measured = pooled_tone_gain(part, camera_, {&frequency_, 1}, wanted);
  result.gain = first_of(measured.gain);
  result.gain_std = first_of(measured.gain_std);
  result.phase = first_of(measured.phase);
  result.mean = first_of(measured.mean);
  result.snr = first_of(measured.snr);
  result.flags |= measured.flags.front();
  return result;
}

// The highest tone of chips is half the chip rate.
void LightReceiver::suggest_exposure(const LightFrame& result) {
  double comm = frequency_;
  if (result.received && std::isfinite(result.received->rows_per_chip))
    comm = 0.5 / (result.received->rows_per_chip * camera_.row_time);
  else if (options_.data && options_.data->chip_rate)
    comm = 0.5 * *options_.data->chip_rate;
  if (!std::isfinite(comm) || !(comm > 0) || std::abs(comm - suggested_for_) <= 1e-4 * suggested_for_) return;
  suggested_for_ = comm;
  suggestion_ = options_.sense_frequency ? best_exposure_exact(comm, *options_.sense_frequency)
                                         : best_exposure_exact(comm, comm, 1, 0);
}

LightFrame LightReceiver::push(std::span<const AnyFramesView> colours, std::int64_t frame, RowRange free,
                               const FrameStamp& stamp) {
  LightFrame result;
  result.frame = frame;
  result.source = source_;
  const Region before = region_;
  const std::size_t colour = chips_ ? receive_data(colours, free, stamp, result) : 0;
  result.region = region_;
  if (options_.gain) {
    if (!tone_known_) find_tone(part_of(colours[colour], before));
    result.gain = measure_gain(part_of(colours[colour], region_));
  }
  suggest_exposure(result);
  result.suggestion = suggestion_;
  const bool received = result.received && result.received->outcome == FrameOutcome::received;
  // A tone in the whole picture, without a detected light, has no position.
  const bool tone = can_move_ && result.gain && has_tone(*result.gain);
  unseen_ = received || tone ? 0 : unseen_ + 1;
  if (unseen_ >= kLost) forget_streams();
  return result;
}

}  // namespace ocisac
