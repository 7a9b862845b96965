#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "cleaning/cleaned_picture.hpp"
#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "core/linear_algebra.hpp"
#include "ocisac/cleaning/light_share.hpp"
#include "ocisac/core/require.hpp"
#include "rows/banded_factors.hpp"

namespace ocisac {

namespace {

constexpr std::array<std::size_t, 5> kLags{1, 2, 4, 8, 16};

// Normal equations of the row light: H·δ = b.
struct RowEquations {
  BandedFactors matrix;
  std::vector<double> right;
};

constexpr std::size_t kLanes = 8;  // independent sums, which a compiler keeps in vector registers

// Contributions of a pair of rows to the normal equations.
struct PairSums {
  std::array<double, kLanes> aa{}, ab{}, bb{}, pull_a{}, pull_b{};
};

// The columns from `i` on, one in each lane.
template <std::size_t count>
inline void add_columns(const Cleaned& frame, std::size_t i, std::size_t j, double texture, PairSums& sums) {
  const double* const light = frame.light.data();
  const double* const slope = frame.slope.data();
  const double* const variance = frame.variance.data();
  for (std::size_t lane = 0; lane < count; ++lane) {
    const double c1 = light[i + lane], c2 = light[j + lane];
    const double difference = c2 - c1, mean = 0.5 * (c2 + c1);
    const double spread = texture * mean * mean + difference * difference + (variance[i + lane] + variance[j + lane]);
    const double certainty = (mean > 0 ? 1.0 : 0.0) / spread;  // no branch around the division: vectors
    const double left = mean * slope[i + lane], right = mean * slope[j + lane];
    sums.aa[lane] += left * left * certainty;
    sums.bb[lane] += right * right * certainty;
    sums.ab[lane] += left * right * certainty;
    sums.pull_a[lane] -= left * difference * certainty;
    sums.pull_b[lane] += right * difference * certainty;
  }
}

double sum_of(const std::array<double, kLanes>& values) { return std::accumulate(values.begin(), values.end(), 0.0); }

void add_pair(const Cleaned& frame, std::size_t columns, std::size_t a, std::size_t b, double texture,
              RowEquations& equations) {
  PairSums sums;
  std::size_t column = 0;
  for (; column + kLanes <= columns; column += kLanes)
    add_columns<kLanes>(frame, a * columns + column, b * columns + column, texture * texture, sums);
  for (; column < columns; ++column)
    add_columns<1>(frame, a * columns + column, b * columns + column, texture * texture, sums);
  equations.matrix.at(a, 0) += sum_of(sums.aa);
  equations.matrix.at(b, 0) += sum_of(sums.bb);
  equations.matrix.at(b, b - a) -= sum_of(sums.ab);
  equations.right[a] += sum_of(sums.pull_a);
  equations.right[b] += sum_of(sums.pull_b);
}

RowEquations row_equations(const BandedPicture& picture, std::span<const double> share, std::span<const double> light,
                           int step, Cleaned& cleaned) {
  const std::size_t rows = picture.rows, columns = picture.columns;
  for (std::size_t row = 0; row < rows; ++row) clean_row(picture, 0, row, light[row] - 1, share, cleaned, true);
  RowEquations equations{{rows, kLags.back()}, std::vector<double>(rows)};
  const double texture = row_texture(static_cast<std::size_t>(step));
  for (const std::size_t lag : kLags)
    for (std::size_t n = 0; n + lag < rows; ++n)
      add_pair(cleaned, columns, n, n + lag, texture * std::sqrt(static_cast<double>(lag)), equations);
  return equations;
}

// Change B·δ of the rows with (BᵀHB)·δ = Bᵀb; `basis`: B, column by column.
std::vector<double> solve_in(std::span<const double> basis, const RowEquations& equations, std::size_t rows) {
  const auto terms = static_cast<Eigen::Index>(basis.size() / rows);
  const Eigen::Map<const Eigen::MatrixXd> b(basis.data(), static_cast<Eigen::Index>(rows), terms);
  Eigen::MatrixXd moved = Eigen::MatrixXd::Zero(terms, b.rows());  // (H·B)ᵀ
  const Eigen::MatrixXd turned = b.transpose();
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t k = 0; k <= std::min(kLags.back(), rows - 1 - n); ++k) {
      const auto one = static_cast<Eigen::Index>(n), other = static_cast<Eigen::Index>(n + k);
      const double value = equations.matrix.at(n + k, k);
      moved.col(one) += value * turned.col(other);
      if (k > 0) moved.col(other) += value * turned.col(one);
    }
  Eigen::MatrixXd normal = product(moved, b);
  if (!(normal.trace() > 0)) return std::vector<double>(rows);
  normal.diagonal().array() += 1e-6 * normal.trace() / static_cast<double>(terms);
  const Eigen::VectorXd change = b * solve_positive_definite(normal, b.transpose() * vector_of(equations.right));
  return values_of(change);
}

// Adds a Gaussian prior of the given deviation about the start.
void hold_to(std::span<const double> start, std::span<const double> light, double deviation, RowEquations& equations) {
  // The texture of neighbouring columns is correlated: a share of them is evidence.
  const double hold = 1 / (kSmallShare * deviation * deviation);
  for (std::size_t n = 0; n < start.size(); ++n) {
    equations.matrix.at(n, 0) += hold;
    equations.right[n] += hold * (start[n] - light[n]);
  }
}

void check(const RowLightPrior& model, std::size_t rows) {
  require(model.deviation > 0, "deviation", model.deviation, "above 0");
  require(model.basis.size() % rows == 0, "basis", model.basis.size(), "rows x terms values");
  require(model.basis.empty() || std::isinf(model.deviation), "deviation", model.deviation, "infinite with a basis");
  for (const double value : model.basis) require_finite("basis", value);
}

}  // namespace

RowLight refine_row_light(const BandedPicture& picture, std::span<const double> share,
                          std::span<const double> row_light, int steps, const RowLightPrior& model) {
  check(picture, row_light);
  check(model, picture.rows);
  require(picture.frames == 1, "frames", picture.frames, "1");
  require(share.size() == picture.light.size(), "share", share.size(), "one value a pixel");
  const std::size_t rows = picture.rows;
  RowLight result{{row_light.begin(), row_light.end()}, std::vector<double>(rows)};
  Cleaned cleaned(picture.light.size());
  for (int step = 0; step < steps; ++step) {
    check_interrupt();
    RowEquations equations = row_equations(picture, share, result.light, step, cleaned);
    double most = 0;
    for (std::size_t n = 0; n < rows; ++n) most = std::max(most, result.information[n] = equations.matrix.at(n, 0));
    if (!(most > 0)) break;
    if (!model.basis.empty()) {
      const std::vector<double> change = solve_in(model.basis, equations, rows);
      double largest = kMostly;
      for (const double value : change) largest = std::max(largest, std::abs(value));
      for (std::size_t n = 0; n < rows; ++n) result.light[n] += kMostly / largest * change[n];
      continue;
    }
    if (std::isfinite(model.deviation))
      hold_to(row_light, result.light, model.deviation, equations);
    else
      for (std::size_t n = 0; n < rows; ++n) equations.matrix.at(n, 0) += 1e-4 * most;  // for rows without pairs
    equations.matrix.factor();
    equations.matrix.forward(equations.right);
    equations.matrix.backward(equations.right);
    for (std::size_t n = 0; n < rows; ++n)
      result.light[n] = std::max(0.0, result.light[n] + std::clamp(equations.right[n], -kMostly, kMostly));
  }
  return result;
}

}  // namespace ocisac
