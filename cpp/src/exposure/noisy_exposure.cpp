#include "ocisac/exposure/noisy_exposure.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/check_interrupt.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

using std::numbers::pi;
constexpr double max_lobes = 1e6;
constexpr double kMaxMultiple = 0x1p53;
constexpr double precision = 1e-12;  // relative, of the objective

void check(std::span<const WeightedTone> tones, double noise_exposure) {
  require(!tones.empty() && tones.size() <= max_weighted_tones, "tones", tones.size(), "1 to 32");
  for (const WeightedTone& tone : tones) {
    require_positive("frequency", tone.frequency);
    require_not_negative("weights", tone.weight);
  }
  require(std::ranges::any_of(tones, [](const WeightedTone& tone) { return tone.weight > 0; }), "weights",
          "0 for every tone", "at least one above 0");
  require(noise_exposure > 0, "noise_exposure", noise_exposure, "a number above 0 (s), or infinity");
}

double noise_factor(double noise_exposure, double exposure) { return 1 / std::sqrt(1 + exposure / noise_exposure); }

double objective(std::span<const WeightedTone> tones, double noise_exposure, double exposure) {
  double sum = 0;
  for (const auto& [frequency, weight] : tones) {
    const double whole = std::nearbyint(frequency * exposure);
    sum += weight * std::abs(std::sin(pi * std::fma(frequency, exposure, -whole))) / (pi * frequency);
  }
  return sum * noise_factor(noise_exposure, exposure);
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

// Iterates over the lobes between the zeros of the sines, where the sum N of the tones is concave. Upper bound on a
// part [a, b] of a lobe: N's tangents at its ends times the chord of the noise factor, which is convex. The error of
// the bound is O((b − a)²), so few parts remain at each depth of bisection.
class Branching {
 public:
  Branching(std::span<const WeightedTone> tones, double noise_exposure, const ExposureWindow& window)
      : tones_(tones), noise_exposure_(noise_exposure), window_(window) {
    if (window.step > 0) {
      require(window.high / window.step <= kMaxMultiple, "step", window.step,
              "0 (any exposure), or at least the longest exposure over 2^53: multiples differ from each other");
      const Multiples found = multiples_of(window.step, {window.low, window.high});
      first_ = found.first;
      last_ = found.last;
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

  [[nodiscard]] End end_at(double exposure) const {
    End end{exposure, 0, 0, noise_factor(noise_exposure_, exposure)};
    for (std::size_t i = 0; i < tones_.size(); ++i) {
      const auto [frequency, weight] = tones_[i];
      const double turn = pi * std::fma(frequency, exposure, -zeros_[i]);
      end.value += weight * std::sin(turn) / (pi * frequency);
      end.slope += weight * std::cos(turn);
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
      if (part.bound <= best_.objective * (1 + precision) || !try_candidates(part)) continue;
      const End middle = end_at(part.a.exposure + (part.b.exposure - part.a.exposure) / 2);
      if (!(middle.exposure > part.a.exposure && middle.exposure < part.b.exposure)) continue;
      Part left = part_of(part.a, middle), right = part_of(middle, part.b);
      if (left.bound > right.bound) std::swap(left, right);  // larger bound first
      if (depth + 2 > parts_.size()) continue;               // not reached: bisection ends after 53 parts
      parts_[depth++] = left;
      parts_[depth++] = right;
    }
  }

  // Returns false if the part needs no further search.
  bool try_candidates(const Part& part) {
    const double step = window_.step;
    if (!(step > 0)) {
      keep(part.candidate);
      return true;
    }
    const double first = std::max(std::floor(part.a.exposure / step), first_);
    const double last = std::min(std::ceil(part.b.exposure / step), last_);
    if (last - first <= 4) {
      for (double m = first; m <= last; ++m) keep(m * step);
      return false;
    }
    keep(std::clamp(std::nearbyint(part.candidate / step), first_, last_) * step);
    return true;
  }

  void keep(double exposure) {
    const double value = objective(tones_, noise_exposure_, exposure);
    if (value > best_.objective || (value == best_.objective && exposure < best_.exposure)) best_ = {exposure, value};
  }

  std::span<const WeightedTone> tones_;
  double noise_exposure_;
  ExposureWindow window_;
  double first_ = 0, last_ = 0;                     // multiples of the step in the window
  std::array<double, max_weighted_tones> zeros_{};  // for each tone, index of its zero at or before the lobe
  std::array<Part, 128> parts_;
  BestExposure best_{kInfinity, -1};
};

}  // namespace

double noisy_exposure_objective(std::span<const WeightedTone> tones, double noise_exposure, double exposure) {
  check(tones, noise_exposure);
  require_not_negative("exposure", exposure);
  return objective(tones, noise_exposure, exposure);
}

BestExposure best_noisy_exposure(std::span<const WeightedTone> tones, double noise_exposure,
                                 const ExposureWindow& window) {
  check(tones, noise_exposure);
  require_positive("bounds", window.low);
  require_positive("bounds", window.high);
  require(window.low <= window.high, "bounds", window.low, "the lower bound first");
  require_not_negative("step", window.step);
  double lobes = 1;
  for (const WeightedTone& tone : tones) lobes += (window.high - window.low) * tone.frequency;
  require(lobes <= max_lobes, "bounds", window.high, "exposures with at most a million lobes between them");
  return Branching(tones, noise_exposure, window).run();
}

}  // namespace ocisac
