#include "tones/folded_harmonics.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <memory>
#include <numbers>
#include <numeric>
#include <tuple>

#include "core/levels.hpp"
#include "core/recently_used.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "ocisac/rows/basis.hpp"

namespace ocisac {

double harmonic_ratio(int order, double duty, double exposure_cycles) {
  const double fundamental = sinc(exposure_cycles);
  const double exposed = std::copysign(std::max(std::abs(fundamental), 1e-9), fundamental);
  return sinc(order * duty) / sinc(duty) * sinc(order * exposure_cycles) / exposed;
}

namespace {

// Two cycles in 2048 rows have as many. Higher ones have less than a five-hundredth of the fundamental, and memory and
// time of a fit grow with their number.
constexpr int kMostHarmonics = 512;

FoldedHarmonics find_folded(std::size_t rows, double cycles_per_row, double duty, double exposure_cycles) {
  constexpr double kApart = 1.5, kFitted = 0.005, kLeast = 1e-4;  // cycles in the frame; of the fundamental
  constexpr int kHighest = 127;
  const auto length = static_cast<double>(rows);
  const auto folded = [&](int order) {  // cycles in the frame
    const double cycles = order * cycles_per_row;
    return std::abs(cycles - std::nearbyint(cycles)) * length;
  };
  std::vector<double> taken{0, length / 2};
  for (const int order : square_wave_harmonics(cycles_per_row, duty)) taken.push_back(folded(order));
  const double fundamental = folded(1);
  const double over_mean = 2 * std::abs(sinc(duty) * sinc(exposure_cycles));
  const auto leak = [](double apart) { return std::min(1.0, 1 / (std::numbers::pi * apart)); };
  FoldedHarmonics result;
  double squares = 0;
  for (int order = 2; order <= kHighest; ++order) {
    const double size = std::abs(harmonic_ratio(order, duty, exposure_cycles)), at = folded(order);
    if (order * cycles_per_row < 0.5 || size < kLeast) continue;
    const auto is_near = [&](double other) { return std::abs(at - other) < kApart; };
    if (size >= kFitted && std::ranges::none_of(taken, is_near) && 8 * (taken.size() + 1) <= rows) {
      taken.push_back(at);
      result.orders.push_back(order);
      continue;
    }
    result.tied.push_back(order);
    // Beside a harmonic that is fitted it is a part of that.
    if (std::any_of(taken.begin() + 3, taken.end(), is_near)) continue;
    squares += size * size / 2 * (std::pow(leak(std::abs(at - fundamental)), 2) + std::pow(over_mean * leak(at), 2));
  }
  result.error = std::sqrt(squares);
  result.onto.resize(kHighest + 1);
  for (const int order : result.tied) {
    const double size = harmonic_ratio(order, duty, exposure_cycles);
    for (int onto = 1; onto <= kHighest; ++onto)
      result.onto[static_cast<std::size_t>(onto)] += std::pow(size * leak(std::abs(folded(order) - folded(onto))), 2);
  }
  return result;
}

// Estimates of a wave whose light has level 1, by its phase in steps of a turn: its fundamental, and the light that its
// harmonics add to the mean.
void show(const HarmonicModel& model, std::span<const int> tied, double cycles_per_row, double duty,
          double exposure_cycles, std::vector<std::complex<double>>& fundamentals, std::vector<double>& means) {
  const std::size_t count = means.size();
  const std::vector<double> times = centred_rows(model.rows).times;
  std::vector<double> cosine(model.rows), sine(model.rows);
  std::vector<std::complex<double>> turns;
  for (std::size_t k = 0; k < count; ++k)
    turns.push_back(std::polar(1.0, kTwoPi * static_cast<double>(k) / static_cast<double>(count)));
  fundamentals = turns;
  const double sign = std::copysign(1.0, sinc(exposure_cycles));
  for (const int order : tied) {
    fill_wave(times, order * cycles_per_row, cosine, sine);
    const auto fitted = [&](Eigen::Index estimate, std::span<const double> wave) {
      return std::inner_product(wave.begin(), wave.end(), model.weights.col(estimate).data(), 0.0);
    };
    const double ratio = harmonic_ratio(order, duty, exposure_cycles);
    const double mean = sign * ratio * fitted(0, cosine), even = ratio * fitted(1, cosine),
                 odd = ratio * fitted(2, sine);
    for (std::size_t k = 0; k < count; ++k) {
      const auto& at = turns[static_cast<std::size_t>(order) * k % count];
      fundamentals[k] += std::complex<double>(even * at.real(), odd * at.imag());
      means[k] += mean * at.real();
    }
  }
}

}  // namespace

std::vector<int> square_wave_harmonics(double cycles_per_row, double duty) {
  std::vector<int> harmonics{1};
  for (int h = 2; h <= kMostHarmonics && h * cycles_per_row < 0.5; ++h)
    if (std::abs(sinc(h * duty)) > 1e-9) harmonics.push_back(h);
  return harmonics;
}

FoldedHarmonics folded_harmonics(std::size_t rows, double cycles_per_row, double duty, double exposure_cycles) {
  static RecentlyUsed<std::tuple<std::size_t, double, double, double>, FoldedHarmonics, 32> kept;
  return *kept.get({rows, cycles_per_row, duty, exposure_cycles}, [&] {
    return std::make_shared<const FoldedHarmonics>(find_folded(rows, cycles_per_row, duty, exposure_cycles));
  });
}

TiedHarmonics::TiedHarmonics(const HarmonicModel& model, std::span<const int> tied, double cycles_per_row, double duty,
                             double exposure_cycles) {
  constexpr std::size_t kPhases = 4096;
  std::vector<std::complex<double>> fundamentals;
  std::vector<double> means(kPhases);
  show(model, tied, cycles_per_row, duty, exposure_cycles, fundamentals, means);
  const double step = kTwoPi / kPhases;
  lights_.assign(kPhases, {kInfinity, 0, 0, 0, 0, 0});
  for (std::size_t k = 0; k < kPhases; ++k) {
    const std::size_t after = (k + 1) % kPhases;
    const auto &one = fundamentals[k], &next = fundamentals[after];
    const double first = std::arg(one) / step, steps = std::arg(next * std::conj(one)) / step;
    const double low = std::min(first, first + steps), high = std::max(first, first + steps);
    const double level = 1 / std::abs(one), next_level = 1 / std::abs(next);
    for (double at = std::floor(low); at <= std::ceil(high); ++at) {
      Lights& lights = lights_[static_cast<std::size_t>(at + 2 * kPhases) % kPhases];
      lights.least = std::min({lights.least, level, next_level});
      lights.most = std::max({lights.most, level, next_level});
      if (at < low || at >= high) continue;
      const double part = (at - first) / steps;
      lights.level += std::lerp(level, next_level, part);
      lights.mean += std::lerp(means[k], means[after], part);
      lights.turn += std::remainder(step * (static_cast<double>(k) + part - at), kTwoPi);
      ++lights.count;
    }
  }
}

const TiedHarmonics::Lights& TiedHarmonics::lights_at(double place) const {
  const auto count = static_cast<double>(lights_.size());
  return lights_[static_cast<std::size_t>(place - count * std::floor(place / count)) % lights_.size()];
}

std::optional<TiedHarmonics::Light> TiedHarmonics::light(double phase, double phase_std) const {
  constexpr double kSteepest = 3;  // of the level's logarithm over the phase
  const double step = kTwoPi / static_cast<double>(lights_.size()), place = std::floor(phase / step);
  const double reach = std::max(std::ceil(kWeak * phase_std / step), 1.0), part = phase / step - place;
  double spread = 0;
  for (double at = place - reach; at <= place + 1 + reach; ++at) {
    const Lights& lights = lights_at(at);
    if (lights.count == 0) return {};
    const double told = lights.count == 1 ? kSteepest * step * lights.least : 0;
    spread = std::max(spread, (lights.most - lights.least) / 2 - told);
  }
  const auto at = [&](double where, double Lights::*sum) {
    const Lights& lights = lights_at(where);
    return lights.*sum / static_cast<double>(lights.count);
  };
  const auto here = [&](double Lights::*sum) { return std::lerp(at(place, sum), at(place + 1, sum), part); };
  const double before = at(place - reach, &Lights::level), after = at(place + 1 + reach, &Lights::level);
  const double level = here(&Lights::level);
  return Light{level, spread, here(&Lights::mean), here(&Lights::turn),
               (after - before) / ((2 * reach + 1) * step * level)};
}

}  // namespace ocisac
