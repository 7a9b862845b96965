#include "ocisac/exposure/best_exposure.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "core/check_interrupt.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

using std::numbers::pi;
constexpr double max_candidates = 1e7;

void check_frequency(double frequency) {
  require(std::isfinite(frequency) && frequency > 0 && std::isfinite(1 / frequency), "frequency", frequency,
          "a finite number above 0 (Hz)");
}

void check_tones(std::span<const double> frequencies, std::span<const double> weights) {
  require(!frequencies.empty(), "frequencies", "none", "at least one");
  if (frequencies.size() != weights.size())
    refuse("weights", std::to_string(weights.size()) + " values",
           "one a frequency, here " + std::to_string(frequencies.size()));
  for (double frequency : frequencies) check_frequency(frequency);
  for (double weight : weights) require_not_negative("weights", weight);
  require(std::ranges::any_of(weights, [](double weight) { return weight > 0; }), "weights", "0 for every frequency",
          "at least one above 0");
}

std::string range_text(const char* before, double low, const char* between, double high) {
  return before + shortest_text(low) + between + shortest_text(high);
}

void check_domain(const ExposureDomain& domain) {
  if (domain.bounds) {
    const auto [low, high] = *domain.bounds;
    require_not_negative("bounds", low);
    require_positive("bounds", high);
    if (low > high) refuse("bounds", range_text("", low, " to ", high), "the lower bound first");
  }
  if (domain.step) require_positive("step", *domain.step);
}

// Beyond this number of cycles per exposure, phases are rounding error.
constexpr double max_cycles = 1e15;

ExposureDomain::Bounds bounds_of(const ExposureDomain& domain, std::span<const double> frequencies) {
  const auto [slowest, fastest] = std::ranges::minmax(frequencies);
  const auto bounds = domain.bounds.value_or(ExposureDomain::Bounds{0, 1 / slowest});
  require(bounds.high * fastest < max_cycles, "bounds", bounds.high, "exposures of fewer than 1e15 cycles");
  return bounds;
}

void require_few(double candidates, const char* argument, const char* what) {
  if (candidates > max_candidates) {
    std::ostringstream found;
    found << candidates << " " << what;
    refuse(argument, found.str(), "at most 10 million: narrower bounds or a larger step");
  }
}

double objective(std::span<const double> frequencies, std::span<const double> weights, double exposure) {
  double sum = 0;
  for (std::size_t i = 0; i < frequencies.size(); ++i) {
    const double whole = std::nearbyint(frequencies[i] * exposure);
    const double cycles = std::fma(frequencies[i], exposure, -whole);  // exact up to one rounding
    sum += weights[i] * std::abs(std::sin(pi * cycles)) / (pi * frequencies[i]);
  }
  return sum;
}

// Keeps the larger objective; at equality the shorter exposure.
void keep_better(BestExposure& best, const BestExposure& other) {
  if (other.objective > best.objective) best = other;
}

// Root of a decreasing function between low and high by Newton's method, with bisection where a step leaves the
// bracket. `both` returns {value, slope}.
template <class Both>
double decreasing_root(Both both, double low, double high, double start) {
  double x = start;
  for (int step = 0; step < 100; ++step) {
    const auto [value, slope] = both(x);
    if (value > 0)
      low = x;
    else
      high = x;
    double next = x - value / slope;
    if (!(next >= low && next <= high)) next = (low + high) / 2;
    const double moved = std::abs(next - x);
    x = next;
    if (moved <= 4e-16 * std::abs(x) || value == 0) break;
  }
  return x;
}

// docs/explanation/exposure.md: the maximum lies in the faster tone's lobe that contains 1/(2 f_min). There, with
// T = 1/(2 f_min) + (x − centre)/f_max and x from 0 to 1, Y' = 0 is w_fast·cos(πx) = w_slow·sin(π r (x − centre)),
// r = f_min/f_max.
double exact_exposure(double slow, double fast, double w_slow, double w_fast) {
  const double middle = 0.5 / slow;
  if (w_fast == 0) return middle;
  if (w_slow == 0) return 0.5 / fast;
  const double largest = std::max(w_slow, w_fast);
  w_slow /= largest;
  w_fast /= largest;
  const double ratio = slow / fast;
  const double beyond = std::fmod(fast, 2 * slow) / (2 * slow);
  const double centre = beyond == 0 ? 1 : beyond;  // at a zero both neighbours are equal: choose the shorter exposure
  const double x = decreasing_root(
      [&](double at) {
        const double turn = pi * ratio * (at - centre);
        return std::pair{w_fast * std::cos(pi * at) - w_slow * std::sin(turn),
                         -pi * (w_fast * std::sin(pi * at) + w_slow * ratio * std::cos(turn))};
      },
      0.0, 1.0, 0.5);
  return middle + (x - centre) / fast;
}

