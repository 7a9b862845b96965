#include "cleaning/smooth_shares.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "core/check_interrupt.hpp"

namespace ocisac {

namespace {

using Eigen::ArrayXd;
using Eigen::Index;

constexpr double kVariation = 20;  // λ, in log likelihood: equals the evidence of 10 pixels for a change of 1 in share
constexpr int kSteps = 4;          // of reweighting
constexpr double kRegular = 1e-3;  // ε per pixel; the weight of a pixel without evidence
constexpr std::array<int, 4> kIterations{4, 12, 20, 40};  // per level, from the finest; last value for the coarsest
constexpr Index kMinSide = 8;                             // of a level that is reduced further

// Adds Σ_j coupling·(x_i − x_j) over the neighbours `apart` further on and before; no coupling leaves a row.
void add_flow(const ArrayXd& coupling, Index apart, const ArrayXd& x, ArrayXd& out) {
  const Index count = x.size() - apart;
  const ArrayXd flow = coupling.head(count) * (x.head(count) - x.tail(count));
  out.head(count) += flow;
  out.tail(count) -= flow;
}

// System: weight·x_i + Σ_j coupling_ij·(x_i − x_j) = right over the neighbours j.
struct Level {
  Index rows, columns;
  ArrayXd weight, down, across;  // couplings to the next row and column, 0 where there is none
  ArrayXd right;                 // right-hand side, then the residual
  ArrayXd change;                // x
  ArrayXd direction, product;

  Level(Index rows_of, Index columns_of) : rows(rows_of), columns(columns_of) {
    for (auto* values : {&weight, &down, &across, &right, &change, &direction, &product})
      values->setZero(rows * columns);
  }

  // Sums over 2 × 2 pixels.
  void take_from(const Level& finer) {
    for (auto* values : {&weight, &down, &across, &right}) values->setZero();
    for (Index row = 0; row < finer.rows; ++row)
      for (Index column = 0; column < finer.columns; ++column) {
        const Index from = row * finer.columns + column, to = row / 2 * columns + column / 2;
        weight[to] += finer.weight[from];
        right[to] += finer.right[from];
        if (row % 2 == 1) down[to] += finer.down[from];
        if (column % 2 == 1) across[to] += finer.across[from];
      }
  }

  // Start value: the change of the coarser pixel.
  void start_from(const Level& coarser) {
    for (Index row = 0; row < rows; ++row)
      for (Index column = 0; column < columns; ++column)
        change[row * columns + column] = coarser.change[row / 2 * coarser.columns + column / 2];
  }

  void apply(const ArrayXd& x, ArrayXd& out) const {
    out = weight * x;
    add_flow(across, 1, x, out);
    add_flow(down, columns, x, out);
  }

  void solve(int count) {
    ArrayXd inverse = weight + down + across;  // of the diagonal
    inverse.tail(inverse.size() - columns) += down.head(inverse.size() - columns);
    inverse.tail(inverse.size() - 1) += across.head(inverse.size() - 1);
    inverse = inverse.inverse();
    apply(change, product);
    right -= product;
    direction.setZero();
    double residual = (right.square() * inverse).sum(), keep = 0;
    const double negligible = 1e-24 * residual;
    for (int k = 0; k < count && residual > negligible; ++k) {
      check_interrupt();
      direction = right * inverse + keep * direction;
      apply(direction, product);
      const double step = residual / (direction * product).sum();
      change += step * direction;
      right -= step * product;
      const double before = std::exchange(residual, (right.square() * inverse).sum());
      keep = residual / before;
    }
  }
};

// Couplings of the finest level: the share's slope has little weight where it is large.
void couple(const ArrayXd& share, Level& level) {
  const Index columns = level.columns;
  ArrayXd slope = ArrayXd::Zero(share.size());  // squared: twice the mean of both sides
  const auto visit = [&](auto of_pair) {
    for (Index i = 0; i < share.size(); ++i) {
      if ((i + 1) % columns != 0) of_pair(i, i + 1, level.across);
      if (i + columns < share.size()) of_pair(i, i + columns, level.down);
    }
  };
  visit([&](Index i, Index next, const ArrayXd&) {
    const double difference = share[next] - share[i];
    slope[i] += difference * difference;
    slope[next] += difference * difference;
  });
  visit([&](Index i, Index next, ArrayXd& coupling) {
    coupling[i] = kVariation / std::sqrt(kRegular * kRegular + 0.25 * (slope[i] + slope[next]));
  });
}

// Adds x to the share; the finest level comes first.
void step(const ShareEvidence& evidence, std::vector<Level>& levels, Eigen::Map<ArrayXd> share) {
  Level& finest = levels.front();
  const auto array_of = [](const std::vector<double>& values) {
    return Eigen::Map<const ArrayXd>(values.data(), static_cast<Index>(values.size()));
  };
  couple(share, finest);
  finest.weight.setZero();
  finest.apply(share, finest.product);
  finest.right = array_of(evidence.pull) - finest.product;
  finest.weight = array_of(evidence.weight) + kRegular;
  for (std::size_t k = 1; k < levels.size(); ++k) levels[k].take_from(levels[k - 1]);
  levels.back().change.setZero();
  for (std::size_t k = levels.size(); k-- > 0;) {
    if (k + 1 < levels.size()) levels[k].start_from(levels[k + 1]);
    levels[k].solve(k + 1 < levels.size() ? kIterations[k] : kIterations.back());
  }
  share += finest.change;
}

}  // namespace

void smooth_shares(std::size_t rows, std::size_t columns, const std::function<const ShareEvidence&()>& gather,
                   std::vector<double>& share) {
  std::vector<Level> levels{{static_cast<Index>(rows), static_cast<Index>(columns)}};
  while (levels.size() < kIterations.size() && std::min(levels.back().rows, levels.back().columns) >= kMinSide)
    levels.emplace_back((levels.back().rows + 1) / 2, (levels.back().columns + 1) / 2);
  for (int k = 0; k < kSteps; ++k) step(gather(), levels, {share.data(), static_cast<Index>(share.size())});
}

}  // namespace ocisac
