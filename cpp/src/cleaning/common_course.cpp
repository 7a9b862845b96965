#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>

#include "cleaning/block_shares.hpp"
#include "cleaning/cleaned_picture.hpp"
#include "cleaning/merged_blocks.hpp"
#include "cleaning/slow_tones.hpp"
#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "core/linear_algebra.hpp"
#include "ocisac/cleaning/column_bundles.hpp"

namespace ocisac {

namespace {

using Eigen::ArrayXXd;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Values = std::vector<double>;

constexpr std::size_t kMostCells = 16;             // along each axis
constexpr double kTexture = 0.03;                  // relative difference of neighbouring blocks
constexpr std::array<Index, 4> kLags{1, 2, 4, 8};  // blocks
constexpr int kSteps = 12, kWideSteps = 6;  // of the robust fit; those with a larger texture, so that bands are not
                                            // taken for edges
constexpr double kDarkest = 1e-3;           // of the mean light, of which a logarithm is taken
constexpr double kRidge = 1e-6;
constexpr double kShortestPeriod = 58, kMostSlowCycles = 16;  // of a slow light: rows; in the picture

// Light of blocks, or of the mean light where that is too dark for a logarithm.
Eigen::ArrayXd usable_light(const Blocks& blocks) {
  const double mean = block_means(blocks.picture(), blocks.rows, blocks.columns).light.front();
  return vector_of(blocks.light).array().max(kDarkest * std::max(mean, 1e-100));
}

// Differences of the logarithms of blocks, some apart in one column, and how modes change over them.
struct Differences {
  MatrixXd design;          // (differences × modes)
  ArrayXXd change, spread;  // (differences × columns); spread: noise variance
};

Differences differences_of(const Blocks& blocks, std::size_t count) {
  const auto rows = static_cast<Index>(blocks.rows), columns = static_cast<Index>(blocks.columns);
  const Eigen::ArrayXd usable = usable_light(blocks), variance = vector_of(blocks.variance).array() / usable.square();
  const ArrayXXd level = usable.log().reshaped(columns, rows).transpose(),
                 noise = variance.reshaped(columns, rows).transpose();
  const MatrixXd modes = slow_modes(blocks.rows, count);
  Index all = 0;
  for (const Index lag : kLags) all += std::max(rows - lag, Index{0});
  Differences result{MatrixXd(all, modes.cols()), ArrayXXd(all, columns), ArrayXXd(all, columns)};
  Index at = 0;
  for (const Index lag : kLags) {
    const Index some = std::max(rows - lag, Index{0});
    result.design.middleRows(at, some) = modes.bottomRows(some) - modes.topRows(some);
    result.change.middleRows(at, some) = level.bottomRows(some) - level.topRows(some);
    result.spread.middleRows(at, some) = noise.bottomRows(some) + noise.topRows(some);
    at += some;
  }
  return result;
}

// Normal equations of the modes, of `count` columns.
struct NormalEquations {
  MatrixXd matrix;
  VectorXd right;

  NormalEquations(const Differences& all, const ArrayXXd& weights, Index first, Index count) {
    const ArrayXXd own = weights.middleCols(first, count), pulls = own * all.change.middleCols(first, count);
    const VectorXd ones = VectorXd::Ones(count), weight = own.matrix() * ones, pull = pulls.matrix() * ones;
    matrix = gram(MatrixXd(all.design.transpose() * weight.cwiseSqrt().asDiagonal()));
    right = all.design.transpose() * pull;
  }

