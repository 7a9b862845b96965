#include "ocisac/tones/varying_tone.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "columns/equalizer_kernels.hpp"
#include "columns/light_rows.hpp"
#include "core/legendre.hpp"
#include "core/linear_algebra.hpp"
#include "core/parallel.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"
#include "tones/design_matrix.hpp"
#include "tones/harmonic_model.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
// Of one column, at most 3·5 + 3: on the stack.
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 18, 1>;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kIllConditioned = 1e6;
constexpr double kSure = 4;                   // standard errors above which a bias is significant
constexpr double kWeak = 3;                   // standard errors
constexpr double kRounding = 1e-9;            // gains below it are rounding
constexpr std::size_t kColumnsPerBlock = 32;  // the light and what is left of it fit the second-level cache

// Gauss–Legendre nodes along the rows, −1 to 1, and weights for the mean of the tone's amplitude.
struct Place {
  double x, share;
};
constexpr std::array<Place, 8> kPlaces{{{-0.9602898564975363, 0.0506142681451881},
                                        {-0.7966664774136267, 0.1111905172266872},
                                        {-0.5255324099163290, 0.1568533229389436},
                                        {-0.1834346424956498, 0.1813418916891810},
                                        {0.1834346424956498, 0.1813418916891810},
                                        {0.5255324099163290, 0.1568533229389436},
                                        {0.7966664774136267, 0.1111905172266872},
                                        {0.9602898564975363, 0.0506142681451881}}};

// Legendre polynomials of degrees 0 to `degree` at the places: (places × terms).
MatrixXd legendre_at_places(int degree) {
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> values(kPlaces.size(), degree + 1);
  for (Index i = 0; i < values.rows(); ++i)
    legendre(kPlaces[static_cast<std::size_t>(i)].x, {values.row(i).data(), static_cast<std::size_t>(values.cols())});
  return values;
}

// Polynomials alone, then times cosine and sine of each harmonic: (rows × terms·(1 + 2·harmonics)).
MatrixXd varying_design(std::size_t rows, double cycles_per_row, const std::vector<int>& harmonics, int degree) {
  const auto polynomials = static_cast<std::size_t>(degree);
  ToneDesign design{rows, {}, polynomials, polynomials};
  for (const int h : harmonics) design.cycles_per_row.push_back(h * cycles_per_row);
  return design_matrix(design);
}

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
  MatrixXd weights;        // (3·terms + 3 × rows)
  MatrixXd covariance;     // of the parameters, for noise of variance 1
  MatrixXd of_tone;        // the same of the cosine and the sine alone
  MatrixXd basis;          // (rows × parameters of the model), orthonormal
  RowMajor projections;    // (3·terms + 3 + parameters of the model × rows) weights, then the basis transposed
  RowMajor basis_by_rows;  // the basis
  MatrixXd polynomials;    // (places × terms)
  Flags flags = 0;

  [[nodiscard]] bool resolvable() const { return !(flags & flag::unresolvable); }
  [[nodiscard]] double freedom() const { return static_cast<double>(basis.rows() - basis.cols()); }
};

Plan make_plan(std::size_t rows, double cycles_per_row, const VaryingToneOptions& options) {
  const auto shape_harmonics = options.waveform == WaveformShape::square
                                   ? square_wave_harmonics(cycles_per_row, options.duty)
                                   : std::vector<int>{1};
  const auto harmonics = usable_harmonics(shape_harmonics, rows, cycles_per_row, options.degree);
  Plan plan;
  plan.terms = options.degree + 1;
  if (harmonics.size() < shape_harmonics.size()) plan.flags |= flag::harmonics_dropped;
  if (cycles_per_row * static_cast<double>(rows) < 1 + options.degree / 2.0) plan.flags |= flag::few_cycles;
  const MatrixXd design = varying_design(rows, cycles_per_row, harmonics, options.degree);
  OrthogonalFactors factors = pivoted_orthogonal_factors(design);
  if (design.rows() <= design.cols() || factors.rank() < design.cols()) {
    plan.flags |= flag::unresolvable;
    return plan;
  }
  const MatrixXd& triangle = factors.triangle;
  if (std::abs(triangle(0, 0)) > kIllConditioned * std::abs(triangle(design.cols() - 1, design.cols() - 1)))
    plan.flags |= flag::ill_conditioned;
  plan.basis = std::move(factors.basis);
  const MatrixXd pivoted = solve_upper(triangle, plan.basis.transpose());
  MatrixXd solved(pivoted.rows(), pivoted.cols());
  for (Index j = 0; j < solved.rows(); ++j) solved.row(factors.order[static_cast<std::size_t>(j)]) = pivoted.row(j);

  const std::array<ModelTone, 1> tone{{{cycles_per_row, shape_harmonics}}};
  const HarmonicModel steady = harmonic_model(rows, tone);
  plan.weights.resize(3 * plan.terms + 3, design.rows());
  plan.weights << solved.topRows(3 * plan.terms),
      Eigen::Map<const Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor>>(steady.weights.data(), 3,
                                                                                  design.rows());
  plan.covariance = product(plan.weights, plan.weights.transpose());
  plan.of_tone = plan.covariance.block(plan.terms, plan.terms, 2 * plan.terms, 2 * plan.terms);
  plan.projections.resize(plan.weights.rows() + plan.basis.cols(), design.rows());
  plan.projections << plan.weights, plan.basis.transpose();
  plan.basis_by_rows = plan.basis;
  plan.polynomials = legendre_at_places(options.degree);
  return plan;
}

