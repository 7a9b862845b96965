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

using Values = std::vector<double>;

constexpr std::size_t kMostCells = 16;                   // along each axis
constexpr double kTexture = 0.03;                        // relative difference of neighbouring blocks
constexpr std::array<std::size_t, 4> kLags{1, 2, 4, 8};  // blocks
constexpr int kSteps = 12, kWideSteps = 6;  // of the robust fit; those with a larger texture, so that bands are not
                                            // taken for edges
constexpr double kDarkest = 1e-3;           // of the mean light, of which a logarithm is taken
constexpr double kRidge = 1e-6;
constexpr double kShortestPeriod = 58, kMostSlowCycles = 16;  // of a slow light: rows; in the picture

// Differences of the logarithms of blocks, some apart in one column, and how modes change over them.
struct Differences {
  std::size_t columns;
  Eigen::MatrixXd design;  // (differences × modes)
  Values change, spread;   // (differences × columns); spread: noise variance
};

double mean_of_known(const Blocks& blocks) {
  double sum = 0, known = 0;
  for (std::size_t i = 0; i < blocks.light.size(); ++i)
    if (std::isfinite(blocks.variance[i])) sum += blocks.light[i], known += 1;
  return sum / std::max(known, 1.0);
}

Differences differences_of(const Blocks& blocks, std::size_t count) {
  const double mean = mean_of_known(blocks);
  Values level, noise;
  for (std::size_t i = 0; i < blocks.light.size(); ++i) {
    const double usable = std::max(blocks.light[i], kDarkest * std::max(mean, 1e-100));
    level.push_back(std::log(usable));
    noise.push_back(blocks.variance[i] / (usable * usable));
  }
  const Eigen::MatrixXd modes = slow_modes(blocks.rows, count);
  std::size_t rows = 0;
  for (const std::size_t lag : kLags) rows += lag < blocks.rows ? blocks.rows - lag : 0;
  Differences result{blocks.columns, Eigen::MatrixXd(static_cast<Eigen::Index>(rows), modes.cols()), {}, {}};
  Eigen::Index at = 0;
  for (const std::size_t lag : kLags)
    for (std::size_t n = 0; n + lag < blocks.rows; ++n) {
      result.design.row(at++) = modes.row(static_cast<Eigen::Index>(n + lag)) - modes.row(static_cast<Eigen::Index>(n));
      for (std::size_t k = 0; k < blocks.columns; ++k) {
        const std::size_t one = n * blocks.columns + k, other = one + lag * blocks.columns;
        result.change.push_back(level[other] - level[one]);
        result.spread.push_back(noise[other] + noise[one]);
      }
    }
  return result;
}

// Normal equations of the modes, of columns first to end.
struct NormalEquations {
  Eigen::MatrixXd matrix;
  Eigen::VectorXd right;

  NormalEquations(const Differences& all, const Values& weights, std::size_t first, std::size_t end) {
    const Eigen::Index rows = all.design.rows();
    Eigen::VectorXd weight = Eigen::VectorXd::Zero(rows), pull = weight;
    for (Eigen::Index n = 0; n < rows; ++n)
      for (std::size_t k = first; k < end; ++k) {
        const std::size_t at = static_cast<std::size_t>(n) * all.columns + k;
        weight[n] += weights[at];
        pull[n] += weights[at] * all.change[at];
      }
    matrix = gram(Eigen::MatrixXd(all.design.transpose() * weight.cwiseSqrt().asDiagonal()));
    right = all.design.transpose() * pull;
  }

  [[nodiscard]] Eigen::VectorXd solution() const {
    Eigen::MatrixXd normal = matrix;
    normal.diagonal().array() += kRidge * std::max(normal.trace() / static_cast<double>(normal.rows()), 1e-300);
    return solve_positive_definite(normal, right);
  }
};

Values weights_of(const Differences& all, const Eigen::VectorXd& modes, double of_texture) {
  const Eigen::VectorXd course = all.design * modes;
  Values weights(all.change.size());
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const double left = all.change[i] - course[static_cast<Eigen::Index>(i / all.columns)];
    weights[i] = 1 / (of_texture * of_texture + all.spread[i] + left * left);
  }
  return weights;
}

// Modes of the groups of columns, and the variance of their mean by the jackknife.
void compare_groups(const Differences& all, const Values& weights, CommonCourse& course) {
  const std::size_t count = std::min(kMostGroups, all.columns);
  std::vector<NormalEquations> groups;
  NormalEquations sum(all, weights, 0, 0);
  for (std::size_t group = 0, first = 0; group < count; ++group) {
    const std::size_t end = first + all.columns / count + (group < all.columns % count ? 1 : 0);
    groups.emplace_back(all, weights, first, end);
    course.groups.push_back(values_of(groups.back().solution()));
    sum.matrix += groups.back().matrix;
    sum.right += groups.back().right;
    first = end;
  }
  Eigen::MatrixXd others(all.design.cols(), static_cast<Eigen::Index>(count));
  for (std::size_t left_out = 0; left_out < count; ++left_out) {
    NormalEquations rest = sum;
    rest.matrix -= groups[left_out].matrix;
    rest.right -= groups[left_out].right;
    others.col(static_cast<Eigen::Index>(left_out)) =
        count > 1 ? rest.solution() : Eigen::VectorXd(vector_of(course.modes));
  }
  const Eigen::VectorXd mean = others.rowwise().mean();
  const Eigen::VectorXd squares = (others.colwise() - mean).rowwise().squaredNorm();
  for (Eigen::Index k = 0; k < squares.size(); ++k)
    course.variance.push_back(static_cast<double>(count - 1) / static_cast<double>(count) * squares[k] +
                              kLeastModeVariance);
}

}  // namespace

Eigen::MatrixXd slow_modes(std::size_t places, std::size_t count) {
  const std::size_t steps = 4 * places;  // of a turn
  Values cosine(steps);
  for (std::size_t k = 0; k < steps; ++k)
    cosine[k] = std::cos(kTwoPi * static_cast<double>(k) / static_cast<double>(steps));
  Eigen::MatrixXd modes(static_cast<Eigen::Index>(places), static_cast<Eigen::Index>(count));
  for (std::size_t k = 0; k < count; ++k)
    for (std::size_t n = 0; n < places; ++n)
      modes(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(k)) = cosine[(2 * n + 1) * (k + 1) % steps];
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
  Eigen::VectorXd modes = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(count));
  if (of_all != nullptr) modes = vector_of(of_all->modes);
  Values weights;
  for (int step = of_all != nullptr ? kWideSteps : 0; step < kSteps; ++step) {
    check_interrupt();
    weights = weights_of(all, modes, kTexture * std::max(1, kWideSteps - step));
    modes = NormalEquations(all, weights, 0, all.columns).solution();
  }
  CommonCourse course{.modes = values_of(modes), .variance = {}, .groups = {}};
  if (of_all != nullptr) {
    course.variance = of_all->variance;
    return course;
  }
  compare_groups(all, weights, course);
  const std::size_t down = blocks_of(blocks.rows, kMostCells), across = blocks_of(blocks.columns, kMostCells);
  const Blocks cells = block_means(blocks.picture(), down, across);
  const double least = kDarkest * std::max(mean_of_known(cells), 1e-100);
  for (const double light : cells.light) course.cells.push_back(std::log(std::max(light, least)));
  course.cell_rows = height * down;
  course.cell_columns = width * across;
  return course;
}

}  // namespace ocisac
