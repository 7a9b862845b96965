#include "cleaning/smooth_shares.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <span>
#include <utility>

#include "core/check_interrupt.hpp"

namespace ocisac {

namespace {

constexpr double kVariation = 20;  // λ, in log likelihood: equals the evidence of 10 pixels for a change of 1 in share
constexpr int kSteps = 4;          // of reweighting
constexpr double kMinSlope = 1e-3;                        // ε, per pixel
constexpr double kMinWeight = 1e-3;                       // regularises pixels without evidence
constexpr std::array<int, 4> kIterations{4, 12, 20, 40};  // per level, from the finest; last value for the coarsest
constexpr std::size_t kMinSide = 8;                       // of a level that is reduced further

double scalar_product(const double* a, const double* b, std::size_t count) {
  std::array<double, 4> sums{};  // independent sums avoid a dependency chain
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4)
    for (std::size_t k = 0; k < 4; ++k) sums[k] += a[i + k] * b[i + k];
  double sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
  for (; i < count; ++i) sum += a[i] * b[i];
  return sum;
}

// System: weight·x_i + Σ_j coupling_ij·(x_i − x_j) = right over the neighbours j.
struct Level {
  std::size_t rows, columns;
  std::vector<double> weight, down, across;  // couplings to the next row and column, 0 where there is none
  std::vector<double> right;                 // right-hand side, then the residual
  std::vector<double> change;                // x
  std::vector<double> direction, product, inverse;

  Level(std::size_t rows_of, std::size_t columns_of) : rows(rows_of), columns(columns_of) {
    for (auto* values : {&weight, &down, &across, &right, &change, &direction, &product, &inverse})
      values->assign(size(), 0);
  }

  std::size_t size() const { return rows * columns; }

  // Sums over 2 × 2 pixels.
  void take_from(const Level& finer) {
    for (auto* values : {&weight, &down, &across, &right}) std::fill(values->begin(), values->end(), 0);
    for (std::size_t row = 0; row < finer.rows; ++row)
      for (std::size_t column = 0; column < finer.columns; ++column) {
        const std::size_t from = row * finer.columns + column, to = row / 2 * columns + column / 2;
        weight[to] += finer.weight[from];
        right[to] += finer.right[from];
        if (row % 2 == 1) down[to] += finer.down[from];
        if (column % 2 == 1) across[to] += finer.across[from];
      }
  }

  // Start value: the change of the coarser pixel.
  void start_from(const Level& coarser) {
    for (std::size_t row = 0; row < rows; ++row)
      for (std::size_t column = 0; column < columns; ++column)
        change[row * columns + column] = coarser.change[row / 2 * coarser.columns + column / 2];
  }

  void invert_diagonal() {
    for (std::size_t i = 0; i < size(); ++i) {
      double sum = weight[i] + down[i] + across[i];
      if (i >= columns) sum += down[i - columns];
      if (i > 0) sum += across[i - 1];  // 0 from the end of the row before
      inverse[i] = 1 / sum;
    }
  }

  // One row of the product of the matrix and x.
  void apply(const std::vector<double>& x, std::size_t row, std::vector<double>& out) const {
    const std::size_t first = row * columns, above = row > 0 ? columns : 0, below = row + 1 < rows ? columns : 0;
    const double* here = &x[first];
    const double* up = here - above;
    const double* under = here + below;
    const double* from_up = &down[first] - above;  // in the first row this term has weight 0
    const double* to_under = &down[first];
    const double* beside = &across[first];
    const double* held = &weight[first];
    double* result = &out[first];
    const auto of_column = [&](std::size_t i) {
      return held[i] * here[i] + from_up[i] * (here[i] - up[i]) + to_under[i] * (here[i] - under[i]);
    };
    result[0] = of_column(0);
    if (columns == 1) return;
    result[0] += beside[0] * (here[0] - here[1]);
    for (std::size_t i = 1; i + 1 < columns; ++i)
      result[i] = of_column(i) + beside[i] * (here[i] - here[i + 1]) + beside[i - 1] * (here[i] - here[i - 1]);
    result[columns - 1] = of_column(columns - 1) + beside[columns - 2] * (here[columns - 1] - here[columns - 2]);
  }

  // direction = residual/diagonal + keep·direction; product = matrix·direction; returns their scalar product.
  double multiply(double keep) {
    double sum = 0;
    for (std::size_t row = 0; row <= rows; ++row) {
      if (row < rows)
        for (std::size_t i = row * columns; i < (row + 1) * columns; ++i)
          direction[i] = right[i] * inverse[i] + keep * direction[i];
      if (row == 0) continue;
      apply(direction, row - 1, product);
      const std::size_t first = (row - 1) * columns;
      sum += scalar_product(&direction[first], &product[first], columns);
    }
    return sum;
  }

