#include "ocisac/tones/varying_tone.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <tuple>

#include "columns/dense_rows.hpp"
#include "core/legendre.hpp"
#include "core/levels.hpp"
#include "core/parallel.hpp"
#include "core/recently_used.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/tones/projection.hpp"
#include "rows/fit.hpp"
#include "rows/verdict.hpp"
#include "tones/gain_kernel.hpp"
#include "tones/harmonic_model.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
// Of one column, at most 3·5 + 3: on the stack.
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 18, 1>;

// Share of a column's energy that the model leaves: below it, energies of model and column differ by too few digits.
constexpr double kResolvedRest = 1e-6;

constexpr int kPlaces = 8;  // of Gauss and Legendre along the rows, for the mean of the tone's amplitude
using Places = Eigen::Array<double, kPlaces, 1>;

// Harmonics in ascending order until half of the degrees of freedom are used, without those so close to half the row
// rate that their polynomials overlap with their mirror images.
std::vector<int> usable_harmonics(std::vector<int> harmonics, std::size_t rows, double cycles_per_row, int degree) {
  const auto terms = static_cast<std::size_t>(degree) + 1;
  const double highest = 0.5 - static_cast<double>(terms) / (2 * static_cast<double>(rows));
  while (harmonics.size() > 1 &&
         (harmonics.back() * cycles_per_row > highest || 2 * terms * (1 + 2 * harmonics.size()) > rows))
    harmonics.pop_back();
  return harmonics;
}

// Least squares for all columns: parameters = weights·y. The first `terms` parameters describe the light, the next the
// cosine and the sine of the fundamental; the last three are those of tone_gain: mean, cosine, sine.
struct Plan {
  Index terms = 1;
  MatrixXd weights;     // (3·terms + 3 × rows)
  MatrixXd covariance;  // of the parameters, for noise of variance 1
  MatrixXd basis;       // (rows × parameters of the model), orthonormal
  MatrixXd further;     // the fundamental times further polynomials, beside the basis: cosines, then sines, orthonormal
  // For passes over stored samples: the basis transposed, and what tone_gain's weights have beside it; parameters =
  // of_sums (3·terms + 3 × outputs)·sums.
  std::optional<RowWeights> sums;
  RowMajor of_sums;
  // Weights of the places; polynomials p at each, (places × terms), and with these variances and covariance of the
  // cosine pᵀa and the sine pᵀb.
  Places shares;
  Eigen::Matrix<double, kPlaces, Eigen::Dynamic> polynomials;
  Places of_cosine, of_both, of_sine;
  double folding = 0;  // relative error of the tone by harmonics that are not told from it
  Flags flags = 0;

  [[nodiscard]] bool resolvable() const { return !(flags & flag::unresolvable); }
  [[nodiscard]] double freedom() const { return static_cast<double>(basis.rows() - basis.cols()); }
};

// Places are the eigenvalues of the recurrence of Legendre's polynomials (Golub and Welsch 1969).
void add_places(Plan& plan) {
  MatrixXd recurrence = MatrixXd::Zero(kPlaces, kPlaces);
  for (Index k = 1; k < recurrence.rows(); ++k)
    recurrence(k, k - 1) = recurrence(k - 1, k) =
        static_cast<double>(k) / std::sqrt(static_cast<double>(4 * k * k - 1));
  const EigenFactors of = symmetric_factors(recurrence);
  plan.shares = of.vectors.row(0).cwiseAbs2();
  plan.polynomials.resize(kPlaces, plan.terms);
  std::vector<double> polynomials(static_cast<std::size_t>(plan.terms));
  for (Index i = 0; i < of.values.size(); ++i) {
    legendre(of.values(i), polynomials);
    plan.polynomials.row(i) = Eigen::Map<const Eigen::RowVectorXd>(polynomials.data(), plan.terms);
  }
  const auto covariance = [&](Index a, Index b) -> Places {
    const MatrixXd block = plan.covariance.block(a * plan.terms, b * plan.terms, plan.terms, plan.terms);
    return plan.polynomials.cwiseProduct(plan.polynomials * block).rowwise().sum();
  };
  plan.of_cosine = covariance(1, 1), plan.of_both = covariance(1, 2), plan.of_sine = covariance(2, 2);
}

