#include "ocisac/tones/tone_gain.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <numeric>
#include <optional>
#include <string>
#include <utility>

#include "columns/dense_rows.hpp"
#include "core/levels.hpp"
#include "core/parallel.hpp"
#include "core/recently_used.hpp"
#include "core/statistics.hpp"
#include "light/waveform_elements.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "rows/fit.hpp"
#include "rows/verdict.hpp"
#include "tones/clipping.hpp"
#include "tones/folded_harmonics.hpp"
#include "tones/gain_kernel.hpp"
#include "tones/harmonic_model.hpp"
#include "tones/rounding.hpp"
#include "tones/streaming_fit.hpp"
#include "tones/surroundings.hpp"

namespace ocisac {

namespace {

struct Tone {
  double frequency;
  double cycles_per_row;
  Flags flags;           // common to every column
  double phase_at_zero;  // phase of the light at row 0 for a column whose fitted phase is 0, rad
};

struct Context {
  std::vector<Tone> tones;
  double ratio;  // full_depth_ratio
  const Camera* camera;
  const ToneGainOptions* options;
  Shape shape;
  StoredSteps steps;
  std::vector<double> others{};  // cycles per row of tones that are fitted too, without a result
  bool stored = true;            // samples as they were stored, which may be clipped
};

double background_of(const Context& context, std::size_t frame, std::size_t column) {
  const auto& background = context.options->background;
  if (background.empty()) return 0;
  return background.size() == 1 ? background[0] : background[frame * context.shape.columns + column];
}

// Index of column 0 in the result's arrays.
std::size_t index_of(const Context& context, std::size_t tone, std::size_t frame) {
  return (tone * context.shape.frames + frame) * context.shape.columns;
}

void mark_unknown(const ToneGainView& result, std::size_t index) {
  for (const auto& values : {result.gain, result.gain_std, result.phase, result.snr}) values[index] = kNaN;
}

// Subtracts the dark level, if it is in there still, and the background.
void take_off(const Context& context, std::size_t frame, std::size_t first, double dark, std::span<double> mean) {
  if (dark == 0 && context.options->background.empty()) return;
  for (std::size_t i = 0; i < mean.size(); ++i) mean[i] = mean[i] - dark - background_of(context, frame, first + i);
}

std::optional<double> exposure_cycles_of(const Context& context, const Tone& tone) {
  const auto& exposure = context.camera->exposure;
  return exposure ? std::optional(tone.frequency * *exposure) : std::nullopt;
}

RoundedTone rounded_tone(const Context& context, const Tone& tone, double gain, double phase) {
  const bool is_square = context.options->waveform == WaveformShape::square;
  return {tone.cycles_per_row,
          phase,
          gain,
          exposure_cycles_of(context, tone),
          is_square ? context.options->duty : 0.0,
          context.ratio,
          context.shape.rows};
}

// Error of value i in the units of rounding_error().
double own_error(const Context& context, const ToneGainView& result, std::size_t i) {
  return result.gain_std[i] * result.mean[i] * context.ratio;
}

// Writes gain, standard error, phase, mean, snr and flags of one tone for the columns from `first` of the result on;
// the estimates' mean is the source's own. `tops`: largest sample of each column, `level`: from which it is saturated.
void write_result(const Context& context, const Tone& tone, kernels::FittedTone estimates, std::span<const double> tops,
                  double level, std::size_t first, const ToneGainView& result) {
  const std::size_t count = estimates.count;
  estimates.full_depth_ratio = context.ratio;
  estimates.phase_at_zero = tone.phase_at_zero;
  thread_local std::vector<double> remarks;  // reused from call to call, as sums and columns of stream_gains
  remarks.resize(count);
  const bool any = kernels::gains_of_fit(estimates, {&result.gain[first], &result.gain_std[first], &result.phase[first],
                                                     &result.mean[first], &result.snr[first], remarks.data()});
  for (std::size_t i = 0; i < count; ++i)
    result.flags[first + i] = tone.flags | flag_if(tops[i] >= level, flag::saturated);
  if (!any && context.steps.are_integers_of_light() && !(tone.flags & (flag::unresolvable | flag::few_cycles))) return;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t index = first + i;
    Flags& flags = result.flags[index];
    const auto remark = static_cast<kernels::Remark>(remarks[i]);
    if (remark == kernels::kNoLight) flags |= flag::no_light;
    // A mean far beyond all samples follows from the part of a cycle that is seen.
    if (flags & flag::few_cycles && !(std::abs(result.mean[index]) <= 2 * tops[i])) {
      flags |= flag::unresolvable;
      result.mean[index] = kNaN;
    }
    if (flags & (flag::unresolvable | flag::no_light))
      mark_unknown(result, index);
    else if (remark == kernels::kWeakTone)
      flags |= flag::weak;
    else if (context.steps.step > 0 && (remark == kernels::kLittleNoise || !context.steps.are_integers_of_light()) &&
             most_rounding_error(context.steps, estimates.noise_variance[i]) > own_error(context, result, index))
      flags |= flag::quantised;  // until the frame is complete: flag_rounding()
  }
}

// Estimates from columns of linear light, (columns × rows).
StreamingFit::Columns fitted_columns(const HarmonicModel& model, const std::vector<double>& signals) {
  const auto rows = static_cast<Eigen::Index>(model.rows);
  const Eigen::Index count = static_cast<Eigen::Index>(signals.size()) / rows;
  const Eigen::Map<const Eigen::MatrixXd> y(signals.data(), rows, count);
  const Eigen::MatrixXd values = transposed_product(y, model.weights), residual = beside(model.basis, y);
  const auto freedom = static_cast<double>(model.rows - std::min(model.rows, model.parameters));
  StreamingFit::Columns fitted{{values.data(), values.data() + values.size()},
                               std::vector<double>(static_cast<std::size_t>(count), kNaN)};
  for (Eigen::Index column = 0; freedom > 0 && column < count; ++column)
    fitted.noise_variance[static_cast<std::size_t>(column)] = residual.col(column).squaredNorm() / freedom;
  return fitted;
}

// One tone of the estimates. `covariance`: of the parameters, for noise of variance 1.
kernels::FittedTone fitted_tone(const StreamingFit::Columns& columns, const Eigen::MatrixXd& covariance,
                                std::size_t tone) {
  const std::size_t count = columns.noise_variance.size();
  const double* const cosine = &columns.parameters[(2 * tone + 1) * count];
  const auto a = static_cast<Eigen::Index>(2 * tone + 1), b = a + 1;
  return {columns.parameters.data(),
          cosine,
          cosine + count,
          columns.noise_variance.data(),
          count,
          covariance(0, 0),
          covariance(a, a),
          covariance(b, b),
          covariance(0, a),
          0,
          0};
}

// A tone of the context as fitted by the model, of which row 0 lies `middle` rows before the phase origin.
Tone tone_of_model(const Context& context, const HarmonicModel& model, std::size_t k) {
  Tone tone = context.tones[k];
  const Phasor turn = phasor(tone.cycles_per_row, -model.middle);
  tone.phase_at_zero += std::atan2(turn.sine, turn.cosine);
  tone.flags |= model.tone_flags[k];
  return tone;
}

// One square wave: two may have harmonics on each other's aliases. Without an exposure: that of a row.
FoldedHarmonics folded_harmonics_of(const Context& context, std::optional<double> exposure_cycles = {}) {
  const auto& options = *context.options;
  const Tone& tone = context.tones[0];
  if (options.waveform != WaveformShape::square || context.tones.size() > 1 || options.method != GainMethod::fit)
    return {};
  return folded_harmonics(context.shape.rows, tone.cycles_per_row, options.duty,
                          exposure_cycles.value_or(tone.cycles_per_row));
}

std::vector<int> harmonics_of(const Context& context, const Tone& tone) {
  const auto& options = *context.options;
  if (options.waveform != WaveformShape::square || options.method == GainMethod::dft) return {1};
  auto harmonics = square_wave_harmonics(tone.cycles_per_row, options.duty);
  const auto folded = folded_harmonics_of(context, exposure_cycles_of(context, context.tones[0])).orders;
  harmonics.insert(harmonics.end(), folded.begin(), folded.end());
  return harmonics;
}

std::shared_ptr<const HarmonicModel> kept_model(std::size_t rows, const std::vector<ModelTone>& tones) {
  static RecentlyUsed<std::pair<std::size_t, std::vector<ModelTone>>, HarmonicModel, 8> kept;
  return kept.get({rows, tones}, [&] { return std::make_shared<const HarmonicModel>(harmonic_model(rows, tones)); });
}

std::shared_ptr<const HarmonicModel> model_of(const Context& context) {
  std::vector<ModelTone> tones;
  for (const Tone& tone : context.tones) tones.push_back({tone.cycles_per_row, harmonics_of(context, tone)});
  for (const double cycles : context.others) tones.push_back({cycles, {1}});
  return kept_model(context.shape.rows, tones);
}

// Tones of a fit, or the lines of the DFT nearest to them (eq. 25), those above half the row rate of negative
// frequencies: on a line, steps 1-4 of the paper are a fit of mean and tone, and noise is all energy outside of them.
Tone tone_of(const Camera& camera, double frequency, const ToneGainOptions& options, std::size_t row_count) {
  const auto rows = static_cast<double>(row_count);
  const auto response = exposure_response(frequency, camera.exposure.value_or(0));
  Tone tone{frequency, frequency * camera.row_time, flag_if(std::abs(response) < kNearNull, flag::near_null),
            -std::arg(response)};
  const double position = tone.cycles_per_row * rows, nearest = std::nearbyint(position);
  require(tone.cycles_per_row > 0 && position < 0x1p52, "frequency", frequency,
          "a frequency whose cycles in the frame can be counted");
  if (options.method == GainMethod::fit) return tone;
  if (position < 1) tone.flags |= flag::few_cycles;
  if (tone.cycles_per_row > 0.5) tone.flags |= flag::aliased;
  if (std::abs(position - nearest) > kNextToNone) tone.flags |= flag::off_bin;
  const double line = std::fmod(nearest, rows);
  tone.cycles_per_row = line > 0 ? line / rows : 0.5;  // neither is resolvable
  return tone;
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
  check_shape(frames);
  Context context{{},
                  full_depth_ratio(options.waveform, options.duty),
                  &camera,
                  &options,
                  shape_of(frames),
                  {camera.tone_curve, sample_maximum(frames), step_of_samples(frames)}};
  check_options(options, context.shape);
  require(!frequencies.empty(), "frequency", "no values", "at least one frequency");
  for (const double frequency : frequencies) {
    require_positive("frequency", frequency);
    context.tones.push_back(tone_of(camera, frequency, options, context.shape.rows));
  }
  return context;
}

ToneGain empty_result(std::size_t tones, std::size_t frames, std::size_t columns) {
  const std::size_t size = tones * frames * columns;
  const auto values = [&] { return std::vector<double>(size); };
  return {tones, frames, columns, values(), values(), values(), values(), values(), std::vector<Flags>(size)};
}

ToneGainView view_of(ToneGain& result) {
  return {result.gain, result.gain_std, result.phase, result.mean, result.snr, result.flags};
}

ToneGainView part_of(const ToneGainView& result, std::size_t first, std::size_t size) {
  const auto part = [&](auto values) { return values.subspan(first, size); };
  return {part(result.gain), part(result.gain_std), part(result.phase),
          part(result.mean), part(result.snr),      part(result.flags)};
}

void check_room(const ToneGainView& result, std::size_t size) {
  for (const auto& values : {result.gain, result.gain_std, result.phase, result.mean, result.snr})
    require(values.size() == size, "result", values.size(), "tones × frames × columns values");
  require(result.flags.size() == size, "result", result.flags.size(), "tones × frames × columns flags");
}

// Cycles per row of all oscillations of the model: tones first, then their harmonics, then other tones.
std::vector<double> model_cycles(const Context& context) {
  std::vector<double> cycles;
  for (const Tone& tone : context.tones) cycles.push_back(tone.cycles_per_row);
  for (const Tone& tone : context.tones)
    for (const int harmonic : harmonics_of(context, tone))
      if (harmonic != 1) cycles.push_back(harmonic * tone.cycles_per_row);
  cycles.insert(cycles.end(), context.others.begin(), context.others.end());
  return cycles;
}

// True for samples that are multiplied as integers.
bool holds_linear_bytes(const AnyFramesView& frames, const ToneCurve& curve) {
  return std::holds_alternative<FramesView<const std::uint8_t>>(frames) && curve.kind == ToneCurve::Kind::linear;
}

// Plan of a pass over the stored pixels if it loses nothing of them against the float64 fit of linear light; else null.
// A residual that is a difference of squares resolves noise of 10⁻⁷ of the light: rounding to float32 makes nearly as
// much. At full efficiency float64 uses the fit, whose residual is exact too.
std::shared_ptr<const StreamingFit> streaming_fit(const AnyFramesView& frames, const Context& context) {
  const auto& options = *context.options;
  const ToneCurve& curve = context.camera->tone_curve;
  const bool linear = curve.kind == ToneCurve::Kind::linear;
  const bool is_fit = options.method == GainMethod::fit;
  const double efficiency = is_fit ? options.efficiency : 1;
  const bool exact = std::holds_alternative<FramesView<const double>>(frames) && efficiency == 1;
  if (exact || (!linear && !holds_integers(frames))) return nullptr;
  auto fit = StreamingFit::plan(context.shape.rows, model_cycles(context), efficiency,
                                holds_linear_bytes(frames, curve), is_fit ? 1 : kMostLimbs);
  return fit->well_posed() ? fit : nullptr;
}

constexpr double kHalfStep = 0.5;  // between stored values
constexpr std::size_t kSome = 16;  // columns, and rows, that tell of a frame
// The step between them; the first is half a step from the edge.
std::size_t step_of_some(std::size_t columns) { return 1 + columns / kSome; }
constexpr Flags kUnusable = flag::saturated | flag::unresolvable | flag::no_light;

double noise_of(const ToneGainView& result, std::size_t index) {
  return result.gain[index] * result.mean[index] / std::sqrt(result.snr[index]);
}

// Samples of a column at a pile that stand for lost ones. Noise below half a step makes piles itself. So does a lamp
// that is off, above 0 with one run of rows in a cycle: those that noise takes from the level start further ones, and
// as many are lost as it takes above but not below. Black at 0 loses as many as noise takes to the value beside; of
// noise σ below a step exp(−step²/8σ²) of what it loses without steps (within 25 %). Where nearly all are at the top,
// noise is unknown.
double lost_samples(const Context& context, double off, const Pile& pile, double noise, const PileCounts& counts,
                    std::size_t column, bool is_shared) {
  const bool is_linear = context.camera->tone_curve.kind == ToneCurve::Kind::linear;
  const double at = counts.at[column], steps = noise / pile.step, rows = static_cast<double>(context.shape.rows);
  const bool may_be_off = pile.level < pile.beside && (!is_linear || pile.level <= off + kHalfStep * pile.step);
  if (may_be_off && pile.level > 0)
    return counts.runs[column] - context.tones[0].cycles_per_row * rows - 2.0 * counts.beyond[column];
  const bool is_nearly_all = pile.level > pile.beside && at > kNearlyAll * rows;
  if (!may_be_off && (at <= counts.beside[column] || (is_linear && steps < kHalfStep && !is_nearly_all && !is_shared)))
    return 0;
  if (!may_be_off || !is_linear || !(steps < 1)) return at;
  return std::min(at * std::exp(-1.0 / 8 / std::max(steps * steps - 1.0 / 12, 0.0)), counts.beside[column] / steps);
}

// True if columns end at one level, though the most that they see is in proportion to their means: in some it would
// lie two steps above the level if it is there in others (to half a step, in each).
bool is_shared(const Context& context, std::size_t frame, const Pile& pile, const PileCounts& counts,
               const ToneGainView& result) {
  double least = kInfinity, most = 0;  // mean in shares of the level
  for (std::size_t i = 0; i < context.shape.columns && pile.level > pile.beside; ++i) {
    const std::size_t index = index_of(context, 0, frame) + i;
    const double off = context.camera->tone_curve.dark_level + background_of(context, frame, i);
    if (result.flags[index] & kUnusable || counts.at[i] <= counts.beside[i] || counts.beyond[i] > 0) continue;
    least = std::min(least, result.mean[index] / (pile.level - off));
    most = std::max(most, result.mean[index] / (pile.level - off + 2 * pile.step));
  }
  return most > least;
}

// Samples at a pile of columns with weights.
struct PiledColumns {
  double weights = 0, squares = 0, lost = 0, at = 0, beside = 0, beyond = 0;

