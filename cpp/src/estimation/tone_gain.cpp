#include "ocisac/estimation/tone_gain.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <string>

#include "estimation/streaming_fit.hpp"
#include "ocisac/camera/exposure_response.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/estimation/harmonic_model.hpp"
#include "ocisac/estimation/spectrum.hpp"
#include "ocisac/parallel.hpp"
#include "ocisac/require.hpp"

namespace ocisac {

namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kNearNull = 0.05;  // |sinc| below which a gain is called near a null
constexpr double kWeak = 3;         // standard errors
constexpr double kOffBin = 0.01;    // bins
constexpr double kRounding = 1e-9;  // contrast below which a steady column differs from 0 by rounding alone
constexpr std::size_t kColumnsPerStream = 2048;  // as wide as a frame: memory is read best along rows
constexpr std::size_t kColumnsPerBlock = 64;     // a fixed size, so that results do not depend on the threads

// What a column says of one tone, on the way to the gain: y ≈ mean + cosine·cos(2πνu) + sine·sin(2πνu).
struct Estimate {
  double mean, cosine, sine;
  double noise_variance;                                                         // of one row
  double variance_mean, variance_cosine, variance_sine, covariance_mean_cosine;  // for noise of variance 1
};

struct Tone {
  double frequency;
  double cycles_per_row;
  Flags flags;           // those that hold for every column
  double phase_at_zero;  // phase of the light at row 0 for a column whose fitted phase is 0, rad
};

struct Context {
  std::vector<Tone> tones;
  double ratio;  // full_depth_ratio
  const Camera* camera;
  const ToneGainOptions* options;
  Shape shape;
  bool whole_numbers;  // samples are light in steps of 1
};

// Half an exposure of delay, and half a turn where sinc is negative (angle of H).
double exposure_phase(const Camera& camera, double frequency) {
  if (!camera.exposure) return 0;
  const double cycles = frequency * *camera.exposure;
  return -std::numbers::pi * std::fmod(cycles, 2.0) + (sinc(cycles) < 0 ? std::numbers::pi : 0.0);
}

double wrapped(double phase) {
  const double turn = 2 * std::numbers::pi;
  const double rest = phase - turn * std::nearbyint(phase / turn);
  return rest <= -std::numbers::pi ? rest + turn : rest;
}

Flags exposure_flags(const Camera& camera, double frequency) {
  if (!camera.exposure) return 0;
  return std::abs(sinc(frequency * *camera.exposure)) < kNearNull ? flag::near_null : 0;
}

// With less noise than half a step, rounding is a function of the light instead of noise. It pulls an amplitude by up
// to this, in steps: RMS over where the light lies between two codes, from Widrow's series, with <J1²(x)> = 1/(πx).
double rounding_pull(double amplitude, double noise_variance) {
  constexpr double scale = 0.1111;                                  // √(ζ(3)/π⁴)
  const bool on_two_codes = amplitude < 1 && noise_variance < 0.3;  // their changes look like noise
  const double noise = on_two_codes ? 0 : std::max(noise_variance - 1.0 / 12, 0.0);
  return scale / std::sqrt(std::max(amplitude, 0.1)) * std::exp(-2 * std::numbers::pi * std::numbers::pi * noise);
}

double background_of(const Context& context, std::size_t frame, std::size_t column) {
  const auto& background = context.options->background;
  if (background.empty()) return 0;
  return background.size() == 1 ? background[0] : background[frame * context.shape.columns + column];
}

// Gain, its error and the rest from the estimate; the ratio's error by its first derivatives.
void write_result(const Context& context, const Tone& tone, const Estimate& estimate, double background, Flags flags,
                  std::size_t index, ToneGain& result) {
  const double mean = estimate.mean - background;
  if (!(mean > 0)) flags |= flag::no_light;
  result.mean[index] = mean;
  if (flags & (flag::unresolvable | flag::no_light)) {
    for (auto* values : {&result.gain, &result.gain_std, &result.phase, &result.snr}) (*values)[index] = kNaN;
    result.flags[index] = flags;
    return;
  }
  const double power = estimate.cosine * estimate.cosine + estimate.sine * estimate.sine;
  const double share_cosine = power > 0 ? estimate.cosine * estimate.cosine / power : 0.5;
  const double share_sine = 1 - share_cosine;
  const double noise = estimate.noise_variance;
  const double radial = noise * (share_cosine * estimate.variance_cosine + share_sine * estimate.variance_sine);
  const double tangential = noise * (share_sine * estimate.variance_cosine + share_cosine * estimate.variance_sine);
  // Noise across the phasor lengthens it: E|z|² = A² + radial + tangential, and E|z| − A = tangential/(2A).
  const double amplitude = std::sqrt(std::max(power - tangential, 0.0));
  const double rounding = kRounding * mean;
  if (power < kWeak * kWeak * radial || power <= rounding * rounding)
    flags |= flag::weak;
  else if (context.whole_numbers && rounding_pull(amplitude, noise) > std::sqrt(radial))
    flags |= flag::quantised;
  const double contrast = amplitude / mean;
  const double covariance =
      noise * estimate.covariance_mean_cosine * std::copysign(std::sqrt(share_cosine), estimate.cosine);
  const double variance = radial - 2 * contrast * covariance + contrast * contrast * noise * estimate.variance_mean;
  result.gain[index] = contrast / context.ratio;
  result.gain_std[index] = std::sqrt(std::max(variance, 0.0)) / (mean * context.ratio);
  result.phase[index] = wrapped(tone.phase_at_zero + std::atan2(-estimate.sine, estimate.cosine));
  const double tone_level = amplitude / context.ratio;  // G·C
  result.snr[index] = tone_level * tone_level / noise;
  result.flags[index] = flags;
}

// Columns with samples at the top of the scale.
template <class T>
bool is_saturated(const FramesView<const T>& view, std::size_t frame, std::size_t column, double level) {
  for (std::size_t row = 0; row < view.rows; ++row)
    if (static_cast<double>(view(frame, row, column)) >= level) return true;
  return false;
}

double saturation_level(const AnyFramesView& frames, const ToneCurve& curve) {
  return curve.white_level != 0 ? curve.white_level : ocisac::saturation_level(frames);
}

// One method's estimates for a block of signals (count × rows): (tones × count).
class Estimator {
 public:
  virtual ~Estimator() = default;
  [[nodiscard]] virtual std::vector<Estimate> estimate(const std::vector<double>& signals) const = 0;
};

class FitEstimator final : public Estimator {
 public:
  explicit FitEstimator(HarmonicModel model) : model_(std::move(model)) {}