// Twice as many polynomials as places, or those by which rows and cycles tell the tone from slow light and from its
// mirror image.
void add_further(Plan& plan, double cycles_per_row) {
  const Index rows = plan.basis.rows();
  const double slowest = std::abs(std::remainder(cycles_per_row, 1.0)), apart = std::min(slowest, 0.5 - slowest),
               terms = std::min(2.0 * kPlaces, 2 * apart * static_cast<double>(rows) - 1);
  const Index more = static_cast<Index>(terms) - plan.terms;
  if (more <= 0 || 2 * (plan.basis.cols() + 2 * more) > rows) return;
  const MatrixXd waves = tone_design(centred_rows(static_cast<std::size_t>(rows)), {{cycles_per_row}}, 0,
                                     static_cast<std::size_t>(terms) - 1);
  MatrixXd added(rows, 2 * more);
  added << waves.middleCols(1 + plan.terms, more), waves.rightCols(more);
  const OrthogonalFactors factors = orthogonal_factors(beside(plan.basis, added));
  plan.further = factors.basis * factors.triangle.diagonal().cwiseSign().asDiagonal();
}

void plan_sums(Plan& plan) {
  const Index parameters = plan.weights.rows(), terms = plan.basis.cols();
  const MatrixXd inside = product(plan.weights, plan.basis);
  const MatrixXd steady = plan.weights.bottomRows(3);
  const MatrixXd rest = steady - product(inside.bottomRows(3), plan.basis.transpose());
  const Index beside = rest.cwiseAbs().maxCoeff() > kEqual * steady.cwiseAbs().maxCoeff() ? 3 : 0;
  RowMajor outputs(terms + beside, plan.basis.rows());
  outputs << plan.basis.transpose(), rest.topRows(beside);
  plan.of_sums = RowMajor::Zero(parameters, terms + beside);
  plan.of_sums.leftCols(terms) = inside;
  plan.of_sums.bottomRightCorner(beside, beside).setIdentity();
  plan.sums.emplace(std::span(outputs.data(), static_cast<std::size_t>(outputs.size())),
                    static_cast<std::size_t>(outputs.rows()), static_cast<std::size_t>(outputs.cols()), 1,
                    kMostLimbs);  // energies are differences
}

// Harmonics above half the row rate are steady.
Plan make_plan(std::size_t rows, double cycles_per_row, int degree, const ToneGainOptions& options,
               double exposure_cycles) {
  auto shape_harmonics = options.waveform == WaveformShape::square ? square_wave_harmonics(cycles_per_row, options.duty)
                                                                   : std::vector<int>{1};
  const auto harmonics = usable_harmonics(shape_harmonics, rows, cycles_per_row, degree);
  Plan plan;
  plan.terms = degree + 1;
  if (harmonics.size() < shape_harmonics.size()) plan.flags |= flag::harmonics_dropped;
  if (cycles_per_row * static_cast<double>(rows) < 1 + degree / 2.0) plan.flags |= flag::few_cycles;
  std::vector<double> frequencies, folded;
  for (const int h : harmonics) frequencies.push_back(h * cycles_per_row);
  if (options.waveform == WaveformShape::square) {
    const FoldedHarmonics above = folded_harmonics(rows, cycles_per_row, options.duty, exposure_cycles);
    plan.folding = above.error;
    for (const int h : above.orders) {
      shape_harmonics.push_back(h);
      folded.push_back(h * cycles_per_row);
    }
  }
  const auto powers = static_cast<std::size_t>(degree);
  const MatrixXd varying = tone_design(centred_rows(rows), frequencies, powers, powers),
                 steady_waves = tone_design(centred_rows(rows), folded).rightCols(2 * std::ssize(folded));
  MatrixXd design(varying.rows(), varying.cols() + steady_waves.cols());
  design << varying, steady_waves;
  LinearFit fit = linear_fit(design, 3 * plan.terms);
  if (design.rows() <= design.cols() || !std::isfinite(fit.condition)) {
    plan.flags |= flag::unresolvable;
    return plan;
  }
  if (fit.condition > kIllConditioned) plan.flags |= flag::ill_conditioned;
  plan.basis = std::move(fit.basis);

  const std::array<ModelTone, 1> tone{{{cycles_per_row, shape_harmonics}}};
  const HarmonicModel steady = harmonic_model(rows, tone);
  plan.weights.resize(3 * plan.terms + 3, design.rows());
  plan.weights << fit.weights.transpose(), steady.weights.transpose();
  plan.covariance = product(plan.weights, plan.weights.transpose());
  add_places(plan);
  add_further(plan, cycles_per_row);
  plan_sums(plan);
  return plan;
}

