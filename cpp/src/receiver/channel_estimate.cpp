#include "ocisac/receiver/channel_estimate.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "ocisac/require.hpp"

namespace ocisac {

namespace {

using Eigen::Index;

constexpr int kRounds = 20;
constexpr int kPasses = 3;
constexpr double kLeastShare = 1e-3;     // of a step; the model has kinks
constexpr double kSmallFall = 1e-5;      // of the squares, in variances of a row; so is a step that gains less
constexpr double kSmallStep = 1e-3;      // standard errors; such a step is the last
constexpr double kSettled = 1e-9;        // chips; a step below it is the last
constexpr double kLongestExposure = 24;  // chips
constexpr double kLeastPivot = 1e-11;    // of a normal matrix with a unit diagonal

// s and its derivatives by phase, rows per chip and exposure.
struct Exposed {
  double value, by_phase, by_period, by_exposure;
};

// Chips with their running sums.
class ChipBox {
 public:
  explicit ChipBox(const KnownChips& chips) : levels_(chips.levels), first_(static_cast<double>(chips.first)) {
    sums_.reserve(levels_.size() + 1);
    sums_.push_back(0);
    for (double level : levels_) sums_.push_back(sums_.back() + level);
  }

  // With clock.phase that of chip `origin`.
  [[nodiscard]] Exposed at(double row, const ChipClock& clock, double origin) const {
    const double half = 0.5 * clock.exposure, per_row = 1 / clock.exposure;
    const double chips_begin = (row - half - clock.phase) / clock.rows_per_chip;
    const double chips_end = (row + half - clock.phase) / clock.rows_per_chip;
    const Place begin = place(chips_begin + origin - first_), end = place(chips_end + origin - first_);
    // ∫ chips, in chips: whole ones as a difference of sums of few digits.
    const double area = begin.chip == end.chip
                            ? end.level * clock.exposure / clock.rows_per_chip
                            : (sums_[end.chip] - sums_[begin.chip]) + end.level * end.part - begin.level * begin.part;
    const double value = clock.rows_per_chip * per_row * area;
    return {value, per_row * (begin.level - end.level),
            per_row * (area - end.level * chips_end + begin.level * chips_begin),
            per_row * (0.5 * (begin.level + end.level) - value)};
  }

 private:
  struct Place {
    std::size_t chip;
    double part, level;  // chips past its beginning; its light
  };
  [[nodiscard]] Place place(double chips) const {
    const double last = static_cast<double>(levels_.size() - 1);
    const double whole = std::clamp(std::floor(chips), 0.0, last);
    const auto chip = static_cast<std::size_t>(whole);
    return {chip, chips - whole, levels_[chip]};
  }

  std::span<const double> levels_;
  std::vector<double> sums_;
  double first_;
};

// Legendre polynomials 0 … degree at x.
void legendre(double x, std::size_t degree, double* out) {
  out[0] = 1;
  if (degree > 0) out[1] = x;
  for (std::size_t k = 1; k < degree; ++k) {
    const auto order = static_cast<double>(k);
    out[k + 1] = ((2 * order + 1) * x * out[k] - order * out[k - 1]) / (order + 1);
  }
}

double along_frame(double row, std::size_t rows) {
  return rows < 2 ? 0.0 : 2 * row / static_cast<double>(rows - 1) - 1;
}

double polynomial(std::span<const double> coefficients, double x) {
  std::array<double, kHighestDegree + 1> basis;
  legendre(x, coefficients.size() - 1, basis.data());
  double sum = 0;
  for (std::size_t k = 0; k < coefficients.size(); ++k) sum += coefficients[k] * basis[k];
  return sum;
}

void check_clock(const ChipClock& clock) {
  require_positive("rows_per_chip", clock.rows_per_chip);
  require_finite("phase", clock.phase);
  require_not_negative("exposure", clock.exposure);
}

void check_chips(const KnownChips& chips) {
  require(!chips.levels.empty(), "chips", "none", "at least one chip");
  for (double level : chips.levels) require_finite("chips", level);
}

void check_model(const ChannelModel& model) {
  require(model.dark_degree <= kHighestDegree, "dark_degree", model.dark_degree, "0 to 6");
  require(model.swing_degree <= kHighestDegree, "swing_degree", model.swing_degree, "0 to 6");
  require_not_negative("rate_std", model.rate_std);
}

ChipClock with_least_exposure(ChipClock clock) {
  clock.exposure = std::max(clock.exposure, kShortestExposure);
  return clock;
}

// Weighted least squares of one column of numbers against the parts of the model, by normal equations with a unit
// diagonal. Unknowns: phase, rows per chip, exposure (the first `clock_size` of them), dark levels, swings.
class Problem {
 public:
  Problem(std::span<const double> signal, const KnownChips& chips, const ChannelModel& model, std::size_t rows)
      : signal_(signal),
        box_(chips),
        model_(model),
        origin_(chips.first + static_cast<std::ptrdiff_t>(chips.levels.size() / 2)),
        clock_size_(model.exposure_known ? 2 : 3),
        dark_size_(static_cast<Index>(model.dark_degree + 1)),
        swing_size_(static_cast<Index>(model.swing_degree + 1)),
        basis_size_(static_cast<std::size_t>(std::max(dark_size_, swing_size_))),
        basis_(rows * basis_size_) {
    for (std::size_t n = 0; n < rows; ++n)
      legendre(along_frame(static_cast<double>(n), rows), basis_size_ - 1, &basis_[n * basis_size_]);
  }

