#include "chips/channel_equations.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "chips/channel_kernels.hpp"
#include "core/linear_algebra.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

using Eigen::Index;

void check_model(const ChannelModel& model) {
  require(model.dark_degree <= kHighestDegree, "dark_degree", model.dark_degree, "0 to 6");
  require(model.swing_degree <= kHighestDegree, "swing_degree", model.swing_degree, "0 to 6");
  require_not_negative("rate_std", model.rate_std);
  require_not_negative("vain_step", model.vain_step);
}

double along_frame(double row, std::size_t rows) {
  return rows < 2 ? 0.0 : 2 * row / static_cast<double>(rows - 1) - 1;
}

// Clenshaw's recurrence, from d·L_d = (2d − 1)·x·L_{d−1} − (d − 1)·L_{d−2}.
double polynomial(std::span<const double> coefficients, double x) {
  double next = 0, after = 0;
  for (std::size_t k = coefficients.size() - 1; k > 0; --k) {
    const auto degree = static_cast<double>(k);
    const double sum =
        coefficients[k] + (2 * degree + 1) / (degree + 1) * x * next - (degree + 1) / (degree + 2) * after;
    after = std::exchange(next, sum);
  }
  return coefficients[0] + x * next - 0.5 * after;
}

ChannelEquations::ChannelEquations(std::span<const double> signal, const KnownChips& chips, const ChannelModel& model,
                                   std::size_t rows)
    : signal_(signal),
      chips_(chips),
      box_(chips, {}),
      origin_(chips.first + static_cast<std::ptrdiff_t>(chips.levels.size() / 2)),
      frame_rows_(rows),
      clock_size_(model.exposure_known ? 2 : 3),
      dark_size_(model.dark_degree + 1),
      swing_size_(model.swing_degree + 1),
      basis_size_(std::max(dark_size_, swing_size_)) {}

// Legendre polynomials and the signal at the rows of a range.
void ChannelEquations::use_rows(RowRange range) {
  if (columns_ != nullptr && range.begin == rows_.begin && range.end == rows_.end) return;
  rows_ = range;
  padded_ = (range.size() + kernels::kRowGroup - 1) / kernels::kRowGroup * kernels::kRowGroup;
  columns_ = memory_.at_least(padded_ * (basis_size_ + swing_size_ + 2 * kMaxClock + 3));
  for (std::size_t k = 0; k < basis_size_; ++k) std::fill(basis(k) + range.size(), basis(k + 1), 0.0);
  std::fill_n(basis(0), range.size(), 1.0);
  for (std::size_t n = 0; n < range.size() && basis_size_ > 1; ++n)
    basis(1)[n] = along_frame(static_cast<double>(range.begin + n), frame_rows_);
  for (std::size_t k = 2; k < basis_size_; ++k) {
    const auto degree = static_cast<double>(k);
    for (std::size_t n = 0; n < range.size(); ++n)
      basis(k)[n] = ((2 * degree - 1) * basis(1)[n] * basis(k - 1)[n] - (degree - 1) * basis(k - 2)[n]) / degree;
  }
  std::fill_n(values(), padded_, 0.0);
  if (!signal_.empty()) std::copy_n(signal_.data() + range.begin, range.size(), values());
}

void ChannelEquations::expose(const ChipClock& clock, RowRange range) {
  use_rows(range);
  if (!box_.has_shape_of(clock)) box_ = ChipBox(chips_, clock);
  const auto first = static_cast<double>(range.begin), origin = static_cast<double>(origin_);
  weights_.clear();
  for (std::size_t n = 0; n < range.size() && clock.shorter != 1; ++n)
    weights_.push_back(clock.share_at(static_cast<std::ptrdiff_t>(range.begin + n)));
  if (box_.is_at_once() && clock.shorter == 1) {
    kernels::expose_rows({box_.targets().data(), box_.sums().data(), box_.targets().size()},
                         {first, origin - box_.first(), clock.phase, clock.rows_per_chip, clock.exposure_rows}, padded_,
                         {exposed(0), by_clock(0), by_clock(1), by_clock(2)});
  } else {
    for (std::size_t n = 0; n < range.size(); ++n) {
      const Exposed seen = box_.at(first + static_cast<double>(n), clock, origin);
      exposed(0)[n] = seen.value;
      by_clock(0)[n] = seen.by_phase;
      by_clock(1)[n] = seen.by_period;
      by_clock(2)[n] = seen.by_exposure;
    }
  }
  std::fill(exposed(0) + range.size(), exposed(1), 0.0);
  for (std::size_t k = 0; k < kMaxClock; ++k) std::fill(by_clock(k) + range.size(), by_clock(k + 1), 0.0);
  for (std::size_t k = 1; k < swing_size_; ++k)
    std::transform(exposed(0), exposed(1), basis(k), exposed(k), std::multiplies{});
}

RowRange ChannelEquations::expose_known_rows(const ChipClock& clock) {
  const ChipClock used = with_min_exposure(clock);
  const RowRange range = rows_of(chips_, used, frame_rows_);
  if (range.size() > 0) expose(moved_to(used, origin_), range);
  return range;
}