  [[nodiscard]] std::vector<Estimate> estimate(const std::vector<double>& signals) const override {
    const auto rows = static_cast<Eigen::Index>(model_.rows);
    const Eigen::Index count = static_cast<Eigen::Index>(signals.size()) / rows;
    const Eigen::Map<const RowMajor> y(signals.data(), count, rows);
    const Eigen::Map<const RowMajor> weights(model_.weights.data(), static_cast<Eigen::Index>(model_.estimates), rows);
    const Eigen::Map<const RowMajor> basis(model_.basis.data(), static_cast<Eigen::Index>(model_.parameters), rows);
    const RowMajor values = y * weights.transpose();
    const RowMajor residual = y - (y * basis.transpose()) * basis;
    const auto freedom = static_cast<double>(model_.rows - std::min(model_.rows, model_.parameters));
    const auto tones = static_cast<Eigen::Index>(model_.tone_flags.size());
    std::vector<Estimate> estimates;
    for (Eigen::Index k = 0; k < tones; ++k)
      for (Eigen::Index column = 0; column < count; ++column) {
        const double noise = freedom > 0 ? residual.row(column).squaredNorm() / freedom : kNaN;
        const Eigen::Index a = 2 * k + 1;
        estimates.push_back({values(column, 0), values(column, a), values(column, a + 1), noise, covariance(0, 0),
                             covariance(a, a), covariance(a + 1, a + 1), covariance(0, a)});
      }
    return estimates;
  }

 private:
  [[nodiscard]] double covariance(Eigen::Index i, Eigen::Index j) const {
    return model_.covariance[static_cast<std::size_t>(i) * model_.estimates + static_cast<std::size_t>(j)];
  }
  HarmonicModel model_;
};

// The bin of eq. 25, folded into [0, rows/2].
struct Bin {
  std::size_t index;
  bool conjugate;  // seen through its alias
};

Bin nearest_bin(double cycles_per_row, std::size_t rows) {
  const auto length = static_cast<double>(rows);
  const double bin = std::fmod(std::nearbyint(cycles_per_row * length), length);
  const bool conjugate = 2 * bin > length;
  return {static_cast<std::size_t>(conjugate ? length - bin : bin), conjugate};
}

class DftEstimator final : public Estimator {
 public:
  DftEstimator(std::size_t rows, std::vector<Bin> bins) : rows_(rows), bins_(std::move(bins)) {}