std::shared_ptr<const Plan> plan_of(std::size_t rows, double cycles_per_row, int degree, const ToneGainOptions& options,
                                    double exposure_cycles) {
  static RecentlyUsed<std::tuple<std::size_t, double, WaveformShape, double, int, double>, Plan, 4> kept;
  return kept.get({rows, cycles_per_row, options.waveform, options.duty, degree, exposure_cycles}, [&] {
    return std::make_shared<const Plan>(make_plan(rows, cycles_per_row, degree, options, exposure_cycles));
  });
}

// Mean of the tone's amplitude over the rows; `slope`: its derivatives by the parameters.
double mean_amplitude(const Plan& plan, const Vector& parameters, double noise, Vector& slope) {
  const Index terms = plan.terms;
  const Places cosine = plan.polynomials.lazyProduct(parameters.segment(terms, terms)),
               sine = plan.polynomials.lazyProduct(parameters.segment(2 * terms, terms)),
               square = cosine.square() + sine.square();
  // Bias of the length by noise across it, as in tone_gain.
  const Places across =
      noise * (sine * (sine * plan.of_cosine - 2 * cosine * plan.of_both) + cosine.square() * plan.of_sine) / square;
  const Places scale = (square > 0).select(plan.shares / square.sqrt(), 0.0);
  slope = Vector::Zero(parameters.size());
  slope.segment(terms, terms) = plan.polynomials.transpose().lazyProduct((scale * cosine).matrix());
  slope.segment(2 * terms, terms) = plan.polynomials.transpose().lazyProduct((scale * sine).matrix());
  return (square > 0).select(plan.shares * (square - across).max(0.0).sqrt(), 0.0).sum();
}

// slopeᵀ·covariance·slope
double quadratic(const MatrixXd& covariance, const Vector& slope) {
  return std::max(slope.dot(Vector(covariance.lazyProduct(slope))), 0.0);
}

// Writes the result of a column, whose flags are there. `steady_gain`, `steady_std`: those of tone_gain.
void judge(const Plan& plan, const Vector& parameters, double noise, double background, double ratio,
           double steady_gain, double steady_std, VaryingToneGain& result, std::size_t index) {
  const double mean = result.mean[index] = parameters(0) - background;
  Flags& flags = result.flags[index];
  if (!(mean > 0)) flags |= flag::no_light;
  if (flags & (flag::unresolvable | flag::no_light)) return;
  // In units of the mean: squares neither overflow nor vanish.
  const Vector relative = parameters / mean;
  const double relative_noise = std::sqrt(noise) / mean;
  const auto error = [&](const Vector& slope) {
    return relative_noise * std::sqrt(quadratic(plan.covariance, slope)) / ratio;
  };
  Vector slope;
  const double varying = mean_amplitude(plan, relative, relative_noise * relative_noise, slope);
  slope(0) -= varying;
  const double gain = varying / ratio, folding = plan.folding * gain, gain_std = std::hypot(error(slope), folding);

  const Index at = 3 * plan.terms;  // of tone_gain's parameters
  const double steady_mean = relative(at) - background / mean;
  const double amplitude = std::hypot(relative(at + 1), relative(at + 2));
  slope = -slope;
  if (amplitude > 0) slope.tail(2) += relative.tail(2) / (amplitude * steady_mean);
  slope(at) -= amplitude / (steady_mean * steady_mean);
  const double bias = steady_gain - gain, bias_std = std::hypot(error(slope), folding);
  if (gain < std::max(kWeak * gain_std, kEqual)) flags |= flag::weak;
  if (std::abs(bias) > std::max({kSure * bias_std, steady_std, kEqual})) flags |= flag::model_misfit;
  result.gain[index] = gain;
  result.gain_std[index] = gain_std;
  result.bias[index] = bias;
  result.bias_std[index] = bias_std;
}