// Mean of the tone's amplitude over the rows, and its derivatives by the parameters.
struct Amplitude {
  double value = 0;
  Vector slope;
};

Amplitude mean_amplitude(const Plan& plan, const Vector& parameters, double noise) {
  const Index terms = plan.terms;
  Amplitude amplitude{0, Vector::Zero(parameters.size())};
  for (std::size_t i = 0; i < kPlaces.size(); ++i) {
    const Vector polynomials = plan.polynomials.row(static_cast<Index>(i)).transpose();
    const double cosine = polynomials.dot(parameters.segment(terms, terms));
    const double sine = polynomials.dot(parameters.segment(2 * terms, terms));
    const double length = std::hypot(cosine, sine);
    if (!(length > 0)) continue;
    Vector across(2 * terms);
    across << -sine / length * polynomials, cosine / length * polynomials;
    // Bias of the length by noise, as in tone_gain.
    const double tangential = noise * across.dot(Vector(plan.of_tone * across));
    amplitude.value += kPlaces[i].share * std::sqrt(std::max(length * length - tangential, 0.0));
    amplitude.slope.segment(terms, terms) += kPlaces[i].share * cosine / length * polynomials;
    amplitude.slope.segment(2 * terms, terms) += kPlaces[i].share * sine / length * polynomials;
  }
  return amplitude;
}

// Derivatives of amplitude/mean by the parameters, where `mean` is parameter `index_of_mean`.
Vector contrast_slope(const Amplitude& amplitude, double mean, Index index_of_mean) {
  Vector slope = amplitude.slope / mean;
  slope(index_of_mean) -= amplitude.value / (mean * mean);
  return slope;
}

struct Column {
  double gain, gain_std, mean, bias, bias_std;
  Flags flags;
};

// `steady_gain`, `steady_std`, `flags`: those of tone_gain.
Column judge(const Plan& plan, const Vector& parameters, double noise, double background, double ratio,
             double steady_gain, double steady_std, Flags flags) {
  const double mean = parameters(0) - background;
  if (!(mean > 0)) flags |= flag::no_light;
  if (flags & (flag::unresolvable | flag::no_light)) return {kNaN, kNaN, mean, kNaN, kNaN, flags};
  const auto error = [&](const Vector& slope) {
    return std::sqrt(std::max(noise * slope.dot(Vector(plan.covariance * slope)), 0.0)) / ratio;
  };
  const Amplitude varying = mean_amplitude(plan, parameters, noise);
  const Vector slope = contrast_slope(varying, mean, 0);
  const double gain = varying.value / mean / ratio;
  const double gain_std = error(slope);

  const Index at = 3 * plan.terms;  // of tone_gain's parameters
  const double steady_mean = parameters(at) - background;
  Amplitude steady{std::hypot(parameters(at + 1), parameters(at + 2)), Vector::Zero(parameters.size())};
  if (steady.value > 0) steady.slope.tail(2) = parameters.tail(2) / steady.value;
  const double bias = steady_gain - gain;
  const double bias_std = error(contrast_slope(steady, steady_mean, at) - slope);
  if (gain < std::max(kWeak * gain_std, kRounding)) flags |= flag::weak;
  if (std::abs(bias) > std::max({kSure * bias_std, steady_std, kRounding})) flags |= flag::model_misfit;
  return {gain, gain_std, mean, bias, bias_std, flags};
}