  void add(double weight, const PileCounts& counts, std::size_t column, double lost_samples) {
    weights += weight, squares += weight * weight, lost += weight * lost_samples;
    at += weight * counts.at[column], beside += weight * counts.beside[column];
    beyond += weight * counts.beyond[column];
  }
  // True if more are lost than would shift the mean by its standard error: k of a column shift it by at most
  // 0.8 σ k/rows, less than σ/√rows for k below √rows. A few are chance.
  [[nodiscard]] bool are_clipped(std::size_t rows) const {
    constexpr double kChance = 5, kLast = 20, kOfBeside = 0.8;  // a tone of two steps has 0.82 at black
    const double allowed = kChance * squares / weights + 0.5 * std::sqrt(static_cast<double>(rows) * squares);
    return lost > allowed && at > kOfBeside * beside && at > kLast * beyond;
  }
};

// Flags columns that are clipped, or all that are pooled, by their light, if those that are left are as one.
void flag_pile(const AnyFramesView& frames, const Context& context, std::size_t frame, const Pile& pile,
               const ToneGainView& result) {
  const auto counts = count_pile(frames, frame, pile);
  const auto flag_column = [&](std::size_t i) {
    for (std::size_t tone = 0; tone < context.tones.size(); ++tone)
      result.flags[index_of(context, tone, frame) + i] |= flag::saturated;
  };
  const bool shared = is_shared(context, frame, pile, counts, result);
  PiledColumns left;
  for (std::size_t i = 0; i < context.shape.columns; ++i) {
    const std::size_t index = index_of(context, 0, frame) + i;
    if (result.flags[index] & kUnusable) continue;
    const double off = context.camera->tone_curve.dark_level + background_of(context, frame, i);
    const double noise = noise_of(result, index), lost = lost_samples(context, off, pile, noise, counts, i, shared);
    PiledColumns own;
    own.add(1, counts, i, lost);
    if (own.are_clipped(context.shape.rows))
      flag_column(i);
    else if (noise >= pile.step)  // below, rounding is no noise
      left.add(std::max(result.mean[index], 0.0), counts, i, lost);
  }
  for (std::size_t i = 0; context.options->pooled && left.are_clipped(context.shape.rows) && i < context.shape.columns;
       ++i)
    flag_column(i);
}

// Flags columns in which rounding errs by more than the standard error, beside noise that grows with the light: by its
// own mean for those that are flagged so far.
void flag_rounding(const Context& context, std::size_t tone, std::size_t frame, const NoiseOfLight& noise_of_frame,
                   const ToneGainView& result) {
  const double step = context.steps.step, most = most_rounding_error(context.steps, noise_of_frame.least());
  const bool may_err = most > kEqual * step;
  const std::size_t start = index_of(context, tone, frame);
  std::map<std::array<double, 5>, double> known;  // of about the same light and noise
  for (std::size_t i = 0; i < context.shape.columns; ++i) {
    const std::size_t index = start + i;
    Flags& flags = result.flags[index];
    if (!(flags & flag::quantised || may_err)) continue;
    if (!(flags & flag::quantised) && (flags & (kUnusable | flag::weak) || !(most > own_error(context, result, index))))
      continue;
    const double background = background_of(context, frame, i), mean = result.mean[index], gain = result.gain[index],
                 phase = result.phase[index], noise = noise_of(result, index);
    std::array<double, 5> about{std::log2(mean * gain / step), gain, phase, noise / step, background / step};
    for (double& value : about) value = std::round(8 * value);
    const auto [found, is_new] = known.try_emplace(about, 0);
    const RoundedColumn column{1, mean, background};
    if (is_new)
      found->second = rounding_error(context.steps, rounded_tone(context, context.tones[tone], gain, phase),
                                     {&column, 1}, noise_of_frame.up_to(noise * noise));
    flags &= ~flag::quantised;
    flags |= flag_if(found->second > own_error(context, result, index), flag::quantised);
  }
}

// Place of the largest of some 256 values times `sign`, the middle one of equals: columns at the edge of a lamp may
// just reach a level at which others are clipped.
std::size_t place_of_extreme(std::span<const double> values, double sign) {
  const std::size_t step = values.size() / 256 + 1;
  std::size_t first = 0, last = 0;
  for (std::size_t i = step; i < values.size(); i += step) {
    if (sign * values[i] > sign * values[first]) first = i;
    if (values[i] == values[first]) last = i;
  }
  return values[last] == values[first] ? (first + last) / 2 : first;
}

// Noise of some columns, by the variance that a fit leaves, and the share of their own noise in it.
NoiseOfLight noise_of_light(const AnyFramesView& frames, const Context& context, std::size_t frame, IndexRange columns,
                            double variance, double share) {
  if (context.shape.rows < 4 || columns.size() == 1) return {variance / share};
  const ToneCurve& curve = context.camera->tone_curve;
  Eigen::MatrixXd light = samples_of_pairs(frames, frame, columns, 2 * kSome, context.tones[0].cycles_per_row);
  if (curve.kind == ToneCurve::Kind::linear)
    light.array() -= curve.dark_level;
  else
    light = light.unaryExpr([&](double stored) { return linear_light(curve, stored, context.steps.type_maximum); });
  return noise_of_samples(light, variance, share);
}

// Noise of the brightest columns and those beside them, where any of a few pairs of rows differs by less than a step.
NoiseOfLight noise_of_brightest(const AnyFramesView& frames, const Context& context, std::size_t frame,
                                std::span<const double> tops, const ToneGainView& result) {
  const IndexRange columns = columns_about(place_of_extreme(tops, 1), tops.size(), kSome / 2);
  if (context.shape.rows < 4) return {};
  const auto few = samples_of_pairs(frames, frame, columns, kSome, context.tones[0].cycles_per_row);
  double least = kInfinity;
  for (Eigen::Index n = 0; n < few.cols(); n += 2) least = std::min(least, (few.col(n + 1) - few.col(n)).squaredNorm());
  if (least > 2 * static_cast<double>(few.rows()) * context.steps.step * context.steps.step) return {};
  double sum = 0, count = 0;
  for (std::size_t i = columns.begin; i < columns.end; ++i)
    if (const double noise = noise_of(result, index_of(context, 0, frame) + i); std::isfinite(noise))
      sum += noise * noise, ++count;
  return noise_of_light(frames, context, frame, columns, sum / count, 1);
}

// Stored value below which there is no light.
double least_light(const AnyFramesView& frames, const Camera& camera) {
  const ToneCurve& curve = camera.tone_curve;
  if (curve.kind != ToneCurve::Kind::linear) return -std::numeric_limits<double>::infinity();
  return curve.dark_level - (holds_integers(frames) ? kHalfStep : 0);
}

// Clipping at either end, of samples of any type at any level, as the brightest and the darkest column show it. `tops`:
// largest sample of each column of the frame. Light below dark is a wrong dark level.
void flag_clipped(const AnyFramesView& frames, const Context& context, std::size_t frame, std::span<const double> tops,
                  const ToneGainView& result) {
  const std::span<const double> means = result.mean.subspan(frame * tops.size(), tops.size());
  const std::size_t start = index_of(context, 0, frame);
  const auto piles_at = [&](std::size_t column) {
    const double noise = noise_of(result, start + column);
    // Noise alone: nothing but a tone of linear light shows no more than its fundamental.
    if (std::isnan(noise) && context.options->waveform == WaveformShape::tone &&
        context.camera->tone_curve.kind == ToneCurve::Kind::linear)
      return Piles{};
    const double least = least_light(frames, *context.camera) - kSure * noise;
    return find_piles(frames, frame, column, least, context.tones[0].cycles_per_row);
  };
  // Noise is known where there is light above dark.
  const std::size_t top = place_of_extreme(tops, 1), darkest = place_of_extreme(means, -1),
                    brightest = std::isnan(result.gain[start + top]) ? place_of_extreme(means, 1) : top;
  Piles piles = piles_at(brightest);
  for (std::size_t k = 0; piles.negative && k < context.tones.size(); ++k)
    for (Flags& flags : result.flags.subspan(index_of(context, k, frame), tops.size())) flags |= flag::model_misfit;
  if (means[darkest] < (1 - kSmallShare) * means[brightest])
    if (const auto low = piles_at(darkest).low) piles.low = low;
  for (const auto& pile : {piles.low, piles.high})
    if (pile) flag_pile(frames, context, frame, *pile, result);
}

// Columns processed in one pass.
struct Piece {
  std::size_t frame, first, count;
};

// Width of the parts of the frames that are left: halves, or as many as there are threads for each.
std::size_t columns_per_part(std::size_t columns, std::size_t left, std::size_t threads) {
  const auto share = [](std::size_t of, std::size_t parts) { return (of + parts - 1) / parts; };
  const std::size_t parts = std::max<std::size_t>(share(threads, std::max<std::size_t>(left, 1)), 2);
  return std::max(share(columns, parts), kernels::kColumnsAtOnce);
}

// Whole frames, which are read fastest; those that are left when every thread has had as many are split. The results do
// not depend on the split.
std::vector<Piece> pieces_of(IndexRange frames, std::size_t columns, std::size_t widest, std::size_t threads) {
  std::vector<Piece> pieces;
  const std::size_t left = threads > 1 ? frames.size() % threads : 0;
  const std::size_t part = std::min(columns_per_part(columns, left, threads), widest);
  for (std::size_t frame = frames.begin; frame < frames.end; ++frame)
    for_each_part(columns, frame + left >= frames.end ? part : widest, [&](IndexRange of) {
      pieces.push_back({frame, of.begin, of.size()});
    });
  return pieces;
}

// What a pass over stored samples reads as light.
struct StoredLight {
  std::shared_ptr<const LightTable> table;  // null: samples are light, above `dark`
  double dark = 0;
  double saturated = 0;  // level, of what is read

