#include <Eigen/Core>
#include <algorithm>

#include "cleaning/block_shares.hpp"
#include "cleaning/cleaned_picture.hpp"
#include "cleaning/merged_blocks.hpp"
#include "cleaning/quantile.hpp"
#include "cleaning/slow_tones.hpp"
#include "core/linear_algebra.hpp"
#include "ocisac/core/constants.hpp"

namespace ocisac {

namespace {

using Eigen::ArrayXXd;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kBetweenCells = 0.15;  // standard deviation of a share from its neighbours; from 1 it is 1
constexpr double kClearlyLess = 0.8;    // of what one share leaves; by chance 0.9
constexpr int kSteps = 4;

// Inverse covariance of the shares of cells, `across` in a row of them.
MatrixXd prior_of(Index cells, Index across) {
  MatrixXd prior = MatrixXd::Identity(cells, cells);
  const auto join = [&](Index a, Index b) {
    const double weight = 1 / (kBetweenCells * kBetweenCells);
    prior(a, a) += weight;
    prior(b, b) += weight;
    prior(a, b) -= weight;
    prior(b, a) -= weight;
  };
  for (Index cell = 0; cell < cells; ++cell) {
    if ((cell + 1) % across != 0) join(cell, cell + 1);
    if (cell + across < cells) join(cell, cell + across);
  }
  return prior;
}

ArrayXXd centred(const ArrayXXd& values) { return values.colwise() - values.rowwise().mean(); }

}  // namespace

std::vector<double> slow_shares(std::span<const CommonCourse> courses, const std::vector<SlowTone>& tones,
                                std::size_t rows) {
  const CommonCourse& first = courses.front();
  const auto cells = static_cast<Index>(first.cells.size()), frames = static_cast<Index>(courses.size());
  if (courses.size() < kFewFrames || cells == 0) return {};
  const auto across = static_cast<Index>(first.cells.size() / blocks_of(rows, first.cell_rows));
  ArrayXXd level(cells, frames), change(cells, frames);  // of the light, from its mean
  for (Index frame = 0; frame < frames; ++frame) {
    const CommonCourse& course = courses[static_cast<std::size_t>(frame)];
    if (static_cast<Index>(course.cells.size()) != cells) return {};
    const std::vector<double> light =
        means_of_rows(light_of(in_frame(tones, course.place - first.place), rows), rows, first.cell_rows);
    for (Index cell = 0; cell < cells; ++cell) {
      level(cell, frame) = course.cells[static_cast<std::size_t>(cell)];
      change(cell, frame) = light[static_cast<std::size_t>(cell / across)] - 1;
    }
  }
  level = centred(level);
  const MatrixXd prior = prior_of(cells, across);
  VectorXd share = VectorXd::Ones(cells);
  const auto left = [&] { return (1 + change.colwise() * share.array()).max(kLeastLight).eval(); };
  const auto residual = [&] { return (level - centred(left().log())).eval(); };
  double noise_of_one = 0, before = 0;
  for (int step = 0; step < kSteps; ++step) {
    const ArrayXXd rest = residual(), slope = centred(change / left()), squares = rest.square();
    const double noise = quantile({squares.data(), static_cast<std::size_t>(squares.size())}, 0.5) /
                             (kMedianMagnitude * kMedianMagnitude) +
                         kLeastModeVariance;
    if (step == 0) {
      noise_of_one = noise;
      before = (1 + squares / noise).log().sum();
    }
    const ArrayXXd weight = (squares + noise).inverse();
    MatrixXd normal = prior;
    normal.diagonal() += (weight * slope.square()).rowwise().sum().matrix();
    const VectorXd right = (weight * slope * rest).rowwise().sum().matrix() - prior * (share - VectorXd::Ones(cells));
    share = (share + VectorXd(solve_positive_definite(normal, right))).cwiseMax(0);
  }
  if (!((1 + residual().square() / noise_of_one).log().sum() < kClearlyLess * before)) return {};
  return {share.data(), share.data() + share.size()};
}

}  // namespace ocisac