  // Steps 1–4 of the paper; the noise is all that is neither in the mean nor in the bin.
  [[nodiscard]] std::vector<Estimate> estimate(const std::vector<double>& signals) const override {
    const std::size_t count = signals.size() / rows_;
    const std::size_t width = rows_ / 2 + 1;
    const auto length = static_cast<double>(rows_);
    const auto spectra = half_spectra(signals, rows_);
    std::vector<Estimate> estimates;
    for (const Bin bin : bins_)
      for (std::size_t column = 0; column < count; ++column) {
        const auto mean = spectra[column * width].real() / length;
        auto line = 2.0 / length * spectra[column * width + bin.index];
        if (bin.conjugate) line = std::conj(line);
        double squares = 0;
        for (const double v : std::span(signals).subspan(column * rows_, rows_)) squares += (v - mean) * (v - mean);
        const double rest = std::max(squares - std::norm(line) * length / 2, 0.0);
        const double noise = rows_ > 3 ? rest / (length - 3) : kNaN;
        estimates.push_back({mean, line.real(), -line.imag(), noise, 1 / length, 2 / length, 2 / length, 0});
      }
    return estimates;
  }

 private:
  std::size_t rows_;
  std::vector<Bin> bins_;
};

// Row 0 lies `middle` rows before the point that a fit counts its phase from.
void count_phase_from(Tone& tone, double middle, Flags flags) {
  const Phasor turn = phasor(tone.cycles_per_row, -middle);
  tone.phase_at_zero += std::atan2(turn.sine, turn.cosine);
  tone.flags |= flags;
}

std::unique_ptr<Estimator> fit_estimator(Context& context) {
  const auto& options = *context.options;
  std::vector<ModelTone> model_tones;
  for (const Tone& tone : context.tones) {
    const bool square = options.waveform == WaveformShape::square;
    model_tones.push_back(
        {tone.cycles_per_row, square ? square_wave_harmonics(tone.cycles_per_row, options.duty) : std::vector<int>{1}});
  }
  auto model = harmonic_model(context.shape.rows, model_tones);
  const double middle = (static_cast<double>(context.shape.rows) - 1) / 2;
  for (std::size_t k = 0; k < context.tones.size(); ++k)
    count_phase_from(context.tones[k], middle, model.tone_flags[k]);
  return std::make_unique<FitEstimator>(std::move(model));
}

std::unique_ptr<Estimator> dft_estimator(Context& context) {
  const auto rows = static_cast<double>(context.shape.rows);
  std::vector<Bin> bins;
  for (Tone& tone : context.tones) {
    const double position = tone.cycles_per_row * rows;
    const Bin bin = nearest_bin(tone.cycles_per_row, context.shape.rows);
    if (position < 1) tone.flags |= flag::few_cycles;
    if (tone.cycles_per_row > 0.5) tone.flags |= flag::aliased;
    if (std::abs(position - std::nearbyint(position)) > kOffBin) tone.flags |= flag::off_bin;
    if (bin.index == 0 || 2 * bin.index == context.shape.rows || context.shape.rows < 4)
      tone.flags |= flag::unresolvable;
    bins.push_back(bin);
  }
  return std::make_unique<DftEstimator>(context.shape.rows, std::move(bins));
}

void check_options(const ToneGainOptions& options, const Shape& shape) {
  require(options.duty > 0 && options.duty < 1, "duty", options.duty, "inside (0, 1)");
  require(options.efficiency > 0 && options.efficiency <= 1, "efficiency", options.efficiency, "inside (0, 1]");
  const std::size_t size = options.background.size();
  require(size <= 1 || size == shape.frames * shape.columns, "background", std::to_string(size) + " values",
          "one value, or one for each column of each frame");
  for (const double value : options.background) require_finite("background", value);
}

Context make_context(const AnyFramesView& frames, const Camera& camera, std::span<const double> frequencies,
                     const ToneGainOptions& options) {
  check(camera);
  check(frames);
  const bool integers = std::holds_alternative<FramesView<const std::uint8_t>>(frames) ||
                        std::holds_alternative<FramesView<const std::uint16_t>>(frames);
  Context context{{},
                  full_depth_ratio(options.waveform, options.duty),
                  &camera,
                  &options,
                  shape_of(frames),
                  integers && camera.tone_curve.kind == ToneCurve::Kind::linear};
  check_options(options, context.shape);
  require(!frequencies.empty(), "frequency", "no values", "at least one frequency");
  for (const double frequency : frequencies) {
    require_positive("frequency", frequency);
    const double cycles = frequency * camera.row_time;
    require(cycles > 0 && cycles * static_cast<double>(context.shape.rows) < 0x1p52, "frequency", frequency,
            "a frequency whose cycles in the frame can be counted");
    context.tones.push_back({frequency, cycles, exposure_flags(camera, frequency), -exposure_phase(camera, frequency)});
  }
  return context;
}

ToneGain empty_result(std::size_t tones, std::size_t frames, std::size_t columns) {
  const std::size_t size = tones * frames * columns;
  const std::vector<double> values(size);
  return {tones, frames, columns, values, values, values, values, values, std::vector<Flags>(size)};
}

// Whether the pass over the pixels themselves may replace that over signals of linear light in float64.
bool may_stream(const Context& context) {
  const auto& options = *context.options;
  return options.efficiency < 1 && options.method == GainMethod::fit && options.waveform == WaveformShape::tone &&
         context.camera->tone_curve.kind == ToneCurve::Kind::linear;
}

StreamingFit streaming_fit(Context& context) {
  std::vector<double> cycles;
  for (const Tone& tone : context.tones) cycles.push_back(tone.cycles_per_row);
  StreamingFit fit(context.shape.rows, cycles, context.options->efficiency);
  for (std::size_t k = 0; k < context.tones.size(); ++k) count_phase_from(context.tones[k], fit.middle(), fit.flags(k));
  return fit;
}

void stream_gains(const AnyFramesView& frames, Context& context, ToneGain& result) {
  const StreamingFit fit = streaming_fit(context);
  const auto [frame_count, rows, columns] = context.shape;
  const double level = saturation_level(frames, context.camera->tone_curve);
  const std::size_t blocks = (columns + kColumnsPerStream - 1) / kColumnsPerStream;
  for_each_block(frame_count * blocks, context.options->threads, [&](std::size_t block) {
    const std::size_t frame = block / blocks;
    const std::size_t first = block % blocks * kColumnsPerStream;
    const std::size_t count = std::min(kColumnsPerStream, context.shape.columns - first);
    const auto estimates = fit.estimate(frames, frame, first, count);
    for (std::size_t k = 0; k < context.tones.size(); ++k)
      for (std::size_t i = 0; i < count; ++i) {
        const std::size_t a = 2 * k + 1;
        const Estimate estimate{estimates.parameters[i] - context.camera->tone_curve.dark_level,
                                estimates.parameters[a * count + i],
                                estimates.parameters[(a + 1) * count + i],
                                estimates.noise_variance[i],
                                fit.covariance(0, 0),
                                fit.covariance(a, a),
                                fit.covariance(a + 1, a + 1),
                                fit.covariance(0, a)};
        const Flags flags = context.tones[k].flags | (estimates.maximum[i] >= level ? flag::saturated : 0);
        const std::size_t index = (k * context.shape.frames + frame) * context.shape.columns + first + i;
        write_result(context, context.tones[k], estimate, background_of(context, frame, first + i), flags, index,
                     result);
      }
  });
}

std::unique_ptr<Estimator> make_estimator(Context& context) {
  return context.options->method == GainMethod::fit ? fit_estimator(context) : dft_estimator(context);
}

// All columns of a frame as one.
struct PooledColumn {
  std::vector<double> signal;  // (rows,), linear light
  double background = 0;
  bool saturated = false;
};

// Calls visit(column, signal) for every column of a frame.
template <class Visit>
void for_each_column(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve, Visit visit) {
  const auto [frame_count, rows, columns] = shape_of(frames);
  for (std::size_t first = 0; first < columns; first += kColumnsPerBlock) {
    const std::size_t count = std::min(kColumnsPerBlock, columns - first);
    const auto signals = column_signals(frames, frame, first, count, curve);
    for (std::size_t i = 0; i < count; ++i) visit(first + i, std::span(signals).subspan(i * rows, rows));
  }
}

// With equal noise in all columns, brightness is the weight that maximises the signal-to-noise ratio.
std::vector<double> brightness_weights(const AnyFramesView& frames, const Context& context, std::size_t frame) {
  std::vector<double> weights(context.shape.columns);
  for_each_column(frames, frame, context.camera->tone_curve, [&](std::size_t column, std::span<const double> signal) {
    double sum = 0;
    for (const double v : signal) sum += v;
    const double mean = sum / static_cast<double>(signal.size());
    weights[column] = std::max(mean - background_of(context, frame, column), 0.0);
  });
  if (std::ranges::all_of(weights, [](double w) { return w == 0; })) std::ranges::fill(weights, 1.0);
  return weights;
}

PooledColumn pool_columns(const AnyFramesView& frames, const Context& context, std::size_t frame) {
  auto weights = brightness_weights(frames, context, frame);
  const double level = saturation_level(frames, context.camera->tone_curve);
  PooledColumn pooled;
  std::vector<double> unsaturated = weights;
  for (std::size_t column = 0; column < weights.size(); ++column)
    std::visit(
        [&](const auto& view) {
          if (is_saturated(view, frame, column, level)) unsaturated[column] = 0;
        },
        frames);
  pooled.saturated = std::ranges::all_of(unsaturated, [](double w) { return w == 0; });
  if (!pooled.saturated) weights = std::move(unsaturated);

  double total = 0;
  for (const double w : weights) total += w;
  pooled.signal.assign(context.shape.rows, 0.0);
  for_each_column(frames, frame, context.camera->tone_curve, [&](std::size_t column, std::span<const double> signal) {
    const double share = weights[column] / total;
    if (share == 0) return;
    for (std::size_t row = 0; row < signal.size(); ++row) pooled.signal[row] += share * signal[row];
    pooled.background += share * background_of(context, frame, column);
  });
  return pooled;
}

}  // namespace