void ChannelEquations::subtract(const Levels& levels, std::size_t dark_size) {
  const std::span<const double> all(levels.data(), static_cast<std::size_t>(levels.size()));
  kernels::subtract_levels({basis(0), exposed(0), values(), padded_, all.first(dark_size), all.subspan(dark_size)},
                           padded_, swing(), left());
}

// With the clock: adds its products to those of all levels.
NormalProducts& ChannelEquations::multiply(const double* explained, std::size_t dark_size, std::size_t swing_size,
                                           bool with_clock) {
  std::array<const double*, NormalProducts::kStride> columns{explained};
  std::size_t count = 1;
  for (std::size_t k = 0; k < dark_size; ++k) columns[count++] = basis(k);
  for (std::size_t k = 0; k < swing_size; ++k) columns[count++] = exposed(k);
  const std::size_t first = with_clock ? count : 0;
  for (std::size_t k = 0; k < clock_size_ && with_clock; ++k) columns[count++] = scaled_clock(k);
  weighted_.assign(weights_.empty() ? 0 : count * padded_, 0.0);
  for (std::size_t k = 0; k < count && !weights_.empty(); ++k) {
    double* const weighted = &weighted_[k * padded_];
    std::ranges::transform(weights_, std::span(columns[k], weights_.size()), weighted, std::multiplies{});
    columns[k] = weighted;
  }
  kernels::inner_products({columns.data(), count}, first, padded_, products_.data(), NormalProducts::kStride);
  return products_;
}

std::optional<Levels> ChannelEquations::fit_levels(std::size_t dark_size, std::size_t swing_size) {
  const std::size_t size = dark_size + swing_size;
  const NormalFactors factors(multiply(values(), dark_size, swing_size, false), size);
  if (factors.solvable() < size) return std::nullopt;
  Levels levels(static_cast<Index>(size));
  factors.solve({levels.data(), size});
  return levels;
}

double ChannelEquations::squares_left(const Levels& levels, std::size_t dark_size) {
  subtract(levels, dark_size);
  double squares = 0;
  for (std::size_t n = 0; n < rows_.size(); ++n)
    squares += std::pow((weights_.empty() ? 1.0 : weights_[n]) * left()[n], 2);
  return squares;
}

NormalProducts& ChannelEquations::level_products_about(const Levels& levels) {
  subtract(levels, dark_size_);
  return multiply(left(), dark_size_, swing_size_, false);
}

NormalProducts& ChannelEquations::with_clock() {
  for (std::size_t k = 0; k < clock_size_; ++k)
    std::transform(by_clock(k), by_clock(k + 1), swing(), scaled_clock(k), std::multiplies{});
  return multiply(left(), dark_size_, swing_size_, true);
}

NormalProducts& ChannelEquations::products_of(std::span<const double> swing_of_rows) {
  std::fill(std::copy_n(swing_of_rows.data() + rows_.begin, rows_.size(), swing()), swing() + padded_, 0.0);
  std::fill_n(left(), padded_, 0.0);
  multiply(left(), dark_size_, swing_size_, false);
  return with_clock();
}

std::optional<LastInverse> clock_inverse(const NormalFactors& factors, std::size_t level_size, std::size_t clock_size) {
  if (factors.solvable() < level_size + std::min<std::size_t>(clock_size, 2)) return std::nullopt;
  LastInverse inverse = factors.inverse_from(level_size);
  if (factors.solvable() < level_size + clock_size) inverse[2][2] = std::numeric_limits<double>::infinity();
  return inverse;
}

namespace {

// The levels at a clock beside which `levels` were fitted, and the squares they leave.
std::optional<double> move_levels(const NormalProducts& products, Levels& levels) {
  const auto size = static_cast<std::size_t>(levels.size());
  const NormalFactors factors(products, size);
  if (factors.solvable() < size) return std::nullopt;
  Levels change(levels.size());
  factors.solve({change.data(), size});
  levels += change;
  double squares = products.squares();
  for (std::size_t k = 0; k < size; ++k) squares -= change[static_cast<Index>(k)] * products.right(k);
  return std::max(squares, 0.0);
}

}  // namespace

std::optional<Linearised> linearise(ChannelEquations& equations, const ChipClock& clock, RowRange range,
                                    const KnownRate& known, const std::optional<Levels>& nearby, double max_squares) {
  equations.expose(clock, range);
  auto levels = nearby ? nearby : equations.fit_levels();
  if (!levels) return std::nullopt;
  const NormalProducts& of_levels = equations.level_products_about(*levels);
  const double off = known.rows_per_chip - clock.rows_per_chip;
  auto squares = nearby ? move_levels(of_levels, *levels) : of_levels.squares();
  if (!squares || (*squares += known.weight * off * off) > max_squares) return std::nullopt;
  NormalProducts& products = equations.with_clock();
  const std::size_t level_size = equations.level_size(), period = level_size + 1;
  products.normal(period, period) += known.weight;
  products.right(period) += known.weight * off;
  const NormalFactors factors(products, equations.unknowns());
  const auto inverse = clock_inverse(factors, level_size, equations.clock_size());
  if (!inverse) return std::nullopt;
  std::array<double, NormalProducts::kMost> values{};
  factors.solve({values.data(), factors.solvable()});
  ClockStep step(static_cast<Index>(equations.clock_size()));
  std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(level_size), step.size(), step.begin());
  return Linearised{*levels, step, *inverse, *squares};
}

}  // namespace ocisac
