#include "tones/streaming_fit.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

#include "columns/row_kernels.hpp"
#include "core/recently_used.hpp"
#include "rows/fit.hpp"
#include "tones/gain_kernel.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kFewRows = 256;  // fewer rows use 3 limbs, at little cost

// Amplitude gain of averaging `row_group` rows.
double group_gain(double cycles_per_row, int row_group) {
  if (row_group == 1) return 1;
  return std::sin(std::numbers::pi * cycles_per_row * row_group) /
         (row_group * std::sin(std::numbers::pi * cycles_per_row));
}

// Factors from estimates for the rows to those for sums of `row_group` of them.
Eigen::VectorXd scale_of(std::span<const double> cycles_per_row, int row_group) {
  Eigen::VectorXd scale(1 + 2 * std::ssize(cycles_per_row));
  scale(0) = row_group;
  Eigen::Index place = 1;
  for (const double cycles : cycles_per_row) {
    scale.segment(place, 2).setConstant(row_group * group_gain(cycles, row_group));
    place += 2;
  }
  return scale;
}

// The fit of sums of `row_group` rows: weights of sums, estimates for the rows, covariance for their noise.
HarmonicModel model_of_sums(std::size_t rows, std::span<const double> cycles_per_row, int row_group) {
  std::vector<ModelTone> tones;
  for (const double cycles : cycles_per_row) tones.push_back({cycles * row_group, {1}});
  HarmonicModel model = harmonic_model(rows / static_cast<std::size_t>(row_group), tones);
  const Eigen::VectorXd inverse = scale_of(cycles_per_row, row_group).cwiseInverse();
  model.middle = (static_cast<double>(model.rows * static_cast<std::size_t>(row_group)) - 1) / 2;
  model.weights = model.weights * inverse.asDiagonal();
  model.covariance = row_group * (inverse.asDiagonal() * model.covariance * inverse.asDiagonal());
  return model;
}

// True if the sums preserve the required fraction of every tone's information.
bool keeps(double efficiency, const Eigen::MatrixXd& all_rows, const Eigen::MatrixXd& sums) {
  for (Eigen::Index a = 1; a < sums.rows(); a += 2) {
    const double before = all_rows(a, a) + all_rows(a + 1, a + 1);
    const double after = sums(a, a) + sums(a + 1, a + 1);
    if (!(before >= efficiency * after)) return false;
  }
  return true;
}

}  // namespace

StreamingFit::StreamingFit(std::size_t rows, std::span<const double> cycles_per_row, double efficiency, int most_rows,
                           int limbs)
    : estimates_(1 + 2 * cycles_per_row.size()), weights_(std::vector<double>(rows), 1, rows, 1, 1) {
  if (rows <= 2 * estimates_) return;
  model_ = model_of_sums(rows, cycles_per_row, 1);
  well_posed_ = std::ranges::all_of(model_.tone_flags, is_well_posed);
  if (!well_posed_) return;
  int row_group = 1;
  for (const int more : {8, 4, 2}) {
    if (row_group > 1 || more > most_rows || efficiency == 1) continue;
    if (rows / static_cast<std::size_t>(more) <= 2 * estimates_) continue;
    HarmonicModel sums = model_of_sums(rows, cycles_per_row, more);
    if (!keeps(efficiency, model_.covariance, sums.covariance)) continue;
    sums.tone_flags = model_.tone_flags;
    model_ = std::move(sums);
    row_group = more;
  }
  const bool few = efficiency == 1 && rows < kFewRows;
  adopt(rows, cycles_per_row, row_group, row_group > 1 ? 1 : few ? kMostLimbs : limbs);
}

void StreamingFit::adopt(std::size_t rows, std::span<const double> cycles_per_row, int row_group, int limbs) {
  const Eigen::Index groups = model_.weights.rows(), tones = model_.weights.cols() - 1;
  std::vector<double> of_groups;
  for (const double cycles : cycles_per_row) of_groups.push_back(row_group * cycles);
  const Eigen::MatrixXd design =
      tone_design(centred_rows(model_.rows), of_groups) * scale_of(cycles_per_row, row_group).asDiagonal();
  freedom_ = static_cast<double>(groups - tones - 1) * row_group;
  gram_ = transposed_product(design, design);
  // The mean's weights are omitted: with those of the tones, the plain sum spans the same estimates.
  weights_ = RowWeights({model_.weights.col(1).data(), static_cast<std::size_t>(tones * groups)}, estimates_ - 1, rows,
                        row_group, limbs);
  const auto transform = [&](std::span<const double> of_tones) {
    Eigen::MatrixXd all = Eigen::MatrixXd::Ones(groups, tones + 1);
    all.rightCols(tones) = Eigen::Map<const Eigen::MatrixXd>(of_tones.data(), groups, tones);
    return inverse(transposed_product(all, design));
  };
  of_samples_ = transform(weights_.weights());
  of_bytes_ = transform(weights_.byte_weights());
}

namespace {

// Rows that are added up at most. One tone in bytes comes from memory as fast with fewer: 1 with AVX-512, where two
// threads are faster, and 2 with AVX2 where strips come late (bench/README.md).
int most_rows_added(std::size_t tones, bool bytes) {
  if (!bytes || tones > 1) return 8;
  if (kernels::has_wide_vectors()) return 1;
  return kernels::strips_come_late() ? 2 : 8;
}

}  // namespace

std::shared_ptr<const StreamingFit> StreamingFit::plan(std::size_t rows, const std::vector<double>& cycles_per_row,
                                                       double efficiency, bool bytes, int limbs) {
  static RecentlyUsed<std::tuple<std::size_t, double, int, int, std::vector<double>>, StreamingFit, 32> kept;
  const int most_rows = most_rows_added(cycles_per_row.size(), bytes);
  return kept.get({rows, efficiency, most_rows, limbs, cycles_per_row}, [&] {
    return std::make_shared<const StreamingFit>(rows, cycles_per_row, efficiency, most_rows, limbs);
  });
}

void StreamingFit::estimate(const Projection& sums, bool bytes, std::size_t first, std::size_t count,
                            Columns& to) const {
  to.parameters.resize(estimates_ * count);
  to.noise_variance.resize(count);
  kernels::parameters_of_sums({estimates_, count, sums.totals.size(), &sums.totals[first], &sums.sums[first],
                               &sums.squares[first], (bytes ? of_bytes_ : of_samples_).data(), gram_.data(), freedom_},
                              to.parameters.data(), to.noise_variance.data());
}

}  // namespace ocisac