// True if the model leaves more of a column's tone, a quarter of a cycle off its phase, than noise, and as much as
// would raise the gain by more than its standard error and a tenth, which a picture's content may: it is out of step by
// more than the terms follow. `squares`: all that is left; `unit`: amplitude of gain 1.
bool is_out_of_step(const Plan& plan, std::span<const double> column, const Vector& parameters, double squares,
                    double unit, double gain, double gain_std) {
  const Index more = plan.further.cols() / 2;
  if (more == 0) return false;
  const Eigen::VectorXd sums = transposed_product(plan.further, vector_of(column));
  const double cosine = parameters(plan.terms), sine = parameters(2 * plan.terms),
               noise = (squares - sums.squaredNorm()) / (plan.freedom() - static_cast<double>(2 * more)),
               across = (cosine * sums.tail(more) - sine * sums.head(more)).norm() / std::hypot(cosine, sine),
               missing = std::sqrt(2 / static_cast<double>(column.size())) * across / unit;
  return across * across > chance_energy(static_cast<std::size_t>(more)) * noise &&
         std::hypot(gain, missing) > gain + std::max({gain_std, kSmallShare * gain, kEqual});
}

// Parameters (3·terms + 3 × columns) and squares of what is left of the columns.
struct Fitted {
  RowMajor parameters;
  std::vector<double> squares;
};

// From the light of the columns from `from` on: the rest itself is squared.
void fit_light(const Plan& plan, const AnyFramesView& frames, std::size_t frame, std::size_t from,
               const ToneCurve& curve, Fitted& fitted) {
  for_each_part(fitted.squares.size(), kColumnsInCache, [&](IndexRange part) {
    const auto signals = column_signals(frames, frame, from + part.begin, part.size(), curve);
    const Eigen::Map<const MatrixXd> light(signals.data(), plan.basis.rows(), static_cast<Index>(part.size()));
    const MatrixXd rest = beside(plan.basis, light);
    fitted.parameters.middleCols(static_cast<Index>(part.begin), light.cols()) = product(plan.weights, light);
    Eigen::Map<Eigen::RowVectorXd>(&fitted.squares[part.begin], light.cols()) = rest.colwise().squaredNorm();
  });
}

// The same in one pass over the stored samples, by differences of squares; false where these have too few digits.
bool fit_stored(const Plan& plan, const AnyFramesView& frames, std::size_t frame, std::size_t from, double dark,
                Fitted& fitted) {
  const std::size_t count = fitted.squares.size();
  thread_local Projection sums;  // reused from call to call
  project(frames, frame, from, count, *plan.sums, {}, sums);
  const auto outputs = plan.of_sums.cols(), terms = plan.basis.cols();
  const Eigen::Map<const RowMajor> all(sums.sums.data(), outputs, static_cast<Index>(count));
  fitted.parameters.noalias() = plan.of_sums.lazyProduct(all);
  for (const Index mean : {Index{0}, 3 * plan.terms}) fitted.parameters.row(mean).array() -= dark;
  const Eigen::Map<const Eigen::RowVectorXd> squares(sums.squares.data(), static_cast<Index>(count));
  Eigen::Map<Eigen::RowVectorXd> rest(fitted.squares.data(), squares.size());
  rest = squares - all.topRows(terms).colwise().squaredNorm();
  return (rest.array() >= kResolvedRest * squares.array()).all();
}