  [[nodiscard]] std::span<const float> light() const {
    return table ? std::span<const float>(table->rounded) : std::span<const float>();
  }
};

StoredLight stored_light(const AnyFramesView& frames, const ToneCurve& curve) {
  const double level = saturation_level(frames, curve);
  if (curve.kind == ToneCurve::Kind::linear) return {nullptr, curve.dark_level, level};
  const double light = linear_light(curve, level, sample_maximum(frames));
  auto table = light_table(frames, curve);
  return {table, 0, table ? static_cast<double>(static_cast<float>(light)) : light};
}

// Refuses light whose squares are no numbers.
void check_size(std::span<const double> light) {
  for (const double each : light)
    require(each == 0 || (std::abs(each) >= 1 / kMaxLevel && std::abs(each) <= kMaxLevel), "columns", each,
            "light of 1e-100 to 1e100, whose squares are numbers");
}

// Refuses samples that are not finite by their sums, and those of rows that are not added.
void check_summed(const AnyFramesView& frames, const StreamingFit& fit, const Piece& piece, const Projection& sums) {
  if (holds_integers(frames)) return;
  const auto part = [&piece, of = frame_of(frames, piece.frame)](std::size_t row) {
    return part_of(of, {.x = piece.first, .y = row, .width = piece.count, .height = shape_of(of).rows - row});
  };
  check_samples(part(fit.rows_added()));
  if (!std::ranges::all_of(sums.totals, [](double total) { return std::isfinite(total); })) check_samples(part(0));
  check_size(sums.totals);
}

// Gains of the columns of some frames by one model, with the flags of clipped ones: by a pass over stored samples, else
// by a fit of their light.
void gains_of_model(const AnyFramesView& frames, const Context& context, IndexRange which, const ToneGainView& result) {
  const ToneCurve& curve = context.camera->tone_curve;
  const auto fit = streaming_fit(frames, context);
  if (!fit && context.stored) check_samples(frames);
  const auto fitted_model = fit ? nullptr : model_of(context);
  const HarmonicModel& model = fit ? fit->model() : *fitted_model;
  const StoredLight stored = fit ? stored_light(frames, curve) : StoredLight{{}, 0, saturation_level(frames, curve)};
  const bool bytes = holds_linear_bytes(frames, curve);
  const auto threads = static_cast<std::size_t>(context.options->threads);
  const std::size_t columns_of_frame = context.shape.columns;
  const auto pieces = pieces_of(which, columns_of_frame, fit ? kCopied.columns : kColumnsInCache, threads);
  std::vector<double> tops(which.size() * columns_of_frame);
  const auto top_of = [&](std::size_t frame) {
    return std::span(tops).subspan((frame - which.begin) * columns_of_frame, columns_of_frame);
  };
  const auto flag_frame = [&](std::size_t frame) {
    if (context.steps.step > 0) {
      const auto noise = noise_of_brightest(frames, context, frame, top_of(frame), result);
      for (std::size_t tone = 0; tone < context.tones.size(); ++tone)
        flag_rounding(context, tone, frame, noise, result);
    }
    if (context.stored) flag_clipped(frames, context, frame, top_of(frame), result);
  };
  for_each_block(pieces.size(), context.options->threads, [&](std::size_t block) {
    const auto [frame, first, count] = pieces[block];
    // Memory reused from call to call: the C library may return it to the system after every call, and a new allocation
    // takes longer than the arithmetic (four tones in 80 rows: 125 instead of 55 µs).
    thread_local Projection sums;
    thread_local StreamingFit::Columns columns;
    const auto write = [&, frame = frame, first = first](std::size_t done, std::size_t here) {
      const auto means = std::span(columns.parameters).first(here);
      if (!fit) check_size(means);
      take_off(context, frame, first + done, stored.dark, means);
      for (std::size_t k = 0; k < context.tones.size(); ++k)
        write_result(context, tone_of_model(context, model, k), fitted_tone(columns, model.covariance, k),
                     std::span(sums.maximum).subspan(done, here), stored.saturated,
                     index_of(context, k, frame) + first + done, result);
    };
    if (fit) {
      // The frame after this one, which is prefetched, is the one that this thread takes next.
      project(every_frame(frames, frame, threads), 0, first, count, fit->weights(), stored.light(), sums);
      check_summed(frames, *fit, pieces[block], sums);
      for_each_part(count, kernels::kColumnsAtOnce, [&](IndexRange part) {
        fit->estimate(sums, bytes, part.begin, part.size(), columns);
        write(part.begin, part.size());
      });
    } else {
      project(frames, frame, first, count, {{}, 0, context.shape.rows, 1, 1}, {}, sums);
      columns = fitted_columns(model, column_signals(frames, frame, first, count, curve));
      write(0, count);
    }
    std::ranges::copy(sums.maximum, top_of(frame).begin() + static_cast<std::ptrdiff_t>(first));
    if (count == columns_of_frame) flag_frame(frame);  // while it is in the cache
  });
  for (const Piece& piece : pieces)
    if (piece.count < columns_of_frame && piece.first == 0) flag_frame(piece.frame);
}

// Columns of a frame combined.
struct PooledColumn {
  std::vector<double> signal;  // (rows,), linear light; empty: none are
  double background = 0;
  bool saturated = false, misfit = false;
  std::size_t brightest = 0;
  double squares = 1;                 // of the weights
  std::vector<RoundedColumn> some{};  // of every so many columns
};

// Flags of each column by itself, where the brightest or the darkest may be clipped; else none.
std::vector<Flags> flags_of_columns(const AnyFramesView& one, const Context& context, std::size_t frame,
                                    const Projection& light) {
  const double least = least_light(one, *context.camera);
  const auto may_be = [&](std::size_t column) {
    const Piles piles = find_piles(one, 0, column, least, context.tones[0].cycles_per_row);
    return piles.low || piles.high || piles.negative;
  };
  const std::size_t brightest = place_of_extreme(light.maximum, 1), darkest = place_of_extreme(light.totals, -1);
  // Columns that are alike tell the same.
  const bool alike = light.totals[darkest] >= (1 - kSmallShare) * light.totals[brightest];
  if (!may_be(brightest) && (alike || !may_be(darkest))) return {};
  ToneGainOptions options = *context.options;
  const std::size_t columns = context.shape.columns;
  if (options.background.size() > 1) options.background = options.background.subspan(frame * columns, columns);
  std::vector<double> frequencies;
  for (const Tone& tone : context.tones) frequencies.push_back(tone.frequency);
  ToneGain found = empty_result(frequencies.size(), 1, columns);
  gains_of_model(one, make_context(one, *context.camera, frequencies, options), {0, 1}, view_of(found));
  return found.flags;
}

// With equal noise in all columns, brightness is the weight that maximises the signal-to-noise ratio. `light`: totals
// and maxima of the columns, above dark. Saturated columns get none if others remain, otherwise clipped ones (`flags`)
// if half of the light remains; without light above the background, those of the least background are equal.
std::vector<double> weigh_columns(const Context& context, std::size_t frame, const Projection& light,
                                  const StoredLight& stored, std::span<const Flags> flags, bool& saturated) {
  const auto rows = static_cast<double>(context.shape.rows);
  std::vector<double> weights(context.shape.columns);
  for (std::size_t column = 0; column < weights.size(); ++column)
    weights[column] = std::max(light.totals[column] / rows - stored.dark - background_of(context, frame, column), 0.0);
  for (const double light_above_dark : weights)
    require(std::isfinite(light_above_dark), "columns", light_above_dark,
            "columns whose mean light above dark_level and background is finite");
  const auto is_zero = [](double w) { return w == 0; };
  if (std::ranges::all_of(weights, is_zero)) {
    double least = background_of(context, frame, 0);
    for (std::size_t column = 1; column < weights.size(); ++column)
      least = std::min(least, background_of(context, frame, column));
    for (std::size_t column = 0; column < weights.size(); ++column)
      weights[column] = background_of(context, frame, column) == least ? 1.0 : 0.0;
  }
  const double largest = *std::max_element(weights.begin(), weights.end());
  for (double& weight : weights) weight /= largest;  // sums of large light do not overflow
  const auto sum = [](const auto& values) { return std::accumulate(values.begin(), values.end(), 0.0); };
  const auto leave_out = [&](double least_left, auto is_out) {
    std::vector<double> left = weights;
    for (std::size_t column = 0; column < left.size(); ++column)
      if (is_out(column)) left[column] = 0;
    const bool is_enough = sum(left) > least_left * sum(weights);
    if (is_enough) weights = std::move(left);
    saturated |= !is_enough;
  };
  leave_out(0, [&](std::size_t column) { return light.maximum[column] >= stored.saturated; });
  leave_out(0.5, [&](std::size_t column) { return !flags.empty() && (flags[column] & flag::saturated) != 0; });
  const double total = sum(weights);
  for (double& weight : weights) weight /= total;
  return weights;
}

// As weighted_rows(); rows of contiguous linear bytes by integers, as columns of the turned frame.
std::vector<double> pooled_rows(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                                std::span<const double> weights) {
  if (!holds_linear_bytes(frames, curve)) return weighted_rows(frames, frame, curve, weights);
  auto turned = std::get<FramesView<const std::uint8_t>>(frames);
  // The weights of the integers: few cycles do not tell mean and tone apart, and magnify any difference.
  if (turned.column_stride != 1)
    return weighted_rows(frames, frame, curve, RowWeights(weights, 1, turned.columns, 1, kMostLimbs).byte_weights());
  std::swap(turned.rows, turned.columns);
  std::swap(turned.row_stride, turned.column_stride);
  auto signal = project(turned, frame, 0, turned.columns, {weights, 1, turned.rows, 1, kMostLimbs}).sums;
  for (double& light : signal) light -= curve.dark_level;
  return signal;
}

// True where columns show the tone at phases that cancel in their sum, by some rows of some columns in which it is most
// of what varies.
bool cancels(const AnyFramesView& frames, std::size_t at, const Tone& tone, std::span<const double> weights) {
  const std::size_t every = step_of_some(weights.size());
  Eigen::Matrix<double, kSome, kSome> light = light.Zero();  // (columns × rows)
  Eigen::Matrix<double, kSome, 2> waves;
  Eigen::Array<double, kSome, 1> weight = weight.Zero();
  std::visit(
      [&](const auto& view) {
        for (Eigen::Index i = 0; i < Eigen::Index{kSome}; ++i) {
          const std::size_t row = some_row(static_cast<std::size_t>(i), view.rows);
          const Phasor wave = phasor(tone.cycles_per_row, static_cast<double>(row));
          waves.row(i) << wave.cosine, wave.sine;
          for (std::size_t c = every / 2; c < weights.size(); c += every) {
            light(static_cast<Eigen::Index>(c / every), i) = static_cast<double>(view(at, row, c));
            weight(static_cast<Eigen::Index>(c / every)) = weights[c];
          }
        }
      },
      frames);
  light.colwise() -= light.rowwise().mean().eval();
  const Eigen::Matrix<double, kSome, 2> levels = light * waves;
  const Eigen::Array<double, kSome, 1> sizes = levels.rowwise().norm(), tones = 2.0 / kSome * sizes.square(),
                                       all = light.rowwise().squaredNorm(), noise = (all - tones).max(0).sqrt();
  const double sum = (weight.matrix().transpose() * levels).norm();
  return sum < kNearlyAll * (weight * (sizes - noise)).sum() && (weight * tones).sum() > kMostly * (weight * all).sum();
}

// `frames` holds `frame` of the context, light by `curve`, as its frame number `at`; `one` holds it as it is stored.
PooledColumn pool_columns(const AnyFramesView& frames, std::size_t at, const Context& context, std::size_t frame,
                          const ToneCurve& curve, const AnyFramesView& one) {
  const StoredLight stored = stored_light(frames, curve);
  const Projection light =
      project(frames, at, 0, context.shape.columns, {{}, 0, context.shape.rows, 1, 1}, stored.light());
  PooledColumn pooled;
  const std::vector<Flags> flags = flags_of_columns(one, context, frame, light);
  const auto weights = weigh_columns(context, frame, light, stored, flags, pooled.saturated);
  for (const Flags own : flags) pooled.misfit |= (own & flag::model_misfit) != 0;
  pooled.signal = pooled_rows(frames, at, curve, weights);
  for (const Tone& tone : context.tones) pooled.misfit |= cancels(frames, at, tone, weights);
  for (std::size_t column = 0; column < weights.size(); ++column)
    pooled.background += weights[column] * background_of(context, frame, column);
  if (context.steps.step == 0) return pooled;
  pooled.brightest = static_cast<std::size_t>(std::ranges::max_element(weights) - weights.begin());
  pooled.squares = scalar_product(weights, weights);
  const std::size_t every = step_of_some(weights.size());
  for (std::size_t k = every / 2; k < weights.size(); k += every) {
    const double background = background_of(context, frame, k), rows = static_cast<double>(context.shape.rows);
    pooled.some.push_back(
        {weights[k] * static_cast<double>(every), light.totals[k] / rows - stored.dark - background, background});
  }
  return pooled;
}

PooledColumn pool_columns(const AnyFramesView& frames, const Context& context, std::size_t frame) {
  const ToneCurve& curve = context.camera->tone_curve;
  if (curve.kind == ToneCurve::Kind::linear || holds_integers(frames))
    return pool_columns(frames, frame, context, frame, curve, frame_of(frames, frame));
  const auto [frame_count, rows, columns] = context.shape;
  const auto signals = column_signals(frames, frame, 0, columns, curve);
  const FramesView<const double> light{signals.data(), 1, rows, columns, 0, 1, static_cast<std::ptrdiff_t>(rows)};
  return pool_columns(light, 0, context, frame, {}, frame_of(frames, frame));
}

std::vector<FittedLight> lights_of(const Context& context) {
  const bool square = context.options->waveform == WaveformShape::square;
  std::vector<FittedLight> lights;
  for (const Tone& tone : context.tones)
    lights.push_back(
        {tone.cycles_per_row, exposure_cycles_of(context, tone).value_or(kNaN), square ? context.options->duty : 0});
  return lights;
}

// The usable column of a frame with the largest value_of(index), without `flags`; the number of columns if there is
// none.
template <typename ValueOf>
std::size_t largest_column(const Context& context, std::size_t frame, const ToneGainView& result, Flags flags,
                           ValueOf value_of) {
  const std::size_t start = index_of(context, 0, frame);
  double most = 0;
  std::size_t largest = context.shape.columns;
  for (std::size_t column = 0; column < context.shape.columns; ++column) {
    if (result.flags[start + column] & flags) continue;
    if (const double value = value_of(start + column); value > most) {
      most = value;
      largest = column;
    }
  }
  return largest;
}

// Level of the tone, relative to others of one frame.
auto level_of(const ToneGainView& result) {
  return [&](std::size_t i) { return result.gain[i] * result.mean[i]; };
}

// Mean of up to 16 neighbouring columns of one phase about that with the strongest tone, without saturated ones; empty
// if all are. Phases that differ leave the mean with harmonics that no column has.
PooledColumn strongest_columns(const AnyFramesView& frames, const Context& context, std::size_t frame,
                               const ToneGainView& result) {
  const std::size_t columns = context.shape.columns, start = index_of(context, 0, frame);
  const auto is_usable = [&](std::size_t column) {
    return column < columns && !(result.flags[start + column] & kUnusable);
  };
  std::size_t first = largest_column(context, frame, result, kUnusable, level_of(result));
  if (first == columns) return {};
  const auto phase_std = [&](std::size_t i) { return result.gain_std[i] / result.gain[i]; };
  const std::size_t strongest = start + first;
  const auto belongs = [&](std::size_t column) {
    const std::size_t i = start + column;
    return is_usable(column) &&
           std::abs(std::remainder(result.phase[i] - result.phase[strongest], kTwoPi)) <
               std::max(kNextToNone * kTwoPi, kSure * std::hypot(phase_std(i), phase_std(strongest)));
  };
  std::size_t end = first + 1;
  while (end - first < kSome && (belongs(end) || (first > 0 && belongs(first - 1))))
    if (belongs(end))
      ++end;
    else
      --first;
  const double share = 1 / static_cast<double>(end - first);
  double background = 0;
  for (std::size_t i = first; i < end; ++i) background += share * background_of(context, frame, i);
  const auto part =
      part_of(frame_of(frames, frame), {.x = first, .y = 0, .width = end - first, .height = context.shape.rows});
  return {weighted_rows(part, 0, context.camera->tone_curve, std::vector<double>(end - first, share)), background};
}

// A column's fit of all oscillations, and what it leaves.
struct ColumnFit {
  std::shared_ptr<const HarmonicModel> model;
  Eigen::VectorXd parameters, left;

