#include "ocisac/chips/channel_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "chips/channel_equations.hpp"
#include "chips/channel_growth.hpp"
#include "core/levels.hpp"
#include "ocisac/chips/reduced_search.hpp"
#include "ocisac/core/require.hpp"
#include "rows/exposed_chips.hpp"

namespace ocisac {

namespace {

constexpr int kPasses = 3;
constexpr double kMinShare = 1e-3;   // min fraction of a step; the model has kinks
constexpr double kSmallFall = 1e-5;  // min reduction of the squares by a step, in variances of a row

// The clock after a fraction of the step, limited to the range where the model is nearly linear.
ChipClock stepped(const ChipClock& clock, const ClockStep& step, double share, double half_chips) {
  const double reach = std::max({std::abs(step[0]) / (0.4 * clock.rows_per_chip),
                                 std::abs(step[1]) * half_chips / (0.4 * clock.rows_per_chip), 1.0});
  const double part = share / reach;
  ChipClock next = clock;
  next.rows_per_chip += part * step[1];
  next.phase += part * step[0];
  if (step.size() == 3) {
    const double limit = 0.3 * clock.exposure_rows + 0.3 * clock.rows_per_chip;
    next.exposure_rows = std::clamp(clock.exposure_rows + std::clamp(part * step[2], -limit, limit), kShortestExposure,
                                    kLongestReducedExposure * next.rows_per_chip);
  }
  return next;
}

// True if a part of the step is below this many standard errors.
bool is_small(double share, const Linearised& at, double variance, double errors) {
  for (std::size_t k = 0; k < static_cast<std::size_t>(at.step.size()); ++k)
    if (!(share * std::abs(at.step[static_cast<Eigen::Index>(k)]) <=
          errors * std::sqrt(variance * at.clock_inverse[k][k])))
      return false;
  return true;
}

// Gauss–Newton with step halving until the squares decrease. Clock and errors refer to the equations' origin.
struct Descent {
  ChipClock clock;
  RowRange rows;
  Linearised last;
  bool converged = false;
};

std::optional<Descent> descend(ChannelEquations& equations, ChipClock clock, RowRange range, double half_chips,
                               const KnownRate& known, double vain_step, SearchEffort& effort) {
  const auto rows = static_cast<double>(range.size());
  if (!effort.take(rows)) return std::nullopt;
  auto here = linearise(equations, clock, range, known);
  if (!here) return std::nullopt;
  for (int round = 0; round < kManyIterations; ++round) {
    bool better = false;
    for (double share = 1; share > kMinShare; share *= 0.5) {
      if (!effort.take(rows)) return Descent{clock, range, std::move(*here), false};
      const ChipClock next = stepped(clock, here->step, share, half_chips);
      auto there =
          next.rows_per_chip > 0 ? linearise(equations, next, range, known, here->levels, here->squares) : std::nullopt;
      if (!there) {
        if (is_small(share, *here, here->squares / rows, vain_step)) break;
        continue;
      }
      const double variance = there->squares / rows;
      const bool last = here->squares - there->squares < kSmallFall * variance;
      clock = next;
      here = std::move(there);
      better = true;
      if (last) return Descent{clock, range, std::move(*here), true};
      break;
    }
    if (!better) return Descent{clock, range, std::move(*here), true};  // minimum to full precision
  }
  return Descent{clock, range, std::move(*here), false};
}

ClockErrors errors_of(const ChannelEquations& equations, const LastInverse& inverse, double variance) {
  ClockErrors errors{equations.origin(), {}};
  for (std::size_t i = 0; i < equations.clock_size(); ++i)
    for (std::size_t j = 0; j < equations.clock_size(); ++j) errors.covariance[3 * i + j] = variance * inverse[i][j];
  return errors;
}

}  // namespace

double ClockErrors::phase_std(std::ptrdiff_t at) const {
  const auto away = static_cast<double>(at - chip);
  return std::sqrt(covariance[0] + 2 * away * covariance[1] + away * away * covariance[4]);
}

double ClockErrors::rows_per_chip_std() const { return std::sqrt(covariance[4]); }

double ClockErrors::exposure_rows_std() const { return std::sqrt(covariance[8]); }

double ChannelEstimate::dark_at(double row, std::size_t frame_rows) const {
  return polynomial(dark, along_frame(row, frame_rows));
}

double ChannelEstimate::swing_at(double row, std::size_t frame_rows) const {
  return polynomial(swing, along_frame(row, frame_rows));
}

bool ChannelEstimate::has_other_rate(double rows_per_chip, double tolerance) const {
  const double off = std::abs(clock.rows_per_chip / rows_per_chip - 1);
  const double error = errors.rows_per_chip_std() / rows_per_chip;
  return !(off <= tolerance + std::min(kWeak * error, kNextToNone));
}

std::vector<double> channel_residual(std::span<const double> signal, const KnownChips& chips,
                                     const ChannelEstimate& channel) {
  std::vector<double> exposed(signal.size());
  expose_chips(chips, channel.clock, exposed);
  return residual_beside(signal, exposed, channel);
}

std::vector<double> residual_beside(std::span<const double> signal, std::span<const double> exposed,
                                    const ChannelEstimate& channel) {
  std::vector<double> left(signal.size());
  for (std::size_t n = 0; n < left.size(); ++n) {
    const auto row = static_cast<double>(n);
    left[n] = signal[n] - channel.dark_at(row, left.size()) - channel.swing_at(row, left.size()) * exposed[n];
    left[n] *= channel.clock.share_at(static_cast<std::ptrdiff_t>(n));
  }
  return left;
}

namespace {

// Descent on the rows that depend on known chips only. These rows and their noise depend on the clock.
std::optional<Descent> descend_on_known_rows(ChannelEquations& equations, const KnownChips& chips,
                                             const ChipClock& start, const ChannelModel& model, SearchEffort& effort) {
  const double rate_std = model.rate_std;
  const double half_chips = 0.5 * static_cast<double>(chips.levels.size());
  std::optional<Descent> found;
  ChipClock clock = with_min_exposure(start);
  KnownRate known{start.rows_per_chip, 0};
  for (int pass = 0; pass < kPasses; ++pass) {
    const RowRange now = rows_of(chips, clock, equations.signal().size());
    if (now.size() <= equations.unknowns()) return std::nullopt;
    const bool same = found && now.begin == found->rows.begin && now.end == found->rows.end;
    if (same && (rate_std == 0 || pass == kPasses - 1)) break;
    if (rate_std > 0) {
      const auto before = linearise(equations, moved_to(clock, equations.origin()), now, {});
      if (!before) return std::nullopt;
      const double variance = before->squares / static_cast<double>(now.size());
      known.weight = variance / (rate_std * rate_std);
    }
    found = descend(equations, moved_to(clock, equations.origin()), now, half_chips, known, model.vain_step, effort);
    if (!found) return std::nullopt;
    clock = moved_to(found->clock, -equations.origin());
  }
  return found;
}

}  // namespace

std::optional<ChannelEstimate> fit_channel(std::span<const double> signal, const KnownChips& chips,
                                           const ChipClock& start, const ChannelModel& model, SearchEffort* effort) {
  check_chips(chips);
  check_clock(start);
  check_model(model);
  for (double value : signal) require_finite("signal", value);
  SearchEffort unlimited;
  ChannelEquations equations(signal, chips, model, signal.size());
  const auto found = descend_on_known_rows(equations, chips, start, model, effort == nullptr ? unlimited : *effort);
  if (!found) return std::nullopt;
  const auto freedom = static_cast<double>(found->rows.size()) - static_cast<double>(equations.unknowns());
  const double variance = found->last.squares / freedom;
  return ChannelEstimate{moved_to(found->clock, -equations.origin()),
                         errors_of(equations, found->last.clock_inverse, variance),
                         equations.dark(found->last.levels),
                         equations.swing(found->last.levels),
                         std::sqrt(variance),
                         found->rows,
                         found->converged};
}

std::optional<ClockErrors> clock_bounds(const KnownChips& chips, const ChipClock& clock, std::span<const double> swing,
                                        double noise, const ChannelModel& model) {
  check_chips(chips);
  check_clock(clock);
  check_model(model);
  require_not_negative("noise", noise);
  ChannelEquations equations({}, chips, model, swing.size());
  const std::size_t size = equations.unknowns();
  if (equations.expose_known_rows(clock).size() < size) return std::nullopt;
  NormalProducts& products = equations.products_of(swing);
  const std::size_t period = equations.level_size() + 1;
  if (model.rate_std > 0) products.normal(period, period) += noise * noise / (model.rate_std * model.rate_std);
  const auto inverse = clock_inverse(NormalFactors(products, size), equations.level_size(), equations.clock_size());
  if (!inverse) return std::nullopt;
  return errors_of(equations, *inverse, noise * noise);
}

Pooled pool_estimates(std::span<const double> values, std::span<const double> errors) {
  require(values.size() == errors.size(), "errors", errors.size(), "as many as values");
  double weight = 0, sum = 0, squares = 0;
  std::size_t count = 0;
  std::vector<double> weights(values.size());
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (!(std::isfinite(values[k]) && std::isfinite(errors[k]) && errors[k] > 0)) continue;
    weight += weights[k] = 1 / (errors[k] * errors[k]);
    sum += weights[k] * values[k];
    ++count;
  }
  if (count == 0) return {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN(), 0};
  const double mean = sum / weight;
  for (std::size_t k = 0; k < values.size(); ++k)
    if (weights[k] > 0) squares += weights[k] * (values[k] - mean) * (values[k] - mean);
  const double scatter = count > 1 ? squares / static_cast<double>(count - 1) : 1.0;
  return {mean, std::sqrt(std::max(scatter, 1.0) / weight), count};
}

}  // namespace ocisac