VaryingToneGain empty_result(std::size_t frames, std::size_t columns) {
  const std::vector<double> values(frames * columns, kNaN);
  return {frames, columns, values, values, values, values, values, std::vector<Flags>(frames * columns)};
}

}  // namespace

VaryingToneGain varying_tone_gain(const AnyFramesView& frames, const Camera& camera, double frequency, int degree,
                                  const ToneGainOptions& options) {
  require(degree >= 0 && degree <= 4, "degree", degree, "0 to 4");
  const std::array<double, 1> frequencies{frequency};
  const ToneGain steady =
      tone_gain(frames, camera, frequencies,
                {GainMethod::fit, options.waveform, options.duty, options.background, 1.0, options.threads, false});
  const Shape shape = shape_of(frames);
  VaryingToneGain result = empty_result(shape.frames, shape.columns);
  const bool is_square = options.waveform == WaveformShape::square;  // a tone has one plan for all exposures
  const auto kept_plan = plan_of(shape.rows, frequency * camera.row_time, degree, options,
                                 is_square ? frequency * camera.exposure.value_or(camera.row_time) : 0);
  const Plan& plan = *kept_plan;
  if (!plan.resolvable()) {
    for (std::size_t i = 0; i < result.flags.size(); ++i) result.flags[i] = steady.flags[i] | plan.flags;
    return result;
  }
  const double ratio = full_depth_ratio(options.waveform, options.duty);
  const auto& background = options.background;
  const std::size_t blocks = (shape.columns + kernels::kColumnsAtOnce - 1) / kernels::kColumnsAtOnce;
  for_each_block(shape.frames * blocks, options.threads, [&](std::size_t block) {
    const std::size_t frame = block / blocks;
    const std::size_t first = block % blocks * kernels::kColumnsAtOnce;
    const std::size_t count = std::min(kernels::kColumnsAtOnce, shape.columns - first);
    Fitted fitted{RowMajor(plan.weights.rows(), static_cast<Index>(count)), std::vector<double>(count)};
    const ToneCurve& curve = camera.tone_curve;
    if (curve.kind != ToneCurve::Kind::linear || !fit_stored(plan, frames, frame, first, curve.dark_level, fitted))
      fit_light(plan, frames, frame, first, curve, fitted);
    const std::size_t start = frame * shape.columns + first;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t index = start + i;
      const double ambient = background.empty() ? 0 : background.size() == 1 ? background[0] : background[index];
      const double noise = fitted.squares[i] / plan.freedom();
      result.flags[index] = (steady.flags[index] & ~flag::weak) | plan.flags;
      judge(plan, fitted.parameters.col(static_cast<Index>(i)), noise, ambient, ratio, steady.gain[index],
            steady.gain_std[index], result, index);
    }
    const auto is_misfit = [&](std::size_t i) {
      return is_out_of_step(plan, column_signals(frames, frame, first + i, 1, curve),
                            fitted.parameters.col(static_cast<Index>(i)), fitted.squares[i],
                            result.mean[start + i] * ratio, result.gain[start + i], result.gain_std[start + i]);
    };
    // The strongest tone tells whether the others are looked at.
    const auto level = [&](std::size_t i) { return std::fmax(result.gain[start + i] * result.mean[start + i], 0); };
    std::size_t strongest = 0;
    for (std::size_t i = 1; i < count; ++i)
      if (level(i) > level(strongest)) strongest = i;
    if (is_misfit(strongest))
      for (std::size_t i = 0; i < count; ++i) result.flags[start + i] |= flag_if(is_misfit(i), flag::model_misfit);
  });
  return result;
}

}  // namespace ocisac
