#include "ocisac/receiver/live_receiver.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/lights/detect_sources.hpp"
#include "ocisac/tones/find_frequency.hpp"

namespace ocisac {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kFirstPatience = 8, kLongestPatience = 256;  // frames
// Over the rows of a frame, for the chips of a light; some 50 find them by a preamble. Many exposures are tried where
// it is not known.
constexpr double kSearchPasses = 2000, kSearchPassesUnknownExposure = 5000;
constexpr std::size_t kSearchedColumns = 640;  // at most so many, evenly spread, are searched for lights
constexpr std::size_t kChunks = 32;            // of the rows
constexpr double kSwingShare = 0.3;            // of a light's swing, that its other rows have too
constexpr std::size_t kMinMargin = 8;          // columns beside a light that are looked at too

// Every `step`-th column.
AnyFramesView thinned(const AnyFramesView& frame, std::size_t step) {
  return std::visit(
      [&](auto view) -> AnyFramesView {
        view.columns = (view.columns + step - 1) / step;
        view.column_stride *= static_cast<std::ptrdiff_t>(step);
        return view;
      },
      frame);
}

// Swing of the columns' mean in each of `kChunks` parts of the rows: standard deviation.
std::vector<double> swing_of_chunks(const AnyFramesView& columns, const ToneCurve& curve) {
  const auto signal = combine_columns(columns, 0, curve, SaturatedColumns::use).signal;
  std::vector<double> swings;
  for (std::size_t chunk = 0; chunk < kChunks; ++chunk) {
    const std::size_t begin = chunk * signal.size() / kChunks, end = (chunk + 1) * signal.size() / kChunks;
    double sum = 0, squares = 0;
    for (std::size_t row = begin; row < end; ++row) sum += signal[row], squares += signal[row] * signal[row];
    const double count = static_cast<double>(std::max<std::size_t>(end - begin, 1));
    swings.push_back(std::sqrt(std::max(squares / count - sum * sum / (count * count), 0.0)));
  }
  return swings;
}

// A light that carries data is not periodic over all of its rows, and the box of a periodic part of it is too low: as
// high as its columns swing.
Region with_all_rows(const AnyFramesView& frame, const Region& box, const ToneCurve& curve) {
  const std::size_t rows = shape_of(frame).rows;
  if (rows < 4 * kChunks) return {box.x, 0, box.width, rows};
  const auto swings = swing_of_chunks(part_of(frame, {box.x, 0, box.width, rows}), curve);
  std::size_t first = box.y * kChunks / rows, last = (box.y + box.height - 1) * kChunks / rows;
  const double enough = kSwingShare * *std::max_element(swings.begin() + static_cast<std::ptrdiff_t>(first),
                                                        swings.begin() + static_cast<std::ptrdiff_t>(last) + 1);
  const auto swings_at = [&](std::size_t chunk) { return chunk < kChunks && swings[chunk] >= enough; };
  // A run of equal chips may fill a chunk.
  while (first > 0 && (swings_at(first - 1) || swings_at(first - 2))) --first;
  while (last + 1 < kChunks && (swings_at(last + 1) || swings_at(last + 2))) ++last;
  const std::size_t top = std::min(box.y, first * rows / kChunks);
  const std::size_t bottom = std::max(box.y + box.height, (last + 1) * rows / kChunks);
  return {box.x, top, box.width, bottom - top};
}

// The strongest light that is no reflection, with a margin beside it and all the rows that it lights.
std::optional<Region> find_light(const AnyFramesView& frame, const Camera& camera) {
  const Shape shape = shape_of(frame);
  const std::size_t step = (shape.columns + kSearchedColumns - 1) / kSearchedColumns;
  for (const LightSource& light : detect_sources(thinned(frame, step), camera)) {
    if (light.reflection_of) continue;
    const std::size_t margin = std::max(kMinMargin, light.width * step / 4);
    const std::size_t first = light.x * step - std::min(light.x * step, margin);
    const std::size_t end = std::min(shape.columns, (light.x + light.width) * step + margin);
    return with_all_rows(frame, {first, light.y, end - first, light.height}, camera.tone_curve);
  }
  return std::nullopt;
}

double first_of(const std::vector<double>& values) { return values.empty() ? kNaN : values.front(); }

}  // namespace

LiveReceiver::LiveReceiver(const Camera& camera, LiveOptions options)
    : camera_(camera),
      options_(std::move(options)),
      follower_(camera.tone_curve),
      frequency_(options_.frequency.value_or(kNaN)),
      frequency_std_(kNaN),
      patience_(kFirstPatience) {
  check(camera);
  if (options_.frequency) require_positive("frequency", *options_.frequency);
  if (options_.sense_frequency) require_positive("sense_frequency", *options_.sense_frequency);
  if (options_.chip_rate) require_positive("chip_rate", *options_.chip_rate);
  require_finite("background", options_.background);
  require(options_.duty > 0 && options_.duty < 1, "duty", options_.duty, "inside (0, 1)");
}

