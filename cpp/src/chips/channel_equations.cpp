#include "chips/channel_equations.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/linear_algebra.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

using Eigen::Index;

namespace {

constexpr double kMinPivot = 1e-11;  // relative to the unit diagonal of a normal matrix

// Zero swing: the clock has no effect.
double no_swing(std::size_t, const double*) { return 0; }

double product(const double* parts, const Eigen::VectorXd& values) {
  double sum = 0;
  for (Index k = 0; k < values.size(); ++k) sum += parts[k] * values[k];
  return sum;
}

}  // namespace

void check_model(const ChannelModel& model) {
  require(model.dark_degree <= kHighestDegree, "dark_degree", model.dark_degree, "0 to 6");
  require(model.swing_degree <= kHighestDegree, "swing_degree", model.swing_degree, "0 to 6");
  require_not_negative("rate_std", model.rate_std);
}

double along_frame(double row, std::size_t rows) {
  return rows < 2 ? 0.0 : 2 * row / static_cast<double>(rows - 1) - 1;
}

double polynomial(std::span<const double> coefficients, double x) {
  std::array<double, kHighestDegree + 1> basis;
  legendre(x, {basis.data(), coefficients.size()});
  double sum = 0;
  for (std::size_t k = 0; k < coefficients.size(); ++k) sum += coefficients[k] * basis[k];
  return sum;
}

std::optional<Solved> solve_normal(const Eigen::MatrixXd& normal, const Eigen::VectorXd& right) {
  const auto diagonal = normal.diagonal().array();
  if (!normal.allFinite()) return std::nullopt;
  const Eigen::VectorXd scale = (diagonal > 0).select(diagonal.max(1e-300).sqrt().inverse(), 0.0);
  const Eigen::MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  Eigen::MatrixXd sides(normal.rows(), normal.rows() + 1);
  sides << Eigen::MatrixXd::Identity(normal.rows(), normal.rows()), scale.cwiseProduct(right);
  const auto solved = solve_symmetric(scaled, sides, kMinPivot);
  if (!solved) return std::nullopt;
  return Solved{scale.cwiseProduct(solved->rightCols(1)),
                scale.asDiagonal() * solved->leftCols(normal.rows()) * scale.asDiagonal()};
}

std::optional<Solved> solve_clock(const Eigen::MatrixXd& normal, const Eigen::VectorXd& right) {
  if (auto solved = solve_normal(normal, right)) return solved;
  std::vector<Index> others;
  for (Index k = 0; k < normal.rows(); ++k)
    if (k != 2) others.push_back(k);
  const auto solved = solve_normal(normal(others, others), right(others));
  if (!solved) return std::nullopt;
  Solved whole{Eigen::VectorXd::Zero(normal.rows()), Eigen::MatrixXd::Zero(normal.rows(), normal.rows())};
  whole.values(others) = solved->values;
  whole.inverse(others, others) = solved->inverse;
  whole.inverse(2, 2) = std::numeric_limits<double>::infinity();
  return whole;
}

std::optional<Eigen::VectorXd> fit_levels(const ChannelEquations& equations, RowRange range) {
  NormalSums sums(equations.level_size());
  equations.for_each_row(range, no_swing, [&](std::size_t n, const double* parts) {
    sums.add(parts + equations.clock_size(), equations.signal()[n]);
  });
  const auto solved = solve_normal(sums.matrix(), sums.right());
  if (!solved) return std::nullopt;
  return solved->values;
}

std::optional<double> squares_left(const ChannelEquations& equations, RowRange range) {
  const auto levels = fit_levels(equations, range);
  if (!levels) return std::nullopt;
  double squares = 0;
  equations.for_each_row(range, no_swing, [&](std::size_t n, const double* parts) {
    const double residual = equations.signal()[n] - product(parts + equations.clock_size(), *levels);
    squares += residual * residual;
  });
  return squares;
}

std::optional<Linearised> linearise(ChannelEquations& equations, const ChipClock& clock, RowRange range,
                                    const KnownRate& known, const std::optional<Eigen::VectorXd>& nearby) {
  equations.expose(clock, range);
  auto levels = nearby ? nearby : fit_levels(equations, range);
  if (!levels) return std::nullopt;
  const Index clock_size = equations.clock_size(), level_size = equations.level_size();
  NormalSums sums(equations.unknowns());
  double squares = 0;
  const auto swing = [&](std::size_t, const double* basis) { return equations.swing_of(*levels, basis); };
  equations.for_each_row(range, swing, [&](std::size_t n, const double* parts) {
    const double residual = equations.signal()[n] - product(parts + clock_size, *levels);
    sums.add(parts, residual);
    squares += residual * residual;
  });
  Eigen::MatrixXd normal = sums.matrix();
  Eigen::VectorXd right = sums.right();
  const double off = known.rows_per_chip - clock.rows_per_chip;
  normal(1, 1) += known.weight;
  right[1] += known.weight * off;
  if (nearby) {
    const auto change = solve_normal(normal.bottomRightCorner(level_size, level_size), right.tail(level_size));
    if (!change) return std::nullopt;
    *levels += change->values;
    squares = std::max(squares - change->values.dot(right.tail(level_size)), 0.0);
  }
  squares += known.weight * off * off;
  const auto solved = clock_size == 3 ? solve_clock(normal, right) : solve_normal(normal, right);
  if (!solved) return std::nullopt;
  return Linearised{*levels, solved->values.head(clock_size), solved->inverse, squares};
}

}  // namespace ocisac