  [[nodiscard]] std::ptrdiff_t origin() const { return origin_; }
  [[nodiscard]] Index unknowns() const { return clock_size_ + level_size(); }
  [[nodiscard]] Index clock_size() const { return clock_size_; }
  [[nodiscard]] Index level_size() const { return dark_size_ + swing_size_; }
  [[nodiscard]] std::span<const double> signal() const { return signal_; }

  // For `clock` the s of each row and its derivatives.
  void expose(const ChipClock& clock, RowRange range) {
    exposed_.resize(range.size());
    const auto origin = static_cast<double>(origin_);
    for (std::size_t n = range.begin; n < range.end; ++n)
      exposed_[n - range.begin] = box_.at(static_cast<double>(n), clock, origin);
  }

  // Row n of the model's derivatives by its unknowns, and of its levels: calls use(n, parts). swing_of(n, basis): of
  // row n, by which the clock counts.
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
  ChipBox box_;
  ChannelModel model_;
  std::ptrdiff_t origin_;
  Index clock_size_, dark_size_, swing_size_;
  std::size_t basis_size_;
  std::vector<double> basis_;  // (rows, basis_size_) Legendre polynomials
  std::vector<Exposed> exposed_;
};

// Normal equations scaled to a unit diagonal; absent where columns are dependent.
struct Solved {
  Eigen::VectorXd values;
  Eigen::MatrixXd inverse;
};

std::optional<Solved> solve_normal(const Eigen::MatrixXd& normal, const Eigen::VectorXd& right) {
  const auto diagonal = normal.diagonal().array();
  if (!normal.allFinite()) return std::nullopt;
  const Eigen::VectorXd scale = (diagonal > 0).select(diagonal.max(1e-300).sqrt().inverse(), 0.0);
  const Eigen::MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  const Eigen::LDLT<Eigen::MatrixXd> factored(scaled);
  if (!(factored.vectorD().minCoeff() > kLeastPivot)) return std::nullopt;
  const Eigen::MatrixXd inverse = factored.solve(Eigen::MatrixXd::Identity(normal.rows(), normal.rows()));
  const Eigen::VectorXd values = scale.asDiagonal() * factored.solve(scale.asDiagonal() * right);
  return Solved{values, scale.asDiagonal() * inverse * scale.asDiagonal()};
}

// With the exposure among the unknowns, the third. Where no row tells it from the phase (all edges fall on the same
// part of a row, say) it is left where it is, with an infinite variance.
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

// Levels for a clock, the squares they leave, and the step of the clock that Gauss–Newton takes from there.
struct Linearised {
  Eigen::VectorXd levels, step;
  Eigen::MatrixXd inverse;  // of all unknowns
  double squares = 0;
};

// Sums of products of parts, and of parts and values, row by row; spelled out, the parts being few.
class NormalSums {
 public:
  explicit NormalSums(Index size) : products_(RowMajor::Zero(size, size)), right_(Eigen::VectorXd::Zero(size)) {}