double full_depth_ratio(WaveformShape waveform, double duty) {
  return waveform == WaveformShape::tone ? 1.0 : 2 * sinc(duty);
}

ToneGain tone_gain(const AnyFramesView& frames, const Camera& camera, std::span<const double> frequencies,
                   const ToneGainOptions& options) {
  Context context = make_context(frames, camera, frequencies, options);
  const auto [frame_count, rows, columns] = context.shape;
  ToneGain result = empty_result(frequencies.size(), frame_count, columns);
  if (may_stream(context)) {
    stream_gains(frames, context, result);
    return result;
  }
  const auto estimator = make_estimator(context);
  const double level = saturation_level(frames, camera.tone_curve);
  const std::size_t blocks = (columns + kColumnsPerBlock - 1) / kColumnsPerBlock;
  for_each_block(frame_count * blocks, options.threads, [&](std::size_t block) {
    const std::size_t frame = block / blocks;
    const std::size_t first = block % blocks * kColumnsPerBlock;
    const std::size_t count = std::min(kColumnsPerBlock, context.shape.columns - first);
    const auto estimates = estimator->estimate(column_signals(frames, frame, first, count, camera.tone_curve));
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t column = first + i;
      const bool saturated =
          std::visit([&](const auto& view) { return is_saturated(view, frame, column, level); }, frames);
      for (std::size_t k = 0; k < context.tones.size(); ++k) {
        const Flags flags = context.tones[k].flags | (saturated ? flag::saturated : 0);
        const std::size_t index = (k * context.shape.frames + frame) * context.shape.columns + column;
        write_result(context, context.tones[k], estimates[k * count + i], background_of(context, frame, column), flags,
                     index, result);
      }
    }
  });
  return result;
}

ToneGain pooled_tone_gain(const AnyFramesView& frames, const Camera& camera, std::span<const double> frequencies,
                          const ToneGainOptions& options) {
  Context context = make_context(frames, camera, frequencies, options);
  context.whole_numbers = false;  // a mean of columns is not
  const auto estimator = make_estimator(context);
  ToneGain result = empty_result(frequencies.size(), context.shape.frames, 1);
  for_each_block(context.shape.frames, options.threads, [&](std::size_t frame) {
    const PooledColumn pooled = pool_columns(frames, context, frame);
    const auto estimates = estimator->estimate(pooled.signal);
    for (std::size_t k = 0; k < context.tones.size(); ++k) {
      const Flags flags = context.tones[k].flags | (pooled.saturated ? flag::saturated : 0);
      write_result(context, context.tones[k], estimates[k], pooled.background, flags, k * context.shape.frames + frame,
                   result);
    }
  });
  return result;
}

}  // namespace ocisac
