#include "tones/streaming_fit.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

#include "columns/row_kernels.hpp"
#include "core/recently_used.hpp"
#include "rows/fit.hpp"
#include "tones/gain_kernel.hpp"
#include "tones/harmonic_model.hpp"

namespace ocisac {

namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

HarmonicModel fundamentals_only(std::size_t rows, std::span<const double> cycles_per_row, double factor) {
  std::vector<ModelTone> tones;
  for (const double cycles : cycles_per_row) tones.push_back({cycles * factor, {1}});
  return harmonic_model(rows, tones);
}

constexpr std::size_t kFewRows = 256;  // fewer rows use 3 limbs, at little cost

// Amplitude gain of averaging `row_group` rows.
double group_gain(double cycles_per_row, int row_group) {
  if (row_group == 1) return 1;
  return std::sin(std::numbers::pi * cycles_per_row * row_group) /
         (row_group * std::sin(std::numbers::pi * cycles_per_row));
}

std::vector<double> dense(const RowMajor& matrix) { return {matrix.data(), matrix.data() + matrix.size()}; }

}  // namespace

// The fit of sums of `row_group` rows, in terms of the rows.
struct StreamingFit::Candidate {
  int row_group;
  std::vector<Flags> flags;    // of the tones
  RowMajor weights;            // (estimates × groups), of sums
  Eigen::MatrixXd design;      // (groups × estimates), of sums
  Eigen::MatrixXd covariance;  // for rows with noise of variance 1
};

StreamingFit::Candidate StreamingFit::candidate(std::size_t rows, std::span<const double> cycles_per_row,
                                                int row_group) {
  const std::size_t groups = rows / static_cast<std::size_t>(row_group);
  const HarmonicModel model = fundamentals_only(groups, cycles_per_row, row_group);
  const auto size = static_cast<Eigen::Index>(model.estimates);
  Eigen::VectorXd scale(size);  // of the estimates, from a row's to a group's sum
  scale(0) = row_group;
  std::vector<double> of_groups;
  for (Eigen::Index a = 1; a < size; a += 2) {
    const double cycles = cycles_per_row[of_groups.size()];
    scale.segment(a, 2).setConstant(row_group * group_gain(cycles, row_group));
    of_groups.push_back(row_group * cycles);
  }
  const Eigen::VectorXd inverse = scale.cwiseInverse();
  return {row_group, model.tone_flags, inverse.asDiagonal() * model.weights.transpose(),
          tone_design(centred_rows(groups), of_groups) * scale.asDiagonal(),
          row_group * (inverse.asDiagonal() * model.covariance * inverse.asDiagonal())};
}

namespace {

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
  if (rows > 2 * estimates_) choose(rows, cycles_per_row, efficiency, most_rows, limbs);
}

void StreamingFit::choose(std::size_t rows, std::span<const double> cycles_per_row, double efficiency, int most_rows,
                          int limbs) {
  const Candidate all_rows = candidate(rows, cycles_per_row, 1);
  flags_ = all_rows.flags;
  well_posed_ = std::ranges::all_of(flags_, is_well_posed);
  if (!well_posed_) return;
  for (const int row_group : {8, 4, 2}) {
    if (row_group > most_rows || efficiency == 1) continue;
    if (rows / static_cast<std::size_t>(row_group) <= 2 * estimates_) continue;
    const Candidate sums = candidate(rows, cycles_per_row, row_group);
    if (keeps(efficiency, all_rows.covariance, sums.covariance)) return adopt(rows, sums, 1);
  }
  adopt(rows, all_rows, efficiency < 1 || rows >= kFewRows ? limbs : kMostLimbs);
}

void StreamingFit::adopt(std::size_t rows, const Candidate& chosen, int limbs) {
  const auto estimates = chosen.weights.rows();
  const auto groups = static_cast<std::size_t>(chosen.design.rows());
  middle_ = (static_cast<double>(groups * static_cast<std::size_t>(chosen.row_group)) - 1) / 2;
  freedom_ = static_cast<double>(groups - estimates_) * chosen.row_group;
  covariance_ = chosen.covariance;
  gram_ = transposed_product(chosen.design, chosen.design);
  // The mean's row is omitted: with those of the tones, the plain sum spans the same estimates.
  const auto tones = chosen.weights.rows() - 1;
  weights_ = RowWeights(dense(chosen.weights.bottomRows(tones)), estimates_ - 1, rows, chosen.row_group, limbs);
  const auto transform = [&](std::span<const double> of_tones) {
    RowMajor all = RowMajor::Ones(estimates, chosen.weights.cols());
    all.bottomRows(tones) = Eigen::Map<const RowMajor>(of_tones.data(), tones, chosen.weights.cols());
    return dense(inverse(transposed_product(all.transpose(), chosen.design)));
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

void StreamingFit::add_up(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                          std::span<const float> light, Projection& to) const {
  project(frames, frame, first, count, weights_, light, to);
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
