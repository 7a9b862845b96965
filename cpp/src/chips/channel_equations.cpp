#include "chips/channel_equations.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "core/linear_algebra.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

using Eigen::Index;

namespace {

constexpr double kMinPivot = 1e-11;  // relative to the unit diagonal of a normal matrix

// P_(k + 1) = rise·x·P_k − fall·P_(k − 1): [k] rise from k, fall to k + 1.
constexpr auto kRises = [] {
  std::array<double, kHighestDegree + 1> rises{};
  for (std::size_t k = 0; k < rises.size(); ++k)
    rises[k] = (2.0 * static_cast<double>(k) + 1) / static_cast<double>(k + 1);
  return rises;
}();
constexpr auto kFalls = [] {
  std::array<double, kHighestDegree + 1> falls{};
  for (std::size_t k = 0; k < falls.size(); ++k) falls[k] = static_cast<double>(k + 1) / static_cast<double>(k + 2);
  return falls;
}();

}  // namespace

void check_model(const ChannelModel& model) {
  require(model.dark_degree <= kHighestDegree, "dark_degree", model.dark_degree, "0 to 6");
  require(model.swing_degree <= kHighestDegree, "swing_degree", model.swing_degree, "0 to 6");
  require_not_negative("rate_std", model.rate_std);
  require_not_negative("vain_step", model.vain_step);
}

double along_frame(double row, std::size_t rows) {
  return rows < 2 ? 0.0 : 2 * row / static_cast<double>(rows - 1) - 1;
}

double polynomial(std::span<const double> coefficients, double x) {
  if (coefficients.size() == 1) return coefficients[0];
  if (coefficients.size() == 2) return coefficients[0] + coefficients[1] * x;  // the usual ones
  double sum = 0, before = 0;                                                  // Clenshaw's recurrence
  for (std::size_t k = coefficients.size(); k-- > 0;) {
    const double next = coefficients[k] + kRises[k] * x * sum - kFalls[k] * before;
    before = std::exchange(sum, next);
  }
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

ChannelEquations::ChannelEquations(std::span<const double> signal, const KnownChips& chips, const ChannelModel& model,
                                   std::size_t rows)
    : signal_(signal),
      chips_(chips),
      box_(chips, {}),
      origin_(chips.first + static_cast<std::ptrdiff_t>(chips.levels.size() / 2)),
      clock_size_(model.exposure_known ? 2 : 3),
      dark_size_(static_cast<Index>(model.dark_degree + 1)),
      swing_size_(static_cast<Index>(model.swing_degree + 1)),
      basis_(static_cast<Index>(rows), std::max(dark_size_, swing_size_)),
      by_clock_(basis_.rows(), clock_size_),
      parts_(basis_.rows(), unknowns()) {
  // Degrees 0 and 1, the usual ones, without a call of legendre: 3 % of the instructions of a fit.
  std::array<double, kHighestDegree + 1> basis{};
  const auto degrees = static_cast<std::size_t>(basis_.cols());
  basis_.col(0).setOnes();
  for (std::size_t n = 0; n < rows && degrees > 1; ++n) {
    const auto row = static_cast<Index>(n);
    const double x = along_frame(static_cast<double>(n), rows);
    basis_(row, 1) = x;
    if (degrees == 2) continue;
    legendre(x, {basis.data(), degrees});
    for (std::size_t k = 2; k < degrees; ++k) basis_(row, static_cast<Index>(k)) = basis[k];
  }
}

void ChannelEquations::expose(const ChipClock& clock, RowRange range) {
  if (!box_.has_shape_of(clock)) box_ = ChipBox(chips_, clock);
  first_ = static_cast<Index>(range.begin);
  count_ = static_cast<Index>(range.size());
  const auto origin = static_cast<double>(origin_);
  double* const value = &parts_(0, clock_size_ + dark_size_);
  for (Index n = 0; n < count_; ++n) {
    const Exposed seen = box_.at(static_cast<double>(first_ + n), clock, origin);
    by_clock_(n, 0) = seen.by_phase;
    by_clock_(n, 1) = seen.by_period;
    if (clock_size_ == 3) by_clock_(n, 2) = seen.by_exposure;
    value[n] = seen.value;  // the first polynomial is 1
  }
  const auto basis = basis_.middleRows(first_, count_);
  parts_.block(0, clock_size_, count_, dark_size_) = basis.leftCols(dark_size_);
  for (Index k = 1; k < swing_size_; ++k)
    parts_.col(clock_size_ + dark_size_ + k).head(count_) =
        parts_.col(clock_size_ + dark_size_).head(count_).cwiseProduct(basis.col(k));
}

Eigen::VectorXd ChannelEquations::swing_at(const Eigen::VectorXd& levels) const {
  Eigen::VectorXd height = Eigen::VectorXd::Constant(count_, levels[dark_size_]);
  for (Index k = 1; k < swing_size_; ++k) height += levels[dark_size_ + k] * basis_.col(k).segment(first_, count_);
  return height;
}

void ChannelEquations::scale_clock(const Eigen::Ref<const Eigen::VectorXd>& swing) {
  for (Index k = 0; k < clock_size_; ++k)
    parts_.col(k).head(count_) = by_clock_.col(k).head(count_).cwiseProduct(swing);
}

Eigen::MatrixXd normal_of(const Eigen::Ref<const Eigen::MatrixXd, 0, Eigen::OuterStride<>>& parts) {
  Eigen::MatrixXd products(parts.cols(), parts.cols());
  for (Index k = 0; k < parts.cols(); ++k)
    products.col(k).head(k + 1) = parts.leftCols(k + 1).transpose() * parts.col(k);
  return products.selfadjointView<Eigen::Upper>();
}

std::optional<Eigen::VectorXd> fit_levels(const ChannelEquations& equations) {
  const auto parts = equations.level_parts();
  const auto solved = solve_normal(normal_of(parts), parts.transpose() * equations.values());
  if (!solved) return std::nullopt;
  return solved->values;
}

std::optional<double> squares_left(const ChannelEquations& equations) {
  const auto levels = fit_levels(equations);
  if (!levels) return std::nullopt;
  return (equations.values() - equations.level_parts() * *levels).squaredNorm();
}

std::optional<Linearised> linearise(ChannelEquations& equations, const ChipClock& clock, RowRange range,
                                    const KnownRate& known, const std::optional<Eigen::VectorXd>& nearby) {
  equations.expose(clock, range);
  auto levels = nearby ? nearby : fit_levels(equations);
  if (!levels) return std::nullopt;
  const Index clock_size = equations.clock_size(), level_size = equations.level_size();
  equations.scale_clock(equations.swing_at(*levels));
  const Eigen::VectorXd residual = equations.values() - equations.level_parts() * *levels;
  double squares = residual.squaredNorm();
  Eigen::MatrixXd normal = normal_of(equations.parts());
  Eigen::VectorXd right = equations.parts().transpose() * residual;
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
