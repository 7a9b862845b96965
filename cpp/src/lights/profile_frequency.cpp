#include "lights/profile_frequency.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "core/statistics.hpp"
#include "lights/light_patch.hpp"

namespace ocisac {

namespace {

using Complex = std::complex<double>;

constexpr std::size_t kHarmonics = 3, kMaxGroups = 16;
constexpr int kSteps = 40, kDeletedSteps = 2;  // to a peak; from it without a group

// p_q = Σ_n x(n)·(n − middle)^q·e^(−j2πhf(n − middle)) for h = 1, 2, 3 and q = 0, 1, 2.
using Moments = std::array<std::array<Complex, 3>, kHarmonics>;

Moments moments_of(std::span<const double> x, double frequency, const IndexRange& rows) {
  Moments out{};
  const double middle = 0.5 * static_cast<double>(x.size());
  const Complex step = turned(frequency);
  Complex turn = turned(frequency * (static_cast<double>(rows.begin) - middle));
  for (std::size_t n = rows.begin; n < rows.end; ++n, turn = product(turn, step)) {
    Complex term = x[n];
    for (auto& powers : out) {
      Complex power = term = product(term, turn);
      for (Complex& sum : powers) sum += power, power *= static_cast<double>(n) - middle;
    }
  }
  return out;
}

// Newton's step to the maximum of J(f) = Σ_h |p₀|², of at most a quarter of a cycle over the rows; uphill where the
// curvature has the wrong sign. With r = 2πh: J′ = 2r·Im(p₀*p₁), J″ = 2r²·(|p₁|² − Re(p₀*p₂)).
double step_to_peak(const Moments& sums, double frequency, double rows) {
  double slope = 0, curvature = 0;
  for (std::size_t h = 0; h < kHarmonics && static_cast<double>(h + 1) * frequency < 0.5; ++h) {
    const double rate = 2 * std::numbers::pi * static_cast<double>(h + 1);
    const auto& [p0, p1, p2] = sums[h];
    slope += 2 * rate * product(std::conj(p0), p1).imag();
    curvature += 2 * rate * rate * (std::norm(p1) - product(std::conj(p0), p2).real());
  }
  const double longest = 0.25 / rows;
  return curvature < 0 ? std::clamp(-slope / curvature, -longest, longest) : std::copysign(longest, slope);
}

double fundamental(std::span<const double> x, double frequency) {
  Complex sum = 0, turn = 1;
  const Complex step = turned(frequency);
  for (const double value : x) sum += value * turn, turn = product(turn, step);
  return std::norm(sum);
}

}  // namespace

double strongest_frequency(std::span<const double> profile, double lower, double upper) {
  const auto rows = static_cast<double>(profile.size());
  const double step = 0.125 / rows;
  const auto count = static_cast<std::size_t>((upper - lower) / step) + 1;
  double best = lower, most = -1;
  for (std::size_t i = 0; i <= count; ++i) {
    const double frequency = std::min(lower + static_cast<double>(i) * step, upper);
    const double energy = fundamental(profile, frequency);
    if (energy > most) most = energy, best = frequency;
  }
  for (int k = 0; k < kSteps; ++k) {
    const double last = best;
    best += step_to_peak(moments_of(profile, best, {0, profile.size()}), best, rows);
    best = std::clamp(best, lower, upper);
    if (std::abs(best - last) < 1e-10) break;
  }
  return best;
}

double jackknife_std(std::span<const double> profile, double frequency, double cycles, double lower, double upper) {
  const auto groups = std::clamp<std::size_t>(static_cast<std::size_t>(cycles), 2, kMaxGroups);
  std::size_t first = 0, last = profile.size();
  while (first < last && profile[first] == 0) ++first;
  while (last > first && profile[last - 1] == 0) --last;
  std::vector<double> found;
  for (std::size_t k = 0; k < groups; ++k) {
    const std::size_t begin = first + k * (last - first) / groups, end = first + (k + 1) * (last - first) / groups;
    double rest = frequency;
    for (int step = 0; step < kDeletedSteps; ++step) {
      Moments sums = moments_of(profile, rest, {first, begin});
      const Moments behind = moments_of(profile, rest, {end, last});
      for (std::size_t h = 0; h < kHarmonics; ++h)
        for (std::size_t q = 0; q < sums[h].size(); ++q) sums[h][q] += behind[h][q];
      rest = std::clamp(rest + step_to_peak(sums, rest, static_cast<double>(profile.size())), lower, upper);
    }
    found.push_back(rest);
  }
  const auto count = static_cast<double>(groups);
  return std::sqrt(squares_about_mean(found) * (count - 1) / count);
}

double phase_at_start(std::span<const double> profile, double frequency, std::size_t first_row) {
  Complex sum = 0;
  for (std::size_t n = 0; n < profile.size(); ++n)
    sum += profile[n] * turned(frequency * static_cast<double>(first_row + n));
  return std::arg(sum);
}

}  // namespace ocisac
