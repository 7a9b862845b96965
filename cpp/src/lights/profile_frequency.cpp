#include "lights/profile_frequency.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "lights/light_patch.hpp"
#include "lights/refinement_kernels.hpp"

namespace ocisac {

namespace {

constexpr std::size_t max_jackknife = 16;

// J(f) = Σ_h |Σ_n x(n)·e^{−j2πhfn}|², with its first two derivatives.
struct Energy {
  double fundamental = 0, value = 0, slope = 0, curvature = 0;
};

// Values in whole blocks of the kernel; the turns are recomputed for every frequency.
class Profile {
 public:
  explicit Profile(std::span<const double> x)
      : values_((x.size() + kernels::fine_turns - 1) / kernels::fine_turns * kernels::fine_turns),
        coarse_real_(values_.size() / kernels::fine_turns),
        coarse_imaginary_(coarse_real_.size()),
        size_(x.size()) {
    std::ranges::copy(x, values_.begin());
  }

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::span<double> values() { return {values_.data(), size_}; }

  Energy energy(double frequency) {
    const double middle = 0.5 * static_cast<double>(size_);
    for (std::size_t a = 0; a < coarse_real_.size(); ++a) {
      const auto turn = turned(frequency * (static_cast<double>(a * kernels::fine_turns) - middle));
      coarse_real_[a] = turn.real(), coarse_imaginary_[a] = turn.imag();
    }
    std::array<double, kernels::fine_turns> fine_real, fine_imaginary;
    for (std::size_t b = 0; b < fine_real.size(); ++b) {
      const auto turn = turned(frequency * static_cast<double>(b));
      fine_real[b] = turn.real(), fine_imaginary[b] = turn.imag();
    }
    const auto sums = kernels::harmonic_sums(
        values_.data(), coarse_real_.size(),
        {coarse_real_.data(), coarse_imaginary_.data(), fine_real.data(), fine_imaginary.data(), middle});
    const auto most =
        std::min<std::size_t>(kernels::max_harmonics, static_cast<std::size_t>(std::ceil(0.5 / frequency)) - 1);
    Energy out;
    for (std::size_t h = 0; h < most; ++h) {
      const double rate = 2 * std::numbers::pi * static_cast<double>(h + 1);
      const auto &a = sums.real[h], &b = sums.imaginary[h];
      // p = a₀ + jb₀, p′ = −j·rate·(a₁ + jb₁), p″ = −rate²·(a₂ + jb₂)
      out.value += a[0] * a[0] + b[0] * b[0];
      out.slope += 2 * rate * (a[0] * b[1] - b[0] * a[1]);
      out.curvature += 2 * rate * rate * (a[1] * a[1] + b[1] * b[1] - a[0] * a[2] - b[0] * b[2]);
    }
    out.fundamental = sums.real[0][0] * sums.real[0][0] + sums.imaginary[0][0] * sums.imaginary[0][0];
    return out;
  }

 private:
  std::vector<double> values_, coarse_real_, coarse_imaginary_;
  std::size_t size_;
};

// Maximum near `frequency` by Newton steps of at most a quarter of a cycle over the profile, uphill where the curvature
// has the wrong sign.
double climbed(Profile& profile, double frequency, double lower, double upper) {
  const double longest = 0.25 / static_cast<double>(profile.size());
  for (int step = 0; step < 40; ++step) {
    const Energy energy = profile.energy(frequency);
    const double newton =
        energy.curvature < 0 ? -energy.slope / energy.curvature : std::copysign(longest, energy.slope);
    const double next = std::clamp(frequency + std::clamp(newton, -longest, longest), lower, upper);
    const bool settled = std::abs(next - frequency) < 1e-10;
    frequency = next;
    if (settled) break;
  }
  return frequency;
}

}  // namespace

double strongest_frequency(std::span<const double> profile, double lower, double upper) {
  Profile x(profile);
  const double step = 0.125 / static_cast<double>(x.size());
  const auto count = static_cast<std::size_t>((upper - lower) / step) + 1;
  double best = lower, most = -1;
  for (std::size_t i = 0; i <= count; ++i) {
    const double frequency = std::min(lower + static_cast<double>(i) * step, upper);
    const double energy = x.energy(frequency).fundamental;
    if (energy > most) most = energy, best = frequency;
  }
  return climbed(x, best, lower, upper);
}

double jackknife_std(std::span<const double> profile, double frequency, double cycles, double lower, double upper) {
  const auto groups = std::clamp<std::size_t>(static_cast<std::size_t>(cycles), 2, max_jackknife);
  std::size_t first = 0, last = profile.size();
  while (first < last && profile[first] == 0) ++first;
  while (last > first && profile[last - 1] == 0) --last;
  Profile rest(profile);
  std::vector<double> found;
  for (std::size_t k = 0; k < groups; ++k) {
    const std::size_t begin = first + k * (last - first) / groups, end = first + (k + 1) * (last - first) / groups;
    std::ranges::fill(rest.values().subspan(begin, end - begin), 0.0);
    found.push_back(climbed(rest, frequency, lower, upper));
    std::ranges::copy(profile.subspan(begin, end - begin), rest.values().subspan(begin).begin());
  }
  double mean = 0, square = 0;
  for (const double f : found) mean += f / static_cast<double>(groups);
  for (const double f : found) square += (f - mean) * (f - mean);
  return std::sqrt(square * static_cast<double>(groups - 1) / static_cast<double>(groups));
}

double phase_at_start(std::span<const double> profile, double frequency, std::size_t first_row) {
  std::complex<double> sum = 0;
  for (std::size_t n = 0; n < profile.size(); ++n)
    sum += profile[n] * turned(frequency * static_cast<double>(first_row + n));
  return std::arg(sum);
}

}  // namespace ocisac