// Memory of a thread, reused from call to call: light (rows × width) and what is left of it; parameters, then
// coordinates in the basis (projections × width); sums of squares (width).
struct Memory {
  std::vector<double> light, rest, projections, squares;
};

// Parameters and noise of `count` columns, in the lanes of `memory`.
void fit_block(const Plan& plan, std::size_t width, Memory& memory) {
  const auto rows = static_cast<std::size_t>(plan.basis.rows()), terms = static_cast<std::size_t>(plan.basis.cols());
  const auto parameters = static_cast<std::size_t>(plan.weights.rows());
  const auto stride = static_cast<std::ptrdiff_t>(width);
  memory.projections.resize((parameters + terms) * width);
  memory.rest.resize(rows * width);
  memory.squares.assign(width, 0.0);
  kernels::matrix_times_rows(plan.projections.data(), parameters + terms, rows, memory.light.data(), stride,
                             memory.projections.data(), stride, width);
  kernels::matrix_times_rows(plan.basis_by_rows.data(), rows, terms, &memory.projections[parameters * width], stride,
                             memory.rest.data(), stride, width);
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t c = 0; c < width; ++c) {
      const double left = memory.light[n * width + c] - memory.rest[n * width + c];
      memory.squares[c] += left * left;
    }
}

VaryingToneGain empty_result(std::size_t frames, std::size_t columns) {
  const std::vector<double> values(frames * columns, kNaN);
  return {frames, columns, values, values, values, values, values, std::vector<Flags>(frames * columns)};
}

}  // namespace

VaryingToneGain varying_tone_gain(const AnyFramesView& frames, const Camera& camera, double frequency,
                                  const VaryingToneOptions& options) {
  require(options.degree >= 0 && options.degree <= 4, "degree", options.degree, "0 to 4");
  const std::array<double, 1> frequencies{frequency};
  const ToneGain steady =
      tone_gain(frames, camera, frequencies,
                {GainMethod::fit, options.waveform, options.duty, options.background, 1.0, options.threads, false});
  const Shape shape = shape_of(frames);
  VaryingToneGain result = empty_result(shape.frames, shape.columns);
  const Plan plan = make_plan(shape.rows, frequency * camera.row_time, options);
  if (!plan.resolvable()) {
    for (std::size_t i = 0; i < result.flags.size(); ++i) result.flags[i] = steady.flags[i] | plan.flags;
    return result;
  }
  const double ratio = full_depth_ratio(options.waveform, options.duty);
  const auto& background = options.background;
  const std::size_t blocks = (shape.columns + kColumnsPerBlock - 1) / kColumnsPerBlock;
  for_each_block(shape.frames * blocks, options.threads, [&](std::size_t block) {
    const std::size_t frame = block / blocks;
    const std::size_t first = block % blocks * kColumnsPerBlock;
    const std::size_t count = std::min(kColumnsPerBlock, shape.columns - first);
    const std::size_t width =
        (count + kernels::kBlockAlignment - 1) / kernels::kBlockAlignment * kernels::kBlockAlignment;
    thread_local Memory memory;
    memory.light.resize(shape.rows * width);
    light_rows(frames, frame, first, count, camera.tone_curve, width, memory.light.data());
    fit_block(plan, width, memory);
    const Eigen::Map<const RowMajor> parameters(memory.projections.data(), plan.weights.rows(),
                                                static_cast<Index>(width));
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t index = frame * shape.columns + first + i;
      const double ambient = background.empty() ? 0 : background.size() == 1 ? background[0] : background[index];
      const double noise = memory.squares[i] / plan.freedom();
      const Flags flags = (steady.flags[index] & ~flag::weak) | plan.flags;
      const Column judged = judge(plan, parameters.col(static_cast<Index>(i)), noise, ambient, ratio,
                                  steady.gain[index], steady.gain_std[index], flags);
      result.gain[index] = judged.gain;
      result.gain_std[index] = judged.gain_std;
      result.mean[index] = judged.mean;
      result.bias[index] = judged.bias;
      result.bias_std[index] = judged.bias_std;
      result.flags[index] = judged.flags;
    }
  });
  return result;
}

}  // namespace ocisac