  // Without a result: nothing is left but rounding, or too little is known.
  static std::optional<ColumnFit> of(const Context& context, std::span<const double> column) {
    std::vector<ModelTone> oscillations;
    for (const double cycles : model_cycles(context)) oscillations.push_back({cycles, {1}});
    // A slow square wave has thousands of harmonics.
    if (column.empty() || context.shape.rows <= 2 * (1 + 2 * oscillations.size())) return {};
    auto model = kept_model(context.shape.rows, oscillations);
    if (!std::ranges::all_of(model->tone_flags, is_well_posed)) return {};
    const Eigen::Map<const Eigen::VectorXd> y(column.data(), static_cast<Eigen::Index>(model->rows));
    Eigen::VectorXd left = beside(model->basis, y);
    if (left.norm() <= kEqual * y.norm()) return {};
    Eigen::VectorXd parameters = transposed_product(model->weights, y);
    return ColumnFit{std::move(model), std::move(parameters), std::move(left)};
  }

  [[nodiscard]] std::complex<double> level(std::size_t tone) const {
    const auto at = static_cast<Eigen::Index>(2 * tone + 1);
    return {parameters(at), -parameters(at + 1)};
  }
  [[nodiscard]] std::span<const double> rest() const { return {left.data(), model->rows}; }
};

// Compares the harmonics of a single square wave with its waveform and exposure: harmonic_distortion; 0 for others.
double distortion_of(const ColumnFit& column, const Context& context) {
  if (context.options->waveform != WaveformShape::square || context.tones.size() != 1) return 0;
  const auto orders = harmonics_of(context, context.tones[0]);
  std::vector<std::complex<double>> levels;
  for (std::size_t k = 0; k < orders.size(); ++k) levels.push_back(column.level(k));
  const HarmonicModel& model = *column.model;
  const double noise = column.left.squaredNorm() / static_cast<double>(model.rows - model.parameters);
  return harmonic_distortion(lights_of(context)[0], model.rows, orders, levels, noise * model.covariance(1, 1));
}

// False if the model leaves nothing but noise of a column: the test of every frame, a thousand times faster than
// `surroundings`.
bool may_have_surroundings(const ColumnFit& column, const Context& context) {
  return !is_white(column.rest()) || distortion_of(column, context) > 0;
}

// The largest of all tones.
double unevenness_of(const Context& context, const std::optional<ColumnFit>& column, double background) {
  double worst = 0;
  for (std::size_t k = 0; column && k < context.tones.size(); ++k)
    worst = std::max(worst, unevenness(column->rest(), context.tones[k].cycles_per_row,
                                       column->parameters(0) - background, column->level(k)));
  return worst;
}

// Other tones, and what is wrong beside them in parts of the gain; nothing where the model leaves noise.
Surroundings surroundings_of(const Context& context, const PooledColumn& column) {
  const auto alone = ColumnFit::of(context, column.signal);
  if (!alone || (unevenness_of(context, alone, column.background) == 0 && !may_have_surroundings(*alone, context)))
    return {};
  Surroundings around = surroundings(column.signal, lights_of(context));
  Context with_others = context;
  with_others.others = around.tones;
  around.unevenness = unevenness_of(with_others, ColumnFit::of(with_others, column.signal), column.background);
  return around;
}

// True if a relative error of the gain is more than half its standard error, which needs a flag.
bool biases(double error, const ToneGainView& result, std::size_t i) {
  return error * result.gain[i] > 0.5 * result.gain_std[i];
}

// Flags columns that the distortion may bias, all of them where unevenness may do so in one: rain is not in all columns
// alike.
void flag_misfit(const Surroundings& around, std::size_t first, std::size_t count, const ToneGainView& result) {
  bool all = around.inseparable;
  for (std::size_t i = first; i < first + count; ++i) all = all || biases(around.unevenness, result, i);
  for (std::size_t i = first; i < first + count; ++i)
    if (all || biases(around.distortion, result, i)) result.flags[i] |= flag::model_misfit;
}

// Flags columns of another waveform beside right ones, those with the most noise first: what the model does not hold is
// in their noise.
void flag_noisy_columns(const AnyFramesView& frames, const Context& context, std::size_t frame,
                        const ToneGainView& result) {
  const std::size_t start = index_of(context, 0, frame), none = context.shape.columns;
  const auto noise = [&](std::size_t i) { return noise_of(result, i); };
  const std::size_t strongest = largest_column(context, frame, result, kUnusable, level_of(result));
  while (strongest != none) {
    const std::size_t noisiest = largest_column(context, frame, result, kUnusable | flag::model_misfit, noise);
    if (noisiest == none || noise(start + noisiest) < (1 + kSmallShare) * noise(start + strongest)) return;
    const auto fit = ColumnFit::of(context, column_signals(frames, frame, noisiest, 1, context.camera->tone_curve));
    if (!fit || !biases(distortion_of(*fit, context), result, start + noisiest)) return;
    result.flags[start + noisiest] |= flag::model_misfit;
  }
}

void check_frame(const AnyFramesView& frames, const Context& context, std::size_t frame, const ToneGainView& result) {
  const auto around = surroundings_of(context, strongest_columns(frames, context, frame, result));
  if (!around.tones.empty()) {
    Context with_others = context;
    with_others.others = around.tones;
    gains_of_model(frames, with_others, {frame, frame + 1}, result);
  }
  for (std::size_t tone = 0; tone < context.tones.size(); ++tone)
    flag_misfit(around, index_of(context, tone, frame), context.shape.columns, result);
  flag_noisy_columns(frames, context, frame, result);
}

// Flags columns whose gain another waveform biases: the fit has room for harmonics that are not there.
void check_waveform(const AnyFramesView& frames, const Context& context, std::size_t frame,
                    const ToneGainView& result) {
  const auto column = ColumnFit::of(context, strongest_columns(frames, context, frame, result).signal);
  Surroundings around;
  if (column) around.distortion = distortion_of(*column, context);
  flag_misfit(around, index_of(context, 0, frame), context.shape.columns, result);
  flag_noisy_columns(frames, context, frame, result);
}

// Corrects value `i` of the result, in which the fit shows a square wave with its tied harmonics; false where these
// leave its level in doubt.
bool untie(const Context& context, const TiedHarmonics& harmonics, double exposure_cycles, std::size_t i,
           const ToneGainView& result) {
  const double to_middle =
      std::numbers::pi *
      ((static_cast<double>(context.shape.rows) - 1) * context.tones[0].cycles_per_row - exposure_cycles);
  const double relative_std = result.gain_std[i] / result.gain[i];
  const auto light = harmonics.light(result.phase[i] + to_middle, relative_std);
  if (!light || biases(light->spread / light->level, result, i)) return false;
  const double level = result.gain[i] * result.mean[i] * light->level;
  const double mean = result.mean[i] - level * context.ratio * light->mean;
  if (!(mean > 0)) return false;
  const double change = level / mean / result.gain[i];
  result.gain[i] *= change;
  result.gain_std[i] *= change * std::hypot(1, light->slope);
  result.phase[i] = std::remainder(result.phase[i] + light->turn, kTwoPi);
  result.mean[i] = mean;
  result.snr[i] *= light->level * light->level;
  return true;
}

// Corrects gains that harmonics on mean or fundamental may bias by the ratios of these where the exposure is known,
// else flags them. An exposure that is not known is that of a light of full depth with the largest gain.
void untie_harmonics(const Context& context, const ToneGainView& result) {
  if (context.options->waveform != WaveformShape::square || result.gain.empty()) return;
  const auto known = exposure_cycles_of(context, context.tones[0]);
  auto exposure_cycles = known;
  if (!known) {
    double largest = 0;
    for (const double gain : result.gain) largest = gain > largest ? gain : largest;
    exposure_cycles = exposure_cycles_of_gain(largest);
  }
  const auto folded = folded_harmonics_of(context, exposure_cycles);
  std::optional<TiedHarmonics> harmonics;
  const bool tied = known && context.options->efficiency == 1;
  for (std::size_t i = 0; folded.error > 0 && i < result.gain.size(); ++i) {
    if (result.flags[i] & flag::harmonics_dropped || !biases(folded.error, result, i)) continue;
    if (tied && !harmonics)
      harmonics.emplace(*model_of(context), folded.tied, context.tones[0].cycles_per_row, context.options->duty,
                        *known);
    if (!tied || !untie(context, *harmonics, *known, i, result)) result.flags[i] |= flag::harmonics_dropped;
  }
}

// Gains beyond that of light of full depth contradict exposure, waveform, dark level or background; without an exposure
// those of which the fundamental is more than twice the mean, which no light is.
void flag_impossible(const Context& context, const ToneGainView& result) {
  const auto& exposure = context.camera->exposure;
  const std::size_t each = result.gain.size() / context.tones.size();
  for (std::size_t tone = 0; tone < context.tones.size(); ++tone) {
    const double of_light = exposure ? std::abs(sinc(context.tones[tone].frequency * *exposure)) : 2 / context.ratio;
    const double most = of_light + kNextToNone;
    for (std::size_t i = tone * each; i < (tone + 1) * each; ++i)
      if (result.gain[i] - kSure * result.gain_std[i] > most) result.flags[i] |= flag::model_misfit;
  }
}

}  // namespace

