// Rows as equations of the channel parameters (clock and levels), linearised about a clock.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "chips/exposed_chips.hpp"
#include "core/legendre.hpp"
#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

void check_model(const ChannelModel& model);

// Position of a row along the frame, −1 … 1; a sum of Legendre polynomials at such a position.
double along_frame(double row, std::size_t rows);
double polynomial(std::span<const double> coefficients, double x);

// Weighted least squares of one column against the model's derivatives, by normal equations with a unit diagonal.
// Unknowns: phase, rows per chip, exposure (the first `clock_size` of them), dark levels, swings.
class ChannelEquations {
 public:
  using Index = Eigen::Index;

  ChannelEquations(std::span<const double> signal, const KnownChips& chips, const ChannelModel& model, std::size_t rows)
      : signal_(signal),
        chips_(chips),
        box_(chips, {}),
        model_(model),
        origin_(chips.first + static_cast<std::ptrdiff_t>(chips.levels.size() / 2)),
        clock_size_(model.exposure_known ? 2 : 3),
        dark_size_(static_cast<Index>(model.dark_degree + 1)),
        swing_size_(static_cast<Index>(model.swing_degree + 1)),
        basis_size_(static_cast<std::size_t>(std::max(dark_size_, swing_size_))),
        basis_(rows * basis_size_) {
    for (std::size_t n = 0; n < rows; ++n)
      legendre(along_frame(static_cast<double>(n), rows), {&basis_[n * basis_size_], basis_size_});
  }

  [[nodiscard]] std::ptrdiff_t origin() const { return origin_; }
  [[nodiscard]] Index unknowns() const { return clock_size_ + level_size(); }
  [[nodiscard]] Index clock_size() const { return clock_size_; }
  [[nodiscard]] Index level_size() const { return dark_size_ + swing_size_; }
  [[nodiscard]] std::span<const double> signal() const { return signal_; }

  // Computes s of each row and its derivatives for `clock`.
  void expose(const ChipClock& clock, RowRange range) {
    if (!box_.has_shape_of(clock)) box_ = ChipBox(chips_, clock);
    exposed_.resize(range.size());
    const auto origin = static_cast<double>(origin_);
    for (std::size_t n = range.begin; n < range.end; ++n)
      exposed_[n - range.begin] = box_.at(static_cast<double>(n), clock, origin);
  }

  // Calls use(n, parts) for each row n with the derivatives of the model. height_of(n, basis): swing of row n, which
  // scales the derivatives by the clock.
  template <class Swing, class Use>
  void for_each_row(RowRange range, Swing height_of, Use use) const {
    std::array<double, 3 + 2 * (kHighestDegree + 1)> parts{};
    double* const dark = &parts[static_cast<std::size_t>(clock_size_)];
    double* const swing = dark + dark_size_;
    for (std::size_t n = range.begin; n < range.end; ++n) {
      const Exposed& seen = exposed_[n - range.begin];
      const double* basis = &basis_[n * basis_size_];
      const double height = height_of(n, basis);
      parts[0] = height * seen.by_phase;
      parts[1] = height * seen.by_period;
      if (clock_size_ == 3) parts[2] = height * seen.by_exposure;
      for (Index k = 0; k < dark_size_; ++k) dark[k] = basis[k];
      for (Index k = 0; k < swing_size_; ++k) swing[k] = seen.value * basis[k];
      use(n, parts.data());
    }
  }

  [[nodiscard]] double swing_of(const Eigen::VectorXd& levels, const double* basis) const {
    double sum = 0;
    for (Index k = 0; k < swing_size_; ++k) sum += levels[dark_size_ + k] * basis[k];
    return sum;
  }

  [[nodiscard]] std::vector<double> dark(const Eigen::VectorXd& levels) const {
    return {levels.begin(), levels.begin() + dark_size_};
  }
  [[nodiscard]] std::vector<double> swing(const Eigen::VectorXd& levels) const {
    return {levels.begin() + dark_size_, levels.end()};
  }

 private:
  std::span<const double> signal_;
  KnownChips chips_;
  ChipBox box_;
  ChannelModel model_;
  std::ptrdiff_t origin_;
  Index clock_size_, dark_size_, swing_size_;
  std::size_t basis_size_;
  std::vector<double> basis_;  // (rows, basis_size_) Legendre polynomials
  std::vector<Exposed> exposed_;
};

// Solution of normal equations scaled to a unit diagonal; absent where columns are dependent.
struct Solved {
  Eigen::VectorXd values;
  Eigen::MatrixXd inverse;
};

std::optional<Solved> solve_normal(const Eigen::MatrixXd& normal, const Eigen::VectorXd& right);

// Solution with the exposure as third unknown. If the rows do not separate it from the phase (for example, all edges at
// the same fraction of a row) it is kept, with infinite variance.
std::optional<Solved> solve_clock(const Eigen::MatrixXd& normal, const Eigen::VectorXd& right);

// Sums of products of parts, and of parts and values, over rows: of as many rows at once as fit into a block, each part
// of which is contiguous.
class NormalSums {
 public:
  explicit NormalSums(Eigen::Index size)
      : products_(Eigen::MatrixXd::Zero(size + 1, size + 1)), block_(kRows, size + 1) {}

  void add(const double* parts, double value) {
    const Eigen::Index size = block_.cols() - 1;
    for (Eigen::Index k = 0; k < size; ++k) block_(filled_, k) = parts[k];
    block_(filled_, size) = value;
    if (++filled_ == kRows) sum_block();
  }
  // Sums of all rows; later ones may be added.
  [[nodiscard]] Eigen::MatrixXd matrix() {
    sum_block();
    const Eigen::Index size = block_.cols() - 1;
    return products_.topLeftCorner(size, size).selfadjointView<Eigen::Lower>();
  }
  [[nodiscard]] Eigen::VectorXd right() {
    sum_block();
    return products_.row(block_.cols() - 1).head(block_.cols() - 1);
  }

 private:
  static constexpr Eigen::Index kRows = 64;

  void sum_block() {
    block_.bottomRows(kRows - filled_).setZero();
    for (Eigen::Index i = 0; i < block_.cols(); ++i)
      for (Eigen::Index j = 0; j <= i; ++j) products_(i, j) += block_.col(i).dot(block_.col(j));
    filled_ = 0;
  }

  Eigen::MatrixXd products_;  // lower half; values last
  Eigen::Matrix<double, kRows, Eigen::Dynamic> block_;
  Eigen::Index filled_ = 0;
};

// Least-squares levels at the last exposed clock.
std::optional<Eigen::VectorXd> fit_levels(const ChannelEquations& equations, RowRange range);

// Residual squares of the best levels at the last exposed clock.
std::optional<double> squares_left(const ChannelEquations& equations, RowRange range);

// Levels for a clock, their residual squares, and the Gauss–Newton step of the clock.
struct Linearised {
  Eigen::VectorXd levels, step;
  Eigen::MatrixXd inverse;  // of all unknowns
  double squares = 0;
};

// Prior of the rate as a measurement; `weight`: variance of a row over its variance.
struct KnownRate {
  double rows_per_chip = 0, weight = 0;
};

// `nearby`: levels for a similar clock, at which the derivatives by the clock are evaluated; absent: estimated first.
std::optional<Linearised> linearise(ChannelEquations& equations, const ChipClock& clock, RowRange range,
                                    const KnownRate& known, const std::optional<Eigen::VectorXd>& nearby = {});

}  // namespace ocisac