// Y between two neighbouring zeros, where the sign of every sine is constant: a sum of concave arcs.
class Lobes {
 public:
  Lobes(std::span<const double> frequencies, std::span<const double> weights, ExposureDomain::Bounds bounds)
      : bounds_(bounds) {
    for (std::size_t i = 0; i < frequencies.size(); ++i)
      if (weights[i] > 0) {
        const double zeros = std::floor(bounds.low * frequencies[i]);
        tones_.push_back({frequencies[i], weights[i], zeros, (zeros + 1) / frequencies[i]});
      }
  }

  [[nodiscard]] double count() const {
    double zeros = 1;
    for (const Tone& tone : tones_) zeros += (bounds_.high - bounds_.low) * tone.frequency;
    return zeros;
  }

  // Calls visit(low, high) for each lobe in ascending order.
  template <class Visit>
  void for_each(Visit visit) {
    double low = bounds_.low;
    while (low < bounds_.high) {
      double high = bounds_.high;
      for (const Tone& tone : tones_) high = std::min(high, tone.next_zero);
      if (low < high) visit(low, high);
      for (Tone& tone : tones_)
        while (tone.next_zero <= high) tone.next_zero = (++tone.zeros + 1) / tone.frequency;
      low = std::max(low, high);
    }
  }

  [[nodiscard]] double value(double exposure) const {
    double sum = 0;
    for (const Tone& tone : tones_) sum += tone.weight * std::sin(pi * tone.cycles(exposure)) / (pi * tone.frequency);
    return sum;
  }

  // {Y', Y''}
  [[nodiscard]] std::pair<double, double> slopes(double exposure) const {
    double first = 0, second = 0;
    for (const Tone& tone : tones_) {
      const double turn = pi * tone.cycles(exposure);
      first += tone.weight * std::cos(turn);
      second -= tone.weight * pi * tone.frequency * std::sin(turn);
    }
    return {first, second};
  }

  // Upper bound of Y in the lobe: the intersection of the tangents at its ends.
  [[nodiscard]] double upper_bound(double low, double high) const {
    const double at_low = value(low), at_high = value(high);
    const double up = slopes(low).first, down = slopes(high).first;
    if (up <= 0) return at_low;
    if (down >= 0) return at_high;
    return (up * at_high - down * at_low - up * down * (high - low)) / (up - down);
  }

  [[nodiscard]] double peak(double low, double high) const {
    if (slopes(low).first <= 0) return low;
    if (slopes(high).first >= 0) return high;
    return decreasing_root([&](double exposure) { return slopes(exposure); }, low, high, (low + high) / 2);
  }

 private:
  struct Tone {
    double frequency, weight, zeros, next_zero;  // zeros: number of the zero at or before the lobe
    [[nodiscard]] double cycles(double exposure) const { return std::fma(frequency, exposure, -zeros); }
  };
  ExposureDomain::Bounds bounds_;
  std::vector<Tone> tones_;
};

BestExposure best_multiple(std::span<const double> frequencies, std::span<const double> weights,
                           const Multiples& multiples) {
  const double count = multiples.last - multiples.first + 1;
  require_few(count, "step", "multiples");
  BestExposure best{0, -1};
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    if (i % 1024 == 0) check_interrupt();
    const double exposure = (multiples.first + static_cast<double>(i)) * multiples.step;
    keep_better(best, {exposure, objective(frequencies, weights, exposure)});
  }
  return best;
}

BestExposure closed_form(double f_1, double f_2, double w_1, double w_2, bool rounded) {
  const auto [slow, fast] = std::minmax(f_1, f_2);
  const double half_ratio = fast / slow / 2;
  const double lobe = rounded ? std::floor(half_ratio) : std::max(std::floor(half_ratio - 0.5), 0.0);
  const double exposure = std::isfinite(lobe) ? (lobe + 0.5) / fast : 0.5 / slow;
  return {exposure, objective(std::array{f_1, f_2}, std::array{w_1, w_2}, exposure)};
}

BestExposure exact_of_two(double f_1, double f_2, double w_1, double w_2) {
  const double exposure = f_1 <= f_2 ? exact_exposure(f_1, f_2, w_1, w_2) : exact_exposure(f_2, f_1, w_2, w_1);
  return {exposure, objective(std::array{f_1, f_2}, std::array{w_1, w_2}, exposure)};
}

