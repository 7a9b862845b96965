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

// Least squares of one column against the model's derivatives, by normal equations with a unit diagonal.
// Unknowns: phase, rows per chip, exposure (the first `clock_size` of them), dark levels, swings.
class ChannelEquations {
 public:
  using Index = Eigen::Index;

  ChannelEquations(std::span<const double> signal, const KnownChips& chips, const ChannelModel& model,
                   std::size_t rows);

  [[nodiscard]] std::ptrdiff_t origin() const { return origin_; }
  [[nodiscard]] Index unknowns() const { return clock_size_ + level_size(); }
  [[nodiscard]] Index clock_size() const { return clock_size_; }
  [[nodiscard]] Index level_size() const { return dark_size_ + swing_size_; }
  [[nodiscard]] std::span<const double> signal() const { return signal_; }

  // Computes s of each row of `range` and its derivatives for `clock`.
  void expose(const ChipClock& clock, RowRange range);
  // Swing of each exposed row.
  [[nodiscard]] Eigen::VectorXd swing_at(const Eigen::VectorXd& levels) const;
  // Scales the derivatives by the clock with the swing of each exposed row.
  void scale_clock(const Eigen::Ref<const Eigen::VectorXd>& swing);

  // Derivatives of the exposed rows, (rows × unknowns); those by the clock after scale_clock. Those by the levels.
  [[nodiscard]] auto parts() const { return parts_.topRows(count_); }
  [[nodiscard]] auto level_parts() const { return parts_.topRightCorner(count_, level_size()); }
  // The exposed rows of the signal.
  [[nodiscard]] Eigen::Map<const Eigen::VectorXd> values() const { return {signal_.data() + first_, count_}; }

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
  std::ptrdiff_t origin_;
  Index clock_size_, dark_size_, swing_size_;
  Index first_ = 0, count_ = 0;  // exposed rows
  Eigen::MatrixXd basis_;        // (rows × levels of dark or swing) Legendre polynomials
  Eigen::MatrixXd by_clock_;     // (rows × clock) derivatives of s
  Eigen::MatrixXd parts_;        // (rows × unknowns)
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

// PᵀP of parts P, (rows × unknowns).
Eigen::MatrixXd normal_of(const Eigen::Ref<const Eigen::MatrixXd, 0, Eigen::OuterStride<>>& parts);

// Least-squares levels at the last exposed clock.
std::optional<Eigen::VectorXd> fit_levels(const ChannelEquations& equations);

// Residual squares of the best levels at the last exposed clock.
std::optional<double> squares_left(const ChannelEquations& equations);

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
