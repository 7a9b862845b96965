// Rows as equations of the channel parameters (clock and levels), linearised about a clock.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "core/aligned_memory.hpp"
#include "ocisac/chips/channel_estimate.hpp"
#include "rows/exposed_chips.hpp"
#include "rows/normal_factors.hpp"

namespace ocisac {

void check_model(const ChannelModel& model);

// Position of a row along the frame, −1 … 1; a sum of Legendre polynomials at such a position.
double along_frame(double row, std::size_t rows);
double polynomial(std::span<const double> coefficients, double x);

inline constexpr Eigen::Index kMaxLevels = 2 * (static_cast<Eigen::Index>(kHighestDegree) + 1), kMaxClock = 3;
using Levels = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxLevels, 1>;  // of dark, then of swing
using ClockStep = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxClock, 1>;

// Least squares of one column against the model's derivatives, by normal equations.
// Unknowns: dark levels, swings, phase, rows per chip, exposure (unless it is known).
class ChannelEquations {
 public:
  ChannelEquations(std::span<const double> signal, const KnownChips& chips, const ChannelModel& model,
                   std::size_t rows);

  [[nodiscard]] std::ptrdiff_t origin() const { return origin_; }
  [[nodiscard]] std::size_t unknowns() const { return level_size() + clock_size_; }
  [[nodiscard]] std::size_t clock_size() const { return clock_size_; }
  [[nodiscard]] std::size_t level_size() const { return dark_size_ + swing_size_; }
  [[nodiscard]] std::span<const double> signal() const { return signal_; }

  // Computes s of each row of `range` and its derivatives for `clock`.
  void expose(const ChipClock& clock, RowRange range);
  // The same of the rows that depend on known chips only, with chip 0's phase; returns them.
  RowRange expose_known_rows(const ChipClock& clock);

  // Fits levels of the given numbers of degrees to the exposed rows, by least squares; sums the squares of the rows
  // that levels leave.
  [[nodiscard]] std::optional<Levels> fit_levels(std::size_t dark_size, std::size_t swing_size);
  [[nodiscard]] std::optional<Levels> fit_levels() { return fit_levels(dark_size_, swing_size_); }
  [[nodiscard]] double squares_left(const Levels& levels, std::size_t dark_size);

  // Inner products of the derivatives with each other and with what `levels` leave of the exposed rows: first those by
  // the levels, then those by the clock as well. Valid until the next call.
  [[nodiscard]] NormalProducts& level_products_about(const Levels& levels);
  [[nodiscard]] NormalProducts& with_clock();
  // All of them for a swing of each row of the frame, and nothing left.
  [[nodiscard]] NormalProducts& products_of(std::span<const double> swing);

  [[nodiscard]] std::vector<double> dark(const Levels& levels) const {
    return {levels.begin(), levels.begin() + static_cast<Eigen::Index>(dark_size_)};
  }
  [[nodiscard]] std::vector<double> swing(const Levels& levels) const {
    return {levels.begin() + static_cast<Eigen::Index>(dark_size_), levels.end()};
  }

 private:
  [[nodiscard]] double* column(std::size_t k) { return columns_ + k * padded_; }
  [[nodiscard]] double* basis(std::size_t degree) { return column(degree); }
  [[nodiscard]] double* exposed(std::size_t degree) { return column(basis_size_ + degree); }  // s · basis
  [[nodiscard]] double* by_clock(std::size_t k) { return exposed(swing_size_) + k * padded_; }
  [[nodiscard]] double* scaled_clock(std::size_t k) { return by_clock(kMaxClock) + k * padded_; }  // by the swing
  [[nodiscard]] double* values() { return scaled_clock(kMaxClock); }
  [[nodiscard]] double* left() { return values() + padded_; }
  [[nodiscard]] double* swing() { return left() + padded_; }

  void use_rows(RowRange range);
  void subtract(const Levels& levels, std::size_t dark_size);  // fills left() and swing()
  NormalProducts& multiply(const double* explained, std::size_t dark_size, std::size_t swing_size, bool with_clock);

  std::span<const double> signal_;
  KnownChips chips_;
  ChipBox box_;
  std::ptrdiff_t origin_;
  std::size_t frame_rows_, clock_size_, dark_size_, swing_size_, basis_size_;
  RowRange rows_{};         // exposed
  std::size_t padded_ = 0;  // a multiple of what kernels ask for; beyond the rows all columns that are multiplied are 0
  std::vector<double> weights_;   // of the exposed rows; empty: 1
  std::vector<double> weighted_;  // columns that are multiplied, times the weights
  AlignedMemory<double> memory_;
  double* columns_ = nullptr;
  NormalProducts products_;
};

// Levels for a clock, their residual squares, and the Gauss–Newton step of the clock. If the rows do not separate the
// exposure from the phase (for example, all edges at the same fraction of a row) it is kept, with infinite variance.
struct Linearised {
  Levels levels;
  ClockStep step;
  LastInverse clock_inverse;  // of the normal matrix of all unknowns, at the clock's
  double squares = 0;
};

// Prior of the rate as a measurement; `weight`: variance of a row over its variance.
struct KnownRate {
  double rows_per_chip = 0, weight = 0;
};

// `nearby`: levels for a similar clock, at which the derivatives by the clock are evaluated; absent: estimated first.
// Absent where more than `max_squares` are left, too.
std::optional<Linearised> linearise(ChannelEquations& equations, const ChipClock& clock, RowRange range,
                                    const KnownRate& known, const std::optional<Levels>& nearby = {},
                                    double max_squares = std::numeric_limits<double>::infinity());

// Inverse of the normal matrix at the clock, as of Linearised; absent where other unknowns depend on each other.
std::optional<LastInverse> clock_inverse(const NormalFactors& factors, std::size_t level_size, std::size_t clock_size);

}  // namespace ocisac
