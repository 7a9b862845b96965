#include "ocisac/exposure/best_exposure.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "core/check_interrupt.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

using std::numbers::pi;
using Tones = std::span<const WeightedTone>;

constexpr double kMostMultiple = 0x1p53;  // of a step; beyond it neighbours do not differ
constexpr double kPrecision = 1e-12;      // relative, of the objective

void check(Tones tones) {
  require(!tones.empty(), "frequencies", "none", "at least one");
  for (const auto& [frequency, weight] : tones) {
    require(std::isfinite(frequency) && frequency > 0 && std::isfinite(1 / frequency), "frequency", frequency,
            "a finite number above 0 (Hz)");
    require_not_negative("weights", weight);
  }
  require(std::ranges::any_of(tones, [](const WeightedTone& tone) { return tone.weight > 0; }), "weights",
          "0 for every frequency", "at least one above 0");
}

void check_noise(Tones tones, double noise_exposure) {
  require(tones.size() <= kMaxWeightedTones, "tones", tones.size(), "1 to 32");
  check(tones);
  require(noise_exposure > 0, "noise_exposure", noise_exposure, "a number above 0 (s), or infinity");
}

std::vector<WeightedTone> tones_of(std::span<const double> frequencies, std::span<const double> weights) {
  if (frequencies.size() != weights.size())
    refuse("weights", std::to_string(weights.size()) + " values",
           "one a frequency, here " + std::to_string(frequencies.size()));
  std::vector<WeightedTone> tones;
  for (std::size_t i = 0; i < frequencies.size(); ++i) tones.push_back({frequencies[i], weights[i]});
  check(tones);
  return tones;
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

Interval bounds_of(const ExposureDomain& domain, Tones tones) {
  const auto [slowest, fastest] = std::ranges::minmax(tones, {}, &WeightedTone::frequency);
  const auto bounds = domain.bounds.value_or(Interval{0, 1 / slowest.frequency});
  require(bounds.high * fastest.frequency < kMostCounted, "bounds", bounds.high, "exposures of fewer than 1e15 cycles");
  return bounds;
}

// The first and the last multiple of the step within the bounds, as whole numbers. A bound equal to a multiple up to
// rounding is included.
Interval multiples_of(double step, const Interval& bounds) {
  require(bounds.high / step <= kMostMultiple, "step", step,
          "at least the longest exposure over 2^53: multiples differ from each other");
  const Interval found{std::max(std::ceil(bounds.low / step * (1 - kShrink)), 1.0),
                       std::floor(bounds.high / step * (1 + kShrink))};
  if (!(found.low <= found.high))
    refuse("step", step, range_text("a step with a multiple between ", bounds.low, " and ", bounds.high));
  return found;
}

void require_few(double candidates, const char* argument, const char* what) {
  if (candidates > kMostCandidates) {
    std::ostringstream found;
    found << candidates << " " << what;
    refuse(argument, found.str(), "at most 10 million: narrower bounds or a larger step");
  }
}

double noise_factor(double noise_exposure, double exposure) { return 1 / std::sqrt(1 + exposure / noise_exposure); }

double objective(Tones tones, double exposure, double noise_exposure = kInfinity) {
  double sum = 0;
  for (const auto& [frequency, weight] : tones) {
    const double whole = std::nearbyint(frequency * exposure);
    const double cycles = std::fma(frequency, exposure, -whole);  // exact up to one rounding
    sum += weight * std::abs(std::sin(pi * cycles)) / (pi * frequency);
  }
  return sum * noise_factor(noise_exposure, exposure);
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
double exact_exposure(const WeightedTone& slower, const WeightedTone& faster) {
  const double slow = slower.frequency, fast = faster.frequency, middle = 0.5 / slow;
  double w_slow = slower.weight, w_fast = faster.weight;
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

struct AffineLine {
  double at_start, slope;
};

// Position of the maximum of the product of two lines on [0, length].
double largest_product(AffineLine p, AffineLine q, double length, double& largest) {
  const auto product = [&](double t) { return (p.at_start + p.slope * t) * (q.at_start + q.slope * t); };
  double best = product(length) > product(0) ? length : 0;
  if (p.slope * q.slope < 0) {
    const double top = -(p.at_start * q.slope + q.at_start * p.slope) / (2 * p.slope * q.slope);
    if (top > 0 && top < length) best = top;
  }
  largest = product(best);
  return best;
}

double lobes_of(Tones tones, const ExposureWindow& window) {
  double lobes = 1;
  for (const auto& [frequency, weight] : tones)
    if (weight > 0) lobes += (window.high - window.low) * frequency;
  return lobes;
}

// Iterates over the lobes between the zeros of the sines, where the sum N of the tones is concave. Upper bound on a
// part [a, b] of a lobe: N's tangents at its ends times the chord of the noise factor, which is convex. The error of
// the bound is O((b − a)²), so few parts remain at each depth of bisection; without noise the maximum of a part is N's.
// `zeros`: one number for each tone.
class Branching {
 public:
  Branching(Tones tones, double noise_exposure, const ExposureWindow& window, std::span<double> zeros)
      : tones_(tones), noise_exposure_(noise_exposure), window_(window), zeros_(zeros) {
    if (window.step > 0) {
      const Interval found = multiples_of(window.step, {window.low, window.high});
      first_ = found.low;
      last_ = found.high;
    }
    for (std::size_t i = 0; i < tones.size(); ++i) zeros_[i] = std::floor(window.low * tones[i].frequency);
  }

  BestExposure run() {
    if (window_.step > 0) {
      keep(first_ * window_.step);
      keep(last_ * window_.step);
    } else {
      keep(window_.low);
      keep(window_.high);
    }
    double low = window_.low;
    while (low < window_.high) {
      double high = window_.high;
      for (std::size_t i = 0; i < tones_.size(); ++i)
        if (tones_[i].weight > 0) high = std::min(high, next_zero(i));
      check_interrupt();
      if (low < high) search_lobe(low, high);
      for (std::size_t i = 0; i < tones_.size(); ++i)
        while (tones_[i].weight > 0 && next_zero(i) <= high) ++zeros_[i];
      low = std::max(low, high);
    }
    return best_;
  }

 private:
  struct End {
    double exposure, value, slope, noise;  // T, N, N', noise factor
  };
  struct Part {
    End a, b;
    double bound, candidate;  // upper bound on the part; likely position of the maximum
  };

  [[nodiscard]] double next_zero(std::size_t i) const { return (zeros_[i] + 1) / tones_[i].frequency; }

  [[nodiscard]] double turn(std::size_t i, double exposure) const {
    return pi * std::fma(tones_[i].frequency, exposure, -zeros_[i]);
  }

  [[nodiscard]] End end_at(double exposure) const {
    End end{exposure, 0, 0, noise_factor(noise_exposure_, exposure)};
    for (std::size_t i = 0; i < tones_.size(); ++i) {
      const auto [frequency, weight] = tones_[i];
      end.value += weight * std::sin(turn(i, exposure)) / (pi * frequency);
      end.slope += weight * std::cos(turn(i, exposure));
    }
    return end;
  }

  [[nodiscard]] static Part part_of(const End& a, const End& b) {
    const double length = b.exposure - a.exposure;
    const double bend = a.slope - b.slope;
    double meet = bend > 0 ? (b.value - a.value - b.slope * length) / bend : length / 2;
    meet = std::clamp(meet, 0.0, length);
    const double fall = (b.noise - a.noise) / length;
    double left = 0, right = 0;
    const double t_left = largest_product({a.value, a.slope}, {a.noise, fall}, meet, left);
    const double t_right = largest_product({b.value - b.slope * (length - meet), b.slope},
                                           {a.noise + fall * meet, fall}, length - meet, right);
    return {a, b, std::max(left, right), a.exposure + (left >= right ? t_left : meet + t_right)};
  }

  void search_lobe(double low, double high) {
    std::size_t depth = 0;
    parts_[depth++] = part_of(end_at(low), end_at(high));
    while (depth > 0) {
      const Part part = parts_[--depth];
      if (part.bound <= best_.objective * (1 + kPrecision) || !try_candidates(part)) continue;
      const End middle = end_at(part.a.exposure + (part.b.exposure - part.a.exposure) / 2);
      if (!(middle.exposure > part.a.exposure && middle.exposure < part.b.exposure)) continue;
      Part left = part_of(part.a, middle), right = part_of(middle, part.b);
      if (left.bound > right.bound) std::swap(left, right);  // larger bound first
      if (depth + 2 > parts_.size()) continue;               // not reached: bisection ends after 53 parts
      parts_[depth++] = left;
      parts_[depth++] = right;
    }
  }

  [[nodiscard]] double peak(const Part& part) const {
    if (part.a.slope <= 0) return part.a.exposure;
    if (part.b.slope >= 0) return part.b.exposure;
    return decreasing_root(
        [&](double exposure) {
          double bend = 0;
          for (std::size_t i = 0; i < tones_.size(); ++i)
            bend -= tones_[i].weight * pi * tones_[i].frequency * std::sin(turn(i, exposure));
          return std::pair{end_at(exposure).slope, bend};
        },
        part.a.exposure, part.b.exposure, part.candidate);
  }

  // Returns false if the part needs no further search.
  bool try_candidates(const Part& part) {
    const double step = window_.step;
    const bool is_concave = noise_exposure_ == kInfinity;
    const double candidate = is_concave ? peak(part) : part.candidate;
    if (!(step > 0)) {
      keep(candidate);
      return !is_concave;
    }
    const double first = std::max(std::floor((is_concave ? candidate : part.a.exposure) / step), first_);
    const double last = std::min(is_concave ? first + 1 : std::ceil(part.b.exposure / step), last_);
    if (last - first <= 4) {
      for (double m = first; m <= last; ++m) keep(m * step);
      return false;
    }
    keep(std::clamp(std::nearbyint(candidate / step), first_, last_) * step);
    return true;
  }

  void keep(double exposure) {
    const double value = objective(tones_, exposure, noise_exposure_);
    if (value > best_.objective || (value == best_.objective && exposure < best_.exposure)) best_ = {exposure, value};
  }

  Tones tones_;
  double noise_exposure_;
  ExposureWindow window_;
  std::span<double> zeros_;      // for each tone, index of its zero at or before the lobe
  double first_ = 0, last_ = 0;  // multiples of the step in the window
  std::array<Part, 128> parts_;
  BestExposure best_{kInfinity, -1};
};

// The best of `count` exposures; of equals the first.
template <class ExposureAt>
BestExposure best_of(Tones tones, std::size_t count, ExposureAt exposure_at) {
  BestExposure best{0, -1};
  for (std::size_t i = 0; i < count; ++i) {
    if (i % 1024 == 0) check_interrupt();
    const double exposure = exposure_at(static_cast<double>(i));
    if (const double value = exposure > 0 ? objective(tones, exposure) : -1; value > best.objective)
      best = {exposure, value};
  }
  return best;
}

BestExposure best_multiple(Tones tones, double step, const Interval& multiples) {
  const double count = multiples.high - multiples.low + 1;
  require_few(count, "step", "multiples");
  return best_of(tones, static_cast<std::size_t>(count), [&](double i) { return (multiples.low + i) * step; });
}

BestExposure closed_form(const WeightedTone& first, const WeightedTone& second, bool rounded) {
  const auto [slow, fast] = std::minmax(first.frequency, second.frequency);
  const double half_ratio = fast / slow / 2;
  const double lobe = rounded ? std::floor(half_ratio) : std::max(std::floor(half_ratio - 0.5), 0.0);
  const double exposure = std::isfinite(lobe) ? (lobe + 0.5) / fast : 0.5 / slow;
  return {exposure, objective(std::array{first, second}, exposure)};
}

BestExposure exact_of_two(const WeightedTone& first, const WeightedTone& second) {
  const bool in_order = first.frequency <= second.frequency;
  const double exposure = in_order ? exact_exposure(first, second) : exact_exposure(second, first);
  return {exposure, objective(std::array{first, second}, exposure)};
}

BestExposure exact_of_lobes(Tones tones, const ExposureDomain& domain) {
  const auto bounds = bounds_of(domain, tones);
  const ExposureWindow window{bounds.low, bounds.high, domain.step.value_or(0)};
  if (domain.step) {
    const Interval multiples = multiples_of(*domain.step, bounds);
    if (multiples.high - multiples.low + 1 <= lobes_of(tones, window))
      return best_multiple(tones, *domain.step, multiples);
  }
  require_few(lobes_of(tones, window), "bounds", "lobes");
  std::vector<double> zeros(tones.size());
  return Branching(tones, kInfinity, window, zeros).run();
}

BestExposure search(Tones tones, const ExposureDomain& domain, std::size_t points) {
  const auto bounds = bounds_of(domain, tones);
  if (domain.step) return best_multiple(tones, *domain.step, multiples_of(*domain.step, bounds));
  const auto last = static_cast<double>(points - 1);
  const double spacing = (bounds.high - bounds.low) / last;
  return best_of(tones, points, [&](double j) { return j == last ? bounds.high : bounds.low + j * spacing; });
}

void check_points(std::size_t points) {
  require(points >= 2 && static_cast<double>(points) <= kMostCandidates, "points", points, "2 to 10 million");
}

}  // namespace

double exposure_objective(std::span<const double> frequencies, std::span<const double> weights, double exposure) {
  const auto tones = tones_of(frequencies, weights);
  require_not_negative("exposure", exposure);
  return objective(tones, exposure);
}

double noisy_exposure_objective(Tones tones, double noise_exposure, double exposure) {
  check_noise(tones, noise_exposure);
  require_not_negative("exposure", exposure);
  return objective(tones, exposure, noise_exposure);
}

BestExposure best_exposure_exact(double f_1, double f_2, double w_1, double w_2) {
  check(std::array{WeightedTone{f_1, w_1}, WeightedTone{f_2, w_2}});
  return exact_of_two({f_1, w_1}, {f_2, w_2});
}

BestExposure best_exposure_exact(std::span<const double> frequencies, std::span<const double> weights,
                                 const ExposureDomain& domain) {
  const auto tones = tones_of(frequencies, weights);
  check_domain(domain);
  const BestExposure best = exact_of_lobes(tones, domain);
  require(best.exposure > 0, "weights", std::ranges::max(weights), "numbers large enough for an objective above 0");
  return best;
}

BestExposure best_noisy_exposure(Tones tones, double noise_exposure, const ExposureWindow& window) {
  check_noise(tones, noise_exposure);
  require_positive("bounds", window.low);
  require_positive("bounds", window.high);
  require(window.low <= window.high, "bounds", window.low, "the lower bound first");
  require_not_negative("step", window.step);
  require_few(lobes_of(tones, window), "bounds", "lobes");
  std::array<double, kMaxWeightedTones> zeros;
  return Branching(tones, noise_exposure, window, std::span(zeros).first(tones.size())).run();
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
    const auto of = tones_of(frequencies.subspan(i * tones, tones), weights);
    const BestExposure best = two ? closed_form(of[0], of[1], method == ExposureMethod::rounded)
                              : method == ExposureMethod::search ? search(of, domain, points)
                              : anywhere && tones == 2           ? exact_of_two(of[0], of[1])
                                                                 : exact_of_lobes(of, domain);
    exposures[i] = best.exposure;
    objectives[i] = best.objective;
  }
}

}  // namespace ocisac