void LiveReceiver::search(const AnyFramesView& frame) {
  const auto light = options_.region ? options_.region : find_light(frame, camera_);
  found_ = light.has_value();
  const Region found = light.value_or(Region{0, 0, shape_of(frame).columns, shape_of(frame).rows});
  const bool same_rows = found.y == region_.y && found.height == region_.height;
  region_ = found;
  follower_.start(part_of(frame, {0, found.y, shape_of(frame).columns, found.height}), found.x, found.width);
  if (options_.data && (!receiver_ || !same_rows)) {
    Camera of_light = camera_;
    of_light.tone_curve = {};  // it is given light
    const double passes = camera_.exposure ? kSearchPasses : kSearchPassesUnknownExposure;
    receiver_.emplace(of_light, ReceiverOptions{options_.chip_rate, options_.format, passes});
  }
  if (options_.gain && !options_.frequency) find_tone(part_of(frame, found));
  result_.searched = true;
}

void LiveReceiver::find_tone(const AnyFramesView& part) {
  FrequencySearch wanted;
  wanted.saturation = saturation_level(part);
  const FoundFrequency found = find_frequency(part, wanted);
  const bool is_tone = (found.flags & flag::no_tone) == 0;
  frequency_ = is_tone ? found.frequency / camera_.row_time : kNaN;
  frequency_std_ = is_tone ? found.frequency_std / camera_.row_time : kNaN;
  frequency_flags_ = found.flags;
}

void LiveReceiver::measure_gain(const AnyFramesView& part) {
  LiveGain& result =
      result_.gain.emplace(LiveGain{frequency_, frequency_std_, kNaN, kNaN, kNaN, kNaN, kNaN, frequency_flags_});
  if (!std::isfinite(frequency_)) return;
  ToneGainOptions wanted;
  wanted.waveform = options_.waveform;
  wanted.duty = options_.duty;
  wanted.background = {&options_.background, 1};
  const ToneGain measured = pooled_tone_gain(part, camera_, {&frequency_, 1}, wanted);
  result.gain = first_of(measured.gain);
  result.gain_std = first_of(measured.gain_std);
  result.phase = first_of(measured.phase);
  result.mean = first_of(measured.mean);
  result.snr = first_of(measured.snr);
  result.flags |= measured.flags.front();
}

void LiveReceiver::read_data(const AnyFramesView& rows) {
  const auto signal = follower_.combine(rows, !options_.region);
  const AnyFramesView column = dense_view(signal.data(), 1, signal.size(), 1);
  ReceivedFrame& received = result_.received.emplace(receiver_->push({&column, 1}, result_.frame, region_.y));
  if (follower_.saturated()) received.flags |= flag::saturated;
  region_.x = follower_.first();
}

// Of chips the fastest tone is half the chip rate.
void LiveReceiver::suggest_exposure() {
  double comm = frequency_;
  if (result_.received && std::isfinite(result_.received->rows_per_chip))
    comm = 0.5 / (result_.received->rows_per_chip * camera_.row_time);
  else if (options_.chip_rate)
    comm = 0.5 * *options_.chip_rate;
  if (!std::isfinite(comm) || !(comm > 0) || std::abs(comm - suggested_for_) <= 1e-4 * suggested_for_) return;
  suggested_for_ = comm;
  result_.suggestion = options_.sense_frequency ? best_exposure_exact(comm, *options_.sense_frequency)
                                                : best_exposure_exact(comm, comm, 1, 0);
}

// Whether there was anything in the frame.
bool LiveReceiver::seen() const {
  constexpr Flags nothing = flag::weak | flag::no_tone | flag::no_light;
  const bool tone = result_.gain && std::isfinite(result_.gain->gain) && !(result_.gain->flags & nothing);
  return tone || (result_.received && result_.received->outcome == FrameOutcome::received);
}

const LiveFrame& LiveReceiver::push(const AnyFramesView& frame, std::int64_t number) {
  const Shape shape = shape_of(frame);
  const std::array<std::size_t, 3> kind{shape.rows, shape.columns, frame.index()};
  require(shape.frames == 1 && shape.rows > 0 && shape.columns > 0 && (region_.width == 0 || kind == kind_), "frame",
          std::to_string(shape.columns) + "x" + std::to_string(shape.rows),
          "one picture as large as the first, of its type");
  kind_ = kind;
  if (options_.region) require_inside("region", *options_.region, shape.columns, shape.rows);
  result_.frame = number;
  result_.searched = false;
  if (region_.width == 0 || unseen_ >= patience_) {
    if (region_.width > 0) patience_ = std::min(2 * patience_, kLongestPatience);
    search(frame);
    unseen_ = 0;
  }
  if (options_.data) read_data(part_of(frame, {0, region_.y, shape.columns, region_.height}));
  result_.region = region_;
  if (options_.gain) measure_gain(part_of(frame, region_));
  suggest_exposure();
  if (found_ && seen()) {
    unseen_ = 0;
    patience_ = kFirstPatience;
  } else {
    ++unseen_;
  }
  return result_;
}

}  // namespace ocisac
