#include "lights/profile_frequency.hpp"

#include <array>
#include <utility>

#include "lights/light_patch.hpp"
#include "tones/frequency_search.hpp"
#include "tones/surroundings.hpp"

namespace ocisac {

namespace {

using Complex = std::complex<double>;

// Σ_h |Σ_n x(n)·e^(−j2πhfn)|² for h = 1 … harmonics.
double energy_of(std::span<const double> x, double frequency, std::size_t harmonics) {
  std::array<Complex, kComparedHarmonics> sums{};
  const Complex step = turned(frequency);
  Complex turn = 1;
  for (const double value : x) {
    Complex term = value;
    for (std::size_t h = 0; h < harmonics; ++h) sums[h] += term = product(term, turn);
    turn = product(turn, step);
  }
  double energy = 0;
  for (std::size_t h = 0; h < harmonics && static_cast<double>(h + 1) * frequency < 0.5; ++h)
    energy += std::norm(sums[h]);
  return energy;
}

// The rows from the first to the last that is not 0.
std::vector<double> own_rows(std::span<const double> profile) {
  const auto [begin, end] = extent_of(profile);
  const auto own = profile.subspan(begin, end - begin);
  return {own.begin(), own.end()};
}

double bend_of(std::span<const double> rows, double frequency, double margin) {
  const auto left_out = static_cast<std::size_t>(margin / frequency);
  if (rows.size() <= 2 * left_out) return 0;
  const auto own = rows.subspan(left_out, rows.size() - 2 * left_out);
  const auto model = periodic_model(frequency, own.size(), kComparedHarmonics);
  if (own.size() <= 2 * model.parameters()) return 0;
  const double middle = 0.5 * (static_cast<double>(own.size()) - 1);
  const Complex level = 2 / static_cast<double>(own.size()) *
                        product(component_at(own, frequency), std::conj(turned(frequency * middle)));
  const PeriodicSignals signals({own.begin(), own.end()}, own.size());
  return bend_of_phase(residual_of(signals, fit_periodic(signals, model, frequency, false)), frequency, level)
      .frequency;
}

}  // namespace

double strongest_frequency(std::span<const double> profile, double lower, double upper) {
  return strongest_frequency(lower, upper, static_cast<double>(profile.size()),
                             [=](double f, std::size_t harmonics) { return energy_of(profile, f, harmonics); });
}

double jackknife_std(std::span<const double> profile, double frequency, double cycles) {
  const std::vector<double> own = own_rows(profile);
  if (own.empty()) return 0;
  return jackknife_std(frequency, own.size(), cycles, 2, [&](std::size_t begin, std::size_t end) {
    std::vector<double> left = own;
    std::fill(left.begin() + static_cast<std::ptrdiff_t>(begin), left.begin() + static_cast<std::ptrdiff_t>(end), 0.0);
    return [left = std::move(left)](double f, std::size_t harmonics) { return energy_of(left, f, harmonics); };
  });
}

SystematicError systematic_error(std::span<const double> profile, double frequency, double margin) {
  const std::vector<double> own = own_rows(profile);
  const auto rows = static_cast<double>(own.size());
  const auto model = periodic_model(frequency, own.size(), kComparedHarmonics);
  if (own.size() <= 2 * model.parameters()) return {};
  const PeriodicSignals signals(own, own.size());
  const PeriodicFit fit = fit_periodic(signals, model, frequency, false);
  const double std = std::hypot(bend_of(own, frequency, margin), fold_error(fit, rows, 1));
  const double other = coarse_frequency(signals, {.lower = 1 / rows, .upper = 0.5 - 1 / rows});
  return {std, std::abs(other - frequency) * rows > 1};
}

Complex component_at(std::span<const double> profile, double frequency, std::size_t first_row) {
  Complex sum = 0;
  for (std::size_t n = 0; n < profile.size(); ++n)
    sum += profile[n] * turned(frequency * static_cast<double>(first_row + n));
  return sum;
}

double phase_at_start(std::span<const double> profile, double frequency, std::size_t first_row) {
  return std::arg(component_at(profile, frequency, first_row));
}

}  // namespace ocisac