  // Along the direction; returns the size of the residual.
  double advance(double step) {
    double sum = 0;
    std::array<double, 256> scaled{};
    for (std::size_t first = 0; first < size(); first += scaled.size()) {
      const std::size_t count = std::min(scaled.size(), size() - first);
      for (std::size_t k = 0; k < count; ++k) {
        const std::size_t i = first + k;
        change[i] += step * direction[i];
        right[i] -= step * product[i];
        scaled[k] = right[i] * inverse[i];
      }
      sum += scalar_product(&right[first], scaled.data(), count);
    }
    return sum;
  }

  void solve(int count) {
    invert_diagonal();
    for (std::size_t row = 0; row < rows; ++row) apply(change, row, product);
    std::fill(direction.begin(), direction.end(), 0);
    for (std::size_t i = 0; i < size(); ++i) right[i] -= product[i];
    double residual = advance(0), keep = 0;
    const double negligible = 1e-24 * residual;
    for (int k = 0; k < count && residual > negligible; ++k) {
      check_interrupt();
      const double before = std::exchange(residual, advance(residual / multiply(keep)));
      keep = residual / before;
    }
  }
};

class ShareSmoother {
 public:
  ShareSmoother(std::size_t rows, std::size_t columns) {
    levels_.emplace_back(rows, columns);
    while (levels_.size() < kIterations.size() && std::min(levels_.back().rows, levels_.back().columns) >= kMinSide)
      levels_.emplace_back((levels_.back().rows + 1) / 2, (levels_.back().columns + 1) / 2);
  }

  // Adds x to `share`.
  void step(std::span<const double> pull, std::span<const double> weight, std::span<double> share) {
    Level& finest = levels_.front();
    couple(share);
    find_right(pull, share);
    for (std::size_t i = 0; i < share.size(); ++i) finest.weight[i] = weight[i] + kMinWeight;
    for (std::size_t k = 1; k < levels_.size(); ++k) levels_[k].take_from(levels_[k - 1]);
    std::fill(levels_.back().change.begin(), levels_.back().change.end(), 0);
    for (std::size_t k = levels_.size(); k-- > 0;) {
      if (k + 1 < levels_.size()) levels_[k].start_from(levels_[k + 1]);
      levels_[k].solve(k + 1 < levels_.size() ? kIterations[k] : kIterations.back());
    }
    for (std::size_t i = 0; i < share.size(); ++i) share[i] += finest.change[i];
  }

 private:
  void couple(std::span<const double> share) {
    Level& level = levels_.front();
    const std::size_t rows = level.rows, columns = level.columns;
    std::vector<double>& slope = level.product;  // squared: twice the mean of both sides
    std::fill(slope.begin(), slope.end(), 0);
    const auto add = [&](std::size_t i, std::size_t next) {
      const double difference = share[next] - share[i], square = difference * difference;
      slope[i] += square;
      slope[next] += square;
    };
    const auto coupling = [&](std::size_t i, std::size_t next) {
      return kVariation / std::sqrt(kMinSlope * kMinSlope + 0.25 * (slope[i] + slope[next]));
    };
    for (std::size_t i = 0; i < share.size(); i += columns) {
      for (std::size_t k = i; k + 1 < i + columns; ++k) add(k, k + 1);
      for (std::size_t k = i; k < i + columns && k + columns < share.size(); ++k) add(k, k + columns);
    }
    for (std::size_t row = 0; row < rows; ++row) {
      const std::size_t first = row * columns, end = first + columns;
      for (std::size_t i = first; i + 1 < end; ++i) level.across[i] = coupling(i, i + 1);
      for (std::size_t i = first; row + 1 < rows && i < end; ++i) level.down[i] = coupling(i, i + columns);
    }
  }

  // Right-hand side: pull + div(coupling·∇q).
  void find_right(std::span<const double> pull, std::span<const double> share) {
    Level& level = levels_.front();
    const std::size_t columns = level.columns;
    level.right.assign(pull.begin(), pull.end());
    for (std::size_t row = 0; row < level.rows; ++row)
      for (std::size_t column = 0; column < columns; ++column) {
        const std::size_t i = row * columns + column;
        if (column + 1 < columns) {
          const double flow = level.across[i] * (share[i + 1] - share[i]);
          level.right[i] += flow;
          level.right[i + 1] -= flow;
        }
        if (row + 1 < level.rows) {
          const double flow = level.down[i] * (share[i + columns] - share[i]);
          level.right[i] += flow;
          level.right[i + columns] -= flow;
        }
      }
  }

  std::vector<Level> levels_;  // the finest first
};

}  // namespace

void smooth_shares(std::size_t rows, std::size_t columns, const std::function<const ShareEvidence&()>& gather,
                   std::vector<double>& share) {
  ShareSmoother smoother(rows, columns);
  for (int k = 0; k < kSteps; ++k) {
    const ShareEvidence& evidence = gather();
    smoother.step(evidence.pull, evidence.weight, share);
  }
}

}  // namespace ocisac