BestExposure exact_of_lobes(std::span<const double> frequencies, std::span<const double> weights,
                            const ExposureDomain& domain) {
  const auto bounds = bounds_of(domain, frequencies);
  Lobes lobes(frequencies, weights, bounds);
  std::optional<Multiples> multiples;
  if (domain.step) {
    multiples = multiples_of(*domain.step, bounds);
    if (multiples->last - multiples->first + 1 <= lobes.count()) return best_multiple(frequencies, weights, *multiples);
  }
  require_few(lobes.count(), "bounds", "lobes");
  const auto at = [&](double exposure) { return BestExposure{exposure, objective(frequencies, weights, exposure)}; };
  BestExposure best{bounds.high, -1};
  if (!multiples) best = at(bounds.high);
  lobes.for_each([&](double low, double high) {
    if (lobes.upper_bound(low, high) * (1 + 1e-12) < best.objective) return;
    const double peak = lobes.peak(low, high);
    if (!multiples) return keep_better(best, at(peak));
    for (double m : {std::floor(peak / multiples->step), std::floor(peak / multiples->step) + 1})
      if (m >= multiples->first && m <= multiples->last) keep_better(best, at(m * multiples->step));
  });
  return best;
}

BestExposure search(std::span<const double> frequencies, std::span<const double> weights, const ExposureDomain& domain,
                    std::size_t points) {
  const auto bounds = bounds_of(domain, frequencies);
  if (domain.step) return best_multiple(frequencies, weights, multiples_of(*domain.step, bounds));
  BestExposure best{0, -1};
  const double spacing = (bounds.high - bounds.low) / static_cast<double>(points - 1);
  for (std::size_t j = 0; j < points; ++j) {
    const double exposure = j + 1 == points ? bounds.high : bounds.low + static_cast<double>(j) * spacing;
    if (exposure > 0) keep_better(best, {exposure, objective(frequencies, weights, exposure)});
  }
  return best;
}

void check_points(std::size_t points) {
  require(points >= 2 && static_cast<double>(points) <= max_candidates, "points", points, "2 to 10 million");
}

}  // namespace

Multiples multiples_of(double step, ExposureDomain::Bounds bounds) {
  constexpr double slack = 8 * std::numeric_limits<double>::epsilon();
  const Multiples found{step, std::max(std::ceil(bounds.low / step * (1 - slack)), 1.0),
                        std::floor(bounds.high / step * (1 + slack))};
  if (!(found.first <= found.last))
    refuse("step", step, range_text("a step with a multiple between ", bounds.low, " and ", bounds.high));
  return found;
}

double exposure_objective(std::span<const double> frequencies, std::span<const double> weights, double exposure) {
  check_tones(frequencies, weights);
  require_not_negative("exposure", exposure);
  return objective(frequencies, weights, exposure);
}

BestExposure best_exposure_exact(double f_1, double f_2, double w_1, double w_2) {
  check_tones(std::array{f_1, f_2}, std::array{w_1, w_2});
  return exact_of_two(f_1, f_2, w_1, w_2);
}

BestExposure best_exposure_exact(std::span<const double> frequencies, std::span<const double> weights,
                                 const ExposureDomain& domain) {
  check_tones(frequencies, weights);
  check_domain(domain);
  return exact_of_lobes(frequencies, weights, domain);
}

BestExposure best_exposure_search(std::span<const double> frequencies, std::span<const double> weights,
                                  const ExposureDomain& domain, std::size_t points) {
  check_tones(frequencies, weights);
  check_domain(domain);
  check_points(points);
  return search(frequencies, weights, domain, points);
}

BestExposure best_exposure_closed_form(double f_1, double f_2, double w_1, double w_2, bool rounded) {
  check_tones(std::array{f_1, f_2}, std::array{w_1, w_2});
  return closed_form(f_1, f_2, w_1, w_2, rounded);
}

void best_exposures(std::span<const double> frequencies, std::span<const double> weights, ExposureMethod method,
                    const ExposureDomain& domain, std::size_t points, std::span<double> exposures,
                    std::span<double> objectives) {
  const std::size_t tones = weights.size();
  const bool anywhere = !domain.bounds && !domain.step;
  const bool two = method == ExposureMethod::closed_form || method == ExposureMethod::rounded;
  const std::size_t per_problem = exposures.empty() ? tones : frequencies.size() / exposures.size();
  require(exposures.size() == objectives.size() && frequencies.size() == per_problem * exposures.size(), "frequencies",
          std::to_string(frequencies.size()) + " values", "problems × tones");
  require(tones == per_problem, "weights", std::to_string(tones) + " values",
          "one a frequency, here " + std::to_string(per_problem));
  require(!two || (anywhere && tones == 2), "method", "a closed form with bounds, step or more frequencies",
          "exact or search with these");
  check_domain(domain);
  check_points(points);
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    const auto f = frequencies.subspan(i * tones, tones);
    check_tones(f, weights);
    const BestExposure best = two ? closed_form(f[0], f[1], weights[0], weights[1], method == ExposureMethod::rounded)
                              : method == ExposureMethod::search ? search(f, weights, domain, points)
                              : anywhere && tones == 2           ? exact_of_two(f[0], f[1], weights[0], weights[1])
                                                                 : exact_of_lobes(f, weights, domain);
    exposures[i] = best.exposure;
    objectives[i] = best.objective;
  }
}

}  // namespace ocisac
