#include "estimation/streaming_fit.hpp"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <type_traits>

#include "ocisac/estimation/harmonic_model.hpp"

namespace ocisac {

namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

HarmonicModel fundamentals_only(std::size_t rows, std::span<const double> cycles_per_row, double factor) {
  std::vector<ModelTone> tones;
  for (const double cycles : cycles_per_row) tones.push_back({cycles * factor, {1}});
  return harmonic_model(rows, tones);
}

// Amplitude that a tone keeps when `row_group` rows are averaged.
double group_gain(double cycles_per_row, int row_group) {
  if (row_group == 1) return 1;
  return std::sin(std::numbers::pi * cycles_per_row * row_group) /
         (row_group * std::sin(std::numbers::pi * cycles_per_row));
}

double tone_of(std::size_t estimate, std::span<const double> per_tone, double for_mean) {
  return estimate == 0 ? for_mean : per_tone[(estimate - 1) / 2];
}

std::vector<double> dense(const RowMajor& matrix) { return {matrix.data(), matrix.data() + matrix.size()}; }

Eigen::Map<const RowMajor> square_matrix(const std::vector<double>& values, std::size_t size) {
  return {values.data(), static_cast<Eigen::Index>(size), static_cast<Eigen::Index>(size)};
}

}  // namespace

// The fit of sums of `row_group` rows, in terms of the rows.
struct StreamingFit::Candidate {
  int row_group;
  std::size_t estimates;
  RowMajor weights;     // (estimates × groups), of sums
  RowMajor design;      // (groups × estimates), of sums
  RowMajor covariance;  // for rows with noise of variance 1
};

StreamingFit::Candidate StreamingFit::candidate(std::size_t rows, std::span<const double> cycles_per_row,
                                                int row_group) {
  const std::size_t groups = rows / static_cast<std::size_t>(row_group);
  const HarmonicModel model = fundamentals_only(groups, cycles_per_row, row_group);
  std::vector<double> gains;
  for (const double cycles : cycles_per_row) gains.push_back(group_gain(cycles, row_group));
  const auto size = static_cast<Eigen::Index>(model.estimates);
  Candidate result{row_group, model.estimates, RowMajor(size, static_cast<Eigen::Index>(groups)),
                   RowMajor(static_cast<Eigen::Index>(groups), size), RowMajor(size, size)};
  for (Eigen::Index i = 0; i < size; ++i) {
    const auto estimate = static_cast<std::size_t>(i);
    const double scale = row_group * tone_of(estimate, gains, 1);
    const double cycles = row_group * tone_of(estimate, cycles_per_row, 0);
    for (Eigen::Index j = 0; j < static_cast<Eigen::Index>(groups); ++j) {
      const Phasor at = phasor(cycles, static_cast<double>(j) - (static_cast<double>(groups) - 1) / 2);
      result.weights(i, j) = model.weights[estimate * groups + static_cast<std::size_t>(j)] / scale;
      result.design(j, i) = scale * (i == 0 || i % 2 == 1 ? at.cosine : at.sine);
    }
    for (Eigen::Index k = 0; k < size; ++k)
      result.covariance(i, k) = model.covariance[estimate * model.estimates + static_cast<std::size_t>(k)] * row_group /
                                (scale * row_group * tone_of(static_cast<std::size_t>(k), gains, 1));
  }
  return result;
}

namespace {

// Whether the sums keep the share of every tone's information, and do not fold a tone.
bool keeps(double efficiency, const RowMajor& all_rows, const RowMajor& sums, std::span<const double> cycles_per_row,
           int row_group) {
  for (std::size_t k = 0; k < cycles_per_row.size(); ++k) {
    const auto a = static_cast<Eigen::Index>(2 * k + 1);
    const double before = all_rows(a, a) + all_rows(a + 1, a + 1);
    const double after = sums(a, a) + sums(a + 1, a + 1);
    if (cycles_per_row[k] * row_group >= 0.5 || !(before >= efficiency * after)) return false;
  }
  return true;
}

}  // namespace

StreamingFit::StreamingFit(std::size_t rows, std::span<const double> cycles_per_row, double efficiency)
    : estimates_(1 + 2 * cycles_per_row.size()),
      flags_(fundamentals_only(rows, cycles_per_row, 1).tone_flags),
      weights_(std::vector<double>(rows), 1, rows, 1, 1) {
  const Candidate all_rows = candidate(rows, cycles_per_row, 1);
  std::optional<Candidate> chosen;
  for (const int row_group : {8, 4, 2}) {
    if (rows / static_cast<std::size_t>(row_group) <= 2 * estimates_) continue;
    Candidate sums = candidate(rows, cycles_per_row, row_group);
    if (!keeps(efficiency, all_rows.covariance, sums.covariance, cycles_per_row, row_group)) continue;
    chosen = std::move(sums);
    break;
  }
  const Candidate& plan = chosen ? *chosen : all_rows;
  const auto groups = static_cast<std::size_t>(plan.design.rows());
  const auto group = static_cast<std::size_t>(plan.row_group);
  middle_ = (static_cast<double>(groups * group) - 1) / 2;
  freedom_ = (static_cast<double>(groups) - static_cast<double>(std::min(estimates_, groups))) * plan.row_group;
  covariance_ = dense(plan.covariance);
  gram_ = dense(plan.design.transpose() * plan.design);
  weights_ = RowWeights(dense(plan.weights), estimates_, rows, plan.row_group, 1);
  const auto rounded = weights_.byte_weights();
  const Eigen::Map<const RowMajor> integers(rounded.data(), plan.weights.rows(), plan.weights.cols());
  unbias_ = dense((integers * plan.design).inverse());
}

StreamingFit::Columns StreamingFit::estimate(const AnyFramesView& frames, std::size_t frame, std::size_t first,
                                             std::size_t count) const {
  Projection projection = project(frames, frame, first, count, weights_);
  Columns columns{std::move(projection.sums), std::vector<double>(count), std::move(projection.maximum)};
  const auto size = static_cast<Eigen::Index>(estimates_);
  Eigen::Map<RowMajor> parameters(columns.parameters.data(), size, static_cast<Eigen::Index>(count));
  if (std::holds_alternative<FramesView<const std::uint8_t>>(frames))
    parameters = (square_matrix(unbias_, estimates_) * parameters).eval();
  const RowMajor explained = square_matrix(gram_, estimates_) * parameters;
  for (std::size_t c = 0; c < count; ++c) {
    const auto column = static_cast<Eigen::Index>(c);
    const double rest = projection.squares[c] - parameters.col(column).dot(explained.col(column));
    columns.noise_variance[c] = std::max(rest, 0.0) / freedom_;
  }
  return columns;
}

}  // namespace ocisac