double full_depth_ratio(WaveformShape waveform, double duty) {
  return waveform == WaveformShape::tone ? 1.0 : 2 * sinc(duty);
}

namespace {

// `known`: flags of the frames' columns; none where all are yet to be found.
void gains_of(const AnyFramesView& frames, const Context& context, std::span<const Flags> known,
              const ToneGainView& result) {
  const auto add_known = [&] {
    for (std::size_t i = 0; !known.empty() && i < result.flags.size(); ++i) result.flags[i] |= known[i % known.size()];
  };
  gains_of_model(frames, context, {0, context.shape.frames}, result);
  add_known();
  const bool is_known = context.options->waveform == WaveformShape::square && context.camera->exposure;
  if (context.options->method == GainMethod::fit && (context.options->robust || is_known))
    for_each_block(context.shape.frames, context.options->threads, [&](std::size_t frame) {
      (context.options->robust ? check_frame : check_waveform)(frames, context, frame, result);
    });
  add_known();
  untie_harmonics(context, result);
  flag_impossible(context, result);
}

// Relative error of a pooled gain by noise that black cuts off, by the samples there in some rows and columns. Noise is
// that of the brightest rows, of which black takes none.
double pull_of_black(const AnyFramesView& frames, const Context& context, const PooledColumn& pooled,
                     std::span<const double> signal, const NoiseOfLight& noise, std::size_t i,
                     const ToneGainView& result) {
  const std::size_t some_rows = 4 * kSome;
  const std::size_t frame = i % context.shape.frames;
  const Tone& tone = context.tones[i / context.shape.frames];
  const std::size_t every = step_of_some(context.shape.columns);
  const double steady = mean_of(signal), step = context.steps.step, dark = context.camera->tone_curve.dark_level,
               variance = noise.at(std::ranges::max(signal)) / (step * step) - 1.0 / 12,
               deviation = std::sqrt(std::max(variance, kNextToNone * kNextToNone)),
               each = pooled.squares * static_cast<double>(every);
  double lost = 0;
  std::complex<double> tone_lost;
  const auto look = [&](std::size_t row, const RoundedColumn& column) {
    const Phasor wave = phasor(tone.cycles_per_row, static_cast<double>(row));
    const double off = dark + column.background,
                 level = off + column.mean + (signal[row] - steady) * column.share / each,
                 light = column.share * lost_at_black(level / step, deviation, off / step);
    lost += light;
    tone_lost += light * std::complex(wave.cosine, wave.sine);
  };
  std::visit(
      [&](const auto& view) {
        for (std::size_t n = 0; n < some_rows; ++n)
          for (std::size_t row = some_row(n, view.rows, tone.cycles_per_row), k = 0; k < pooled.some.size(); ++k)
            if (view(frame, row, every / 2 + k * every) == 0) look(row, pooled.some[k]);
      },
      frames);
  const double gain = result.gain[i] * context.ratio, unit = step / some_rows / result.mean[i];
  return unit * (lost + 2 * std::abs(tone_lost) / gain);
}

// Gains of the frames' pooled columns: one column of linear light each.
void pooled_gains(const AnyFramesView& frames, const Context& context, const ToneGainView& result) {
  check_samples(frames);
  const std::size_t frame_count = context.shape.frames, rows = context.shape.rows;
  std::vector<double> signals(frame_count * rows), background(frame_count);
  std::vector<Flags> known(frame_count);
  std::vector<PooledColumn> kept(frame_count);
  for_each_block(frame_count, context.options->threads, [&](std::size_t frame) {
    PooledColumn pooled = pool_columns(frames, context, frame);
    std::ranges::copy(pooled.signal, &signals[frame * rows]);
    background[frame] = pooled.background;
    known[frame] = flag_if(pooled.saturated, flag::saturated) | flag_if(pooled.misfit, flag::model_misfit);
    pooled.signal = {};
    kept[frame] = std::move(pooled);
  });
  Camera camera = *context.camera;
  camera.tone_curve = {};
  ToneGainOptions options = *context.options;
  options.background = background;
  options.efficiency = 1;
  options.pooled = false;
  const Context own{
      context.tones, context.ratio, &camera, &options, {frame_count, rows, 1}, {camera.tone_curve, 1, 0}, {}, false};
  gains_of(dense_view<const double>(signals.data(), frame_count, rows, 1), own, known, result);
  for (std::size_t i = 0; i < result.gain.size(); ++i) {
    const PooledColumn& pooled = kept[i % frame_count];
    if (pooled.some.empty() || (result.flags[i] & (kUnusable | flag::weak))) continue;
    const double noise = noise_of(result, i), allowed = own_error(context, result, i);
    const NoiseOfLight of_column =
        noise_of_light(frames, context, i % frame_count, columns_about(pooled.brightest, context.shape.columns, kSome),
                       noise * noise, pooled.squares);
    if (most_rounding_error(context.steps, of_column.least()) > allowed &&
        rounding_error(context.steps,
                       rounded_tone(context, context.tones[i / frame_count], result.gain[i], result.phase[i]),
                       pooled.some, of_column) > allowed)
      result.flags[i] |= flag::quantised;
    if (holds_integers(frames) && context.camera->tone_curve.kind == ToneCurve::Kind::linear) {
      const double pull = pull_of_black(frames, context, pooled,
                                        std::span(signals).subspan(i % frame_count * rows, rows), of_column, i, result);
      result.gain_std[i] = std::hypot(result.gain_std[i], pull * result.gain[i]);
      if (result.gain[i] < kWeak * result.gain_std[i]) result.flags[i] |= flag::weak;
    }
  }
}

}  // namespace

void tone_gain(const AnyFramesView& frames, const Camera& camera, std::span<const double> frequencies,
               const ToneGainOptions& options, const ToneGainView& result) {
  const Context context = make_context(frames, camera, frequencies, options);
  const std::size_t each = context.shape.frames * (options.pooled ? 1 : context.shape.columns);
  check_room(result, frequencies.size() * each);
  if (options.method == GainMethod::dft && frequencies.size() > 1) {
    for (std::size_t k = 0; k < frequencies.size(); ++k)
      tone_gain(frames, camera, frequencies.subspan(k, 1), options, part_of(result, k * each, each));
    return;
  }
  if (options.pooled)
    pooled_gains(frames, context, result);
  else
    gains_of(frames, context, {}, result);
}

ToneGain tone_gain(const AnyFramesView& frames, const Camera& camera, std::span<const double> frequencies,
                   const ToneGainOptions& options) {
  const Shape shape = shape_of(frames);
  ToneGain result = empty_result(frequencies.size(), shape.frames, options.pooled ? 1 : shape.columns);
  tone_gain(frames, camera, frequencies, options, view_of(result));
  return result;
}

}  // namespace ocisac
