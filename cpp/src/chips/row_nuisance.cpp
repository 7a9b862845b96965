#include "ocisac/chips/row_nuisance.hpp"

#include <algorithm>
#include <cmath>

#include "core/levels.hpp"
#include "ocisac/core/require.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kMaxSlowTerms = 160;  // a frame of 0.3 s at 260 Hz; the time grows with the square
constexpr std::size_t kSwingDegree = 2;

std::size_t slow_terms(std::size_t rows, const RowNuisance& nuisance) {
  return static_cast<std::size_t>(std::min(std::ceil(2 * static_cast<double>(rows) * nuisance.slow), kMaxSlowTerms));
}

// The harmonics 1 … `most` of a tone below half a cycle per row, in cycles per row.
std::vector<double> harmonics_of(double tone, std::size_t most) {
  std::vector<double> frequencies;
  for (std::size_t order = 1; order <= most && static_cast<double>(order) * tone < 0.5; ++order)
    frequencies.push_back(static_cast<double>(order) * tone);
  return frequencies;
}

// By how much each tone is too low for the least residual, cycles per row: one Gauss–Newton step with all else
// refitted.
void find_tone_steps(const RowSampling& rows, const ConstMatrix& model, const NormalSolution& solved,
                     const VectorXd& left, const RowNuisance& nuisance, Index first_tone, NuisanceFit& fit) {
  double squares = 0;
  for (const double tone : nuisance.tones) {
    const auto terms = 2 * std::ssize(harmonics_of(tone, tone_harmonics(nuisance)));
    const VectorXd slope =
        frequency_slope(rows, model.middleCols(first_tone, terms), solved.values.segment(first_tone, terms));
    first_tone += terms;
    const VectorXd shared = model.transpose() * slope;
    const double own = slope.squaredNorm() - shared.dot(solved.inverse * shared);
    fit.tone_steps.push_back(own > kEqual * slope.squaredNorm() ? slope.dot(left) / own : 0.0);
    squares += std::pow(fit.tone_steps.back(), 2) * slope.squaredNorm();
  }
  fit.moved_by_steps = std::sqrt(squares / static_cast<double>(model.rows()));
}

// A square wave of ±½ and duty ½, exposed for a part of its cycle about `cycles`: a trapezoid.
double exposed_square(double cycles, double exposure) {
  const auto integral = [](double at) {
    const double part = at - std::floor(at);
    return 0.5 * std::min(part, 1 - part);
  };
  if (exposure <= kEqual) return cycles - std::floor(cycles) < 0.5 ? 0.5 : -0.5;
  return (integral(cycles + 0.5 * exposure) - integral(cycles - 0.5 * exposure)) / exposure;
}

}  // namespace

std::optional<NuisanceFit> remove_nuisance(std::span<const double> signal, const RowNuisance& nuisance,
                                           std::span<const double> exposed) {
  const std::size_t scaled = nuisance.scale.size();
  require(scaled == 0 || scaled == signal.size(), "scale", scaled, "a value for each row");
  RowSampling rows = centred_rows(signal.size());
  std::vector<double> basis;  // columns: the constant, slow light, tones from first_tone on, others, the swing
  append_trend(basis, rows, 0);
  rows.weights = nuisance.scale;
  append_slow_light(basis, rows, slow_terms(signal.size(), nuisance));
  const Index first_tone = matrix_of(basis, rows).cols();
  for (const double tone : nuisance.tones)
    append_tones(basis, rows, harmonics_of(tone, exposed.empty() ? nuisance.harmonics : tone_harmonics(nuisance)));
  rows.weights.clear();
  if (!nuisance.before.empty()) append_course(basis, rows, nuisance.before, 0);
  const Index others = matrix_of(basis, rows).cols();
  if (!exposed.empty()) append_course(basis, rows, exposed, kSwingDegree);
  const auto model = matrix_of(basis, rows);
  if (model.rows() <= model.cols()) return std::nullopt;
  const Eigen::Map<const VectorXd> values(signal.data(), model.rows());
  const auto solved = solve_normal(gram(model.transpose()), model.transpose() * values);
  if (!solved) return std::nullopt;
  const VectorXd rest = values - model.middleCols(1, others - 1) * solved->values.segment(1, others - 1);
  const Index swings = model.cols() - others;
  VectorXd left = rest.array() - solved->values[0];
  left -= model.rightCols(swings) * solved->values.tail(swings);
  NuisanceFit fit{.rest = {rest.begin(), rest.end()},
                  .residual_energy = left.squaredNorm(),
                  .unknowns = static_cast<std::size_t>(others - 1)};
  if (swings > 0) find_tone_steps(rows, model, *solved, left, nuisance, first_tone, fit);
  return fit;
}

std::vector<double> without_square_wave(std::span<const double> signal, double frequency, double exposure_rows) {
  const RowSampling rows = centred_rows(signal.size());
  const Eigen::Map<const VectorXd> given(signal.data(), static_cast<Index>(signal.size()));
  const VectorXd values = given.array() - given.mean();
  const Eigen::MatrixXd constant = Eigen::MatrixXd::Constant(values.size(), 1, 1 / std::sqrt(values.size()));
  const FrequencyFit tone = refine_frequencies(rows, {frequency}, constant, values);
  const double found = tone.frequencies[0];
  const double phase = std::atan2(tone.amplitudes(0), tone.amplitudes(1)) / kTwoPi;  // cycles
  VectorXd wave(values.size());
  for (Index n = 0; n < wave.size(); ++n)
    wave(n) = exposed_square(found * rows.times[static_cast<std::size_t>(n)] + phase, found * exposure_rows);
  const VectorXd rest = given - wave * coefficients_of(beside(constant, wave), values);
  return {rest.begin(), rest.end()};
}

}  // namespace ocisac