  void add(const double* parts, double value) {
    const Index size = right_.size();
    for (Index i = 0; i < size; ++i) {
      double* row = &products_(i, 0);
      for (Index j = 0; j <= i; ++j) row[j] += parts[i] * parts[j];
      right_[i] += parts[i] * value;
    }
  }
  [[nodiscard]] Eigen::MatrixXd matrix() const { return products_.selfadjointView<Eigen::Lower>(); }
  [[nodiscard]] const Eigen::VectorXd& right() const { return right_; }

 private:
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  RowMajor products_;
  Eigen::VectorXd right_;
};

// Where the clock does not count.
double no_swing(std::size_t, const double*) { return 0; }

double product(const double* parts, const Eigen::VectorXd& values) {
  double sum = 0;
  for (Index k = 0; k < values.size(); ++k) sum += parts[k] * values[k];
  return sum;
}

std::optional<Eigen::VectorXd> fit_levels(const Problem& problem, RowRange range) {
  NormalSums sums(problem.level_size());
  problem.for_each_row(range, no_swing, [&](std::size_t n, const double* parts) {
    sums.add(parts + problem.clock_size(), problem.signal()[n]);
  });
  const auto solved = solve_normal(sums.matrix(), sums.right());
  if (!solved) return std::nullopt;
  return solved->values;
}

// A rate known beforehand, as a reading of it: `weight` is the inverse of its variance in that of a row.
struct KnownRate {
  double rows_per_chip = 0, weight = 0;
};

// `nearby`: levels that suit a clock not far from this one; absent: found first. The derivatives by the clock are taken
// at them.
std::optional<Linearised> linearise(Problem& problem, const ChipClock& clock, RowRange range, const KnownRate& known,
                                    const std::optional<Eigen::VectorXd>& nearby = {}) {
  problem.expose(clock, range);
  auto levels = nearby ? nearby : fit_levels(problem, range);
  if (!levels) return std::nullopt;
  const Index clock_size = problem.clock_size(), level_size = problem.level_size();
  NormalSums sums(problem.unknowns());
  double squares = 0;
  const auto swing = [&](std::size_t, const double* basis) { return problem.swing_of(*levels, basis); };
  problem.for_each_row(range, swing, [&](std::size_t n, const double* parts) {
    const double residual = problem.signal()[n] - product(parts + clock_size, *levels);
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

// A part of the step that keeps the clock where the model is nearly linear; and the clock there.
ChipClock stepped(const ChipClock& clock, const Eigen::VectorXd& step, double share, double half_chips) {
  const double reach = std::max({std::abs(step[0]) / (0.4 * clock.rows_per_chip),
                                 std::abs(step[1]) * half_chips / (0.4 * clock.rows_per_chip), 1.0});
  const double part = share / reach;
  ChipClock next{clock.rows_per_chip + part * step[1], clock.phase + part * step[0], clock.exposure};
  if (step.size() == 3) {
    const double limit = 0.3 * clock.exposure + 0.3 * clock.rows_per_chip;
    next.exposure = std::clamp(clock.exposure + std::clamp(part * step[2], -limit, limit), kShortestExposure,
                               kLongestExposure * next.rows_per_chip);
  }
  return next;
}

// A step beside the standard errors of what it changes.
bool is_small(const Eigen::VectorXd& step, const Eigen::MatrixXd& inverse, double variance) {
  for (Index k = 0; k < step.size(); ++k)
    if (!(std::abs(step[k]) <= kSmallStep * std::sqrt(variance * inverse(k, k)))) return false;
  return true;
}

// Gauss–Newton with a step halved until the squares fall. Clock and errors refer to the problem's origin.
struct Fitted {
  ChipClock clock;
  Linearised last;
  bool converged = false;
};

std::optional<Fitted> descend(Problem& problem, ChipClock clock, RowRange range, double half_chips,
                              const KnownRate& known, SearchEffort& effort) {
  const auto rows = static_cast<double>(range.size());
  if (!effort.take(rows)) return std::nullopt;
  auto here = linearise(problem, clock, range, known);
  if (!here) return std::nullopt;
  for (int round = 0; round < kRounds; ++round) {
    bool better = false;
    for (double share = 1; share > kLeastShare; share *= 0.5) {
      if (!effort.take(rows)) return Fitted{clock, std::move(*here), false};
      const ChipClock next = stepped(clock, here->step, share, half_chips);
      auto there = next.rows_per_chip > 0 ? linearise(problem, next, range, known, here->levels) : std::nullopt;
      if (!there || there->squares > here->squares) continue;
      const double variance = there->squares / static_cast<double>(range.size());
      const bool last =
          is_small(here->step, here->inverse, variance) || here->squares - there->squares < kSmallFall * variance;
      const double moved =
          std::max({std::abs(next.phase - clock.phase), half_chips * std::abs(next.rows_per_chip - clock.rows_per_chip),
                    std::abs(next.exposure - clock.exposure)});
      clock = next;
      here = std::move(there);
      better = true;
      if (last || moved < kSettled * clock.rows_per_chip) return Fitted{clock, std::move(*here), true};
      break;
    }
    if (!better) return Fitted{clock, std::move(*here), true};  // at the bottom to the last digit
  }
  return Fitted{clock, std::move(*here), false};
}

ClockErrors errors_of(const Problem& problem, const Eigen::MatrixXd& inverse, double variance) {
  ClockErrors errors{problem.origin(), {}};
  for (Index i = 0; i < problem.clock_size(); ++i)
    for (Index j = 0; j < problem.clock_size(); ++j)
      errors.covariance[static_cast<std::size_t>(3 * i + j)] = variance * inverse(i, j);
  return errors;
}

ChipClock moved_to(ChipClock clock, std::ptrdiff_t chips) {
  clock.phase += static_cast<double>(chips) * clock.rows_per_chip;
  return clock;
}

}  // namespace

void expose_chips(const KnownChips& chips, const ChipClock& clock, std::span<double> out) {
  check_chips(chips);
  check_clock(clock);
  const ChipBox box(chips);
  const ChipClock used = with_least_exposure(clock);
  for (std::size_t n = 0; n < out.size(); ++n) out[n] = box.at(static_cast<double>(n), used, 0).value;
}

RowRange rows_of(const KnownChips& chips, const ChipClock& clock, std::size_t rows) {
  const auto first = static_cast<double>(chips.first), count = static_cast<double>(chips.levels.size());
  const double begin = clock.phase + first * clock.rows_per_chip + 0.5 * clock.exposure;
  const double end = clock.phase + (first + count) * clock.rows_per_chip - 0.5 * clock.exposure;
  const double limit = static_cast<double>(rows);
  const double low = std::clamp(std::ceil(begin), 0.0, limit), high = std::clamp(std::floor(end) + 1, low, limit);
  return {static_cast<std::size_t>(low), static_cast<std::size_t>(high)};
}

double ClockErrors::phase_std(std::ptrdiff_t at) const {
  const auto away = static_cast<double>(at - chip);
  return std::sqrt(covariance[0] + 2 * away * covariance[1] + away * away * covariance[4]);
}

double ClockErrors::rows_per_chip_std() const { return std::sqrt(covariance[4]); }

double ClockErrors::exposure_std() const { return std::sqrt(covariance[8]); }

double ChannelEstimate::dark_at(double row, std::size_t frame_rows) const {
  return polynomial(dark, along_frame(row, frame_rows));
}

double ChannelEstimate::swing_at(double row, std::size_t frame_rows) const {
  return polynomial(swing, along_frame(row, frame_rows));
}

std::optional<ChannelEstimate> fit_channel(std::span<const double> signal, const KnownChips& chips,
                                           const ChipClock& start, const ChannelModel& model, SearchEffort* effort) {
  SearchEffort unlimited;
  check_chips(chips);
  check_clock(start);
  check_model(model);
  for (double value : signal) require_finite("signal", value);
  Problem problem(signal, chips, model, signal.size());
  const double half_chips = 0.5 * static_cast<double>(chips.levels.size());
  ChipClock clock = with_least_exposure(start);
  std::optional<Fitted> fitted;
  RowRange range;
  KnownRate known{start.rows_per_chip, 0};
  for (int pass = 0; pass < kPasses; ++pass) {  // which rows see known chips only, and their noise, depend on the clock
    const RowRange now = rows_of(chips, clock, signal.size());
    if (now.size() <= static_cast<std::size_t>(problem.unknowns())) return std::nullopt;
    const bool same = pass > 0 && now.begin == range.begin && now.end == range.end;
    if (same && (model.rate_std == 0 || pass == kPasses - 1)) break;
    range = now;
    if (model.rate_std > 0) {
      const auto before = linearise(problem, moved_to(clock, problem.origin()), range, {});
      if (!before) return std::nullopt;
      const double variance = before->squares / static_cast<double>(range.size());
      known.weight = variance / (model.rate_std * model.rate_std);
    }
    fitted = descend(problem, moved_to(clock, problem.origin()), range, half_chips, known,
                     effort == nullptr ? unlimited : *effort);
    if (!fitted) return std::nullopt;
    clock = moved_to(fitted->clock, -problem.origin());
  }
  const auto freedom = static_cast<double>(range.size()) - static_cast<double>(problem.unknowns());
  const double variance = fitted->last.squares / freedom;
  return ChannelEstimate{clock,
                         errors_of(problem, fitted->last.inverse, variance),
                         problem.dark(fitted->last.levels),
                         problem.swing(fitted->last.levels),
                         std::sqrt(variance),
                         range,
                         fitted->converged};
}

std::optional<LevelSquares> level_squares(std::span<const double> signal, const KnownChips& chips,
                                          const ChipClock& clock, const ChannelModel& model) {
  check_chips(chips);
  check_clock(clock);
  check_model(model);
  const ChipClock used = with_least_exposure(clock);
  const RowRange range = rows_of(chips, used, signal.size());
  Problem problem(signal, chips, model, signal.size());
  if (range.size() <= static_cast<std::size_t>(problem.level_size())) return std::nullopt;
  problem.expose(moved_to(used, problem.origin()), range);
  const auto levels = fit_levels(problem, range);
  if (!levels) return std::nullopt;
  double squares = 0;
  problem.for_each_row(range, no_swing, [&](std::size_t n, const double* parts) {
    const double residual = signal[n] - product(parts + problem.clock_size(), *levels);
    squares += residual * residual;
  });
  return LevelSquares{squares, range.size()};
}

std::optional<ClockErrors> clock_bounds(const KnownChips& chips, const ChipClock& clock, std::span<const double> swing,
                                        double noise, const ChannelModel& model) {
  check_chips(chips);
  check_clock(clock);
  check_model(model);
  require_not_negative("noise", noise);
  const ChipClock used = with_least_exposure(clock);
  const RowRange range = rows_of(chips, used, swing.size());
  Problem problem({}, chips, model, swing.size());
  problem.expose(moved_to(used, problem.origin()), range);
  const Index size = problem.unknowns();
  if (range.size() < static_cast<std::size_t>(size)) return std::nullopt;
  NormalSums sums(size);
  problem.for_each_row(
      range, [&](std::size_t n, const double*) { return swing[n]; },
      [&](std::size_t, const double* parts) { sums.add(parts, 0.0); });
  Eigen::MatrixXd normal = sums.matrix();
  if (model.rate_std > 0) normal(1, 1) += noise * noise / (model.rate_std * model.rate_std);
  const auto solved = model.exposure_known ? solve_normal(normal, sums.right()) : solve_clock(normal, sums.right());
  if (!solved) return std::nullopt;
  return errors_of(problem, solved->inverse, noise * noise);
}

Pooled pool_estimates(std::span<const double> values, std::span<const double> errors) {
  require(values.size() == errors.size(), "errors", errors.size(), "as many as values");
  double weight = 0, sum = 0, squares = 0;
  std::size_t count = 0;
  const auto weight_of = [&](std::size_t k) {
    const bool counts = std::isfinite(values[k]) && std::isfinite(errors[k]) && errors[k] > 0;
    return counts ? 1 / (errors[k] * errors[k]) : 0.0;
  };
  for (std::size_t k = 0; k < values.size(); ++k) {
    const double w = weight_of(k);
    weight += w;
    if (w > 0) sum += w * values[k];
    count += w > 0;
  }
  if (count == 0) return {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN(), 0};
  const double mean = sum / weight;
  for (std::size_t k = 0; k < values.size(); ++k)
    if (const double w = weight_of(k); w > 0) squares += w * (values[k] - mean) * (values[k] - mean);
  const double scatter = count > 1 ? squares / static_cast<double>(count - 1) : 1.0;
  return {mean, std::sqrt(std::max(scatter, 1.0) / weight), count};
}

}  // namespace ocisac