  [[nodiscard]] VectorXd solution() const {
    MatrixXd normal = matrix;
    normal.diagonal().array() += kRidge * std::max(normal.trace() / static_cast<double>(normal.rows()), 1e-300);
    return solve_positive_definite(normal, right);
  }
};

ArrayXXd weights_of(const Differences& all, const VectorXd& modes, double of_texture) {
  const Eigen::ArrayXd course = all.design * modes;
  return (of_texture * of_texture + all.spread + (all.change.colwise() - course).square()).inverse();
}

// Modes of the groups of columns, and the variance of their mean by the jackknife.
void compare_groups(const Differences& all, const ArrayXXd& weights, CommonCourse& course) {
  const Index columns = weights.cols(), count = std::min(static_cast<Index>(kMostGroups), columns);
  const NormalEquations sum(all, weights, 0, columns);
  MatrixXd others(all.design.cols(), count);
  for (Index group = 0, first = 0; group < count; ++group) {
    const Index size = columns / count + (group < columns % count ? 1 : 0);
    const NormalEquations own(all, weights, first, size);
    course.groups.push_back(values_of(own.solution()));
    NormalEquations rest = sum;
    rest.matrix -= own.matrix;
    rest.right -= own.right;
    others.col(group) = count > 1 ? rest.solution() : VectorXd(vector_of(course.modes));
    first += size;
  }
  const VectorXd mean = others.rowwise().mean(), squares = (others.colwise() - mean).rowwise().squaredNorm();
  const auto number = static_cast<double>(count);
  course.variance = values_of(((number - 1) / number * squares).array() + kLeastModeVariance);
}

}  // namespace

Eigen::MatrixXd slow_modes(std::size_t places, std::size_t count) {
  const std::size_t steps = 4 * places;  // of a turn
  Values cosine(steps);
  for (std::size_t k = 0; k < steps; ++k)
    cosine[k] = std::cos(kTwoPi * static_cast<double>(k) / static_cast<double>(steps));
  Eigen::MatrixXd modes(places, count);
  for (std::size_t k = 0; k < count; ++k)
    for (std::size_t n = 0; n < places; ++n)
      modes(static_cast<Index>(n), static_cast<Index>(k)) = cosine[(2 * n + 1) * (k + 1) % steps];
  return modes;
}

double most_cycles(std::size_t rows) {
  return std::clamp(static_cast<double>(rows) / kShortestPeriod, kSlowCycles, kMostSlowCycles);
}

std::size_t mode_count(std::size_t rows) {
  return std::max(std::min<std::size_t>(24, rows / 4), static_cast<std::size_t>(std::ceil(3 * most_cycles(rows))));
}

CommonCourse common_course(std::span<const BandedPicture> colours, const CommonCourse* of_all) {
  require(!colours.empty(), "colours", 0, "at least one");
  const BandedPicture& picture = colours.front();
  for (const BandedPicture& colour : colours)
    if (of_all == nullptr) check(colour, Values(picture.rows, 1.0));  // else it has been
  require(picture.frames == 1 && picture.rows >= 4, "rows", picture.rows, "4 or more, of one frame");
  const std::size_t count = mode_count(picture.rows);
  const std::size_t height = std::max<std::size_t>(1, picture.rows / (4 * count));
  const std::size_t width = blocks_of(picture.columns, kEnoughColumns);
  const Blocks blocks = block_means(colours, height, width);
  const Differences all = differences_of(blocks, count);
  VectorXd modes = VectorXd::Zero(static_cast<Index>(count));
  if (of_all != nullptr) modes = vector_of(of_all->modes);
  ArrayXXd weights;
  for (int step = of_all != nullptr ? kWideSteps : 0; step < kSteps; ++step) {
    check_interrupt();
    weights = weights_of(all, modes, kTexture * std::max(1, kWideSteps - step));
    modes = NormalEquations(all, weights, 0, weights.cols()).solution();
  }
  CommonCourse course{.modes = values_of(modes), .variance = {}, .groups = {}};
  if (of_all != nullptr) {
    course.variance = of_all->variance;
    return course;
  }
  compare_groups(all, weights, course);
  const std::size_t down = blocks_of(blocks.rows, kMostCells), across = blocks_of(blocks.columns, kMostCells);
  const Blocks cells = block_means(blocks.picture(), down, across);
  course.cells = values_of(usable_light(cells).log());
  course.cell_rows = height * down;
  course.cell_columns = width * across;
  return course;
}

}  // namespace ocisac
