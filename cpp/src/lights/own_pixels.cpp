#include "lights/own_pixels.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <span>

#include "core/levels.hpp"
#include "core/linear_algebra.hpp"
#include "lights/profile_frequency.hpp"
#include "ocisac/rows/basis.hpp"
#include "rows/normal_factors.hpp"

namespace ocisac {

namespace {

using Complex = std::complex<double>;

constexpr std::size_t kMinBeyond = 4;  // rows

double squared(double x) { return x * x; }

// Weighted least squares of the profile on mean, slope, curvature (of a bright core) and harmonics. Rows without weight
// have the continued fit.
struct ToneFit {
  std::vector<double> slow, fitted;  // (rows): all but the tone; all terms
  double terms = 0;
  double tone = 0;  // Σ weight·x² of the tone, beyond the slow terms
};

constexpr std::size_t kSlowTerms = 3;

ToneFit fit_tone(const OwnPixels& pixels, double frequency) {
  const std::size_t rows = pixels.profile.size();
  const auto orders = std::clamp<std::size_t>(static_cast<std::size_t>(0.499 / frequency), 1, kComparedHarmonics);
  const RowSampling sampling = centred_rows(rows);
  std::vector<double> columns, frequencies;
  for (std::size_t h = 1; h <= orders; ++h) frequencies.push_back(static_cast<double>(h) * frequency);
  append_trend(columns, sampling, kSlowTerms - 1);
  append_tones(columns, sampling, frequencies);
  const auto column = [&](std::size_t k) { return vector_of(std::span(columns).subspan(k * rows, rows)); };
  const std::size_t count = kSlowTerms + 2 * orders;
  NormalProducts products;
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::VectorXd weighted = vector_of(pixels.weight).cwiseProduct(column(i));
    for (std::size_t j = 0; j <= i; ++j) products.normal(i, j) = weighted.dot(column(j));
    products.right(i) = weighted.dot(vector_of(pixels.profile));
  }
  const NormalFactors factors(products, count);
  const auto fitted_by = [&](std::size_t used) {
    std::array<double, NormalProducts::kMost> coefficients;
    factors.solve(std::span(coefficients).first(used));
    std::vector<double> out(rows);
    Eigen::Map<Eigen::VectorXd> sum(out.data(), static_cast<Eigen::Index>(rows));
    for (std::size_t k = 0; k < used; ++k) sum += coefficients[k] * column(k);
    return out;
  };
  ToneFit fit{fitted_by(std::min(kSlowTerms, factors.solvable())), fitted_by(factors.solvable()),
              static_cast<double>(factors.solvable())};
  for (std::size_t k = kSlowTerms; k < factors.solvable(); ++k) fit.tone += squared(factors.explained(k));
  return fit;
}

// The tone's energy by its frequency.
auto energy_in(const OwnPixels& pixels) {
  return [&pixels](double frequency, std::size_t) { return fit_tone(pixels, frequency).tone; };
}

// Profile and weight from the first to the last row with own pixels.
OwnPixels profile_of_own_rows(const OwnPixels& pixels) {
  const auto [first, end] = extent_of(pixels.weight);
  const auto from = static_cast<std::ptrdiff_t>(first), to = static_cast<std::ptrdiff_t>(end);
  const auto &profile = pixels.profile, &weight = pixels.weight;
  return {{}, {}, {profile.begin() + from, profile.begin() + to}, {weight.begin() + from, weight.begin() + to}};
}

// Σ weight·x² of what no term explains, per row.
double rest_of_row(const OwnPixels& pixels, double frequency) {
  const ToneFit fit = fit_tone(pixels, frequency);
  double sum = 0, rows = 0;
  for (std::size_t n = 0; n < pixels.weight.size(); ++n) {
    const double rest = pixels.profile[n] - fit.fitted[n];
    sum += pixels.weight[n] * rest * rest, rows += pixels.weight[n] > 0 ? 1 : 0;
  }
  return sum / std::max(rows - fit.terms, 1.0);
}

// The larger one of a jackknife over groups of cycles, as texture over a light has no independent rows, and of least
// squares with independent rows, σ² = 2·rest/curvature, since few groups may agree by chance.
double standard_error(const OwnPixels& pixels, double frequency) {
  const OwnPixels own = profile_of_own_rows(pixels);
  const std::size_t rows = own.profile.size();
  OwnPixels rest = own;
  const double cycles = std::max(static_cast<double>(rows) * frequency, 4.0);
  const double spread = jackknife_std(frequency, rows, cycles, 1, [&](std::size_t begin, std::size_t end) {
    rest.weight = own.weight;
    std::fill(rest.weight.begin() + static_cast<std::ptrdiff_t>(begin),
              rest.weight.begin() + static_cast<std::ptrdiff_t>(end), 0.0);
    return energy_in(rest);
  });
  const double curvature = peak_near(frequency, static_cast<double>(rows), energy_in(own)).curvature;
  const double noise = curvature > 0 ? 2 * rest_of_row(own, frequency) / curvature : squared(frequency);
  return std::max(spread, std::sqrt(noise));
}

// Moves each group by the mean over its own pixels less `wanted` (rows), and sums up its profile.
void centre(OwnPixels& pixels, std::span<const double> wanted) {
  const std::size_t rows = pixels.profile.size(), groups = pixels.light.size() / rows;
  std::vector<double> moves(groups), counts(groups);
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t g = 0; g < groups; ++g)
      if (pixels.own[n * groups + g]) moves[g] += pixels.light[n * groups + g] - wanted[n], counts[g] += 1;
  std::ranges::fill(pixels.profile, 0.0);
  std::ranges::fill(pixels.weight, 0.0);
  for (std::size_t n = 0; n < rows; ++n) {
    for (std::size_t g = 0; g < groups; ++g) {
      const std::size_t i = n * groups + g;
      if (counts[g] > 0) pixels.light[i] -= moves[g] / counts[g];
      if (pixels.own[i]) pixels.profile[n] += pixels.light[i], pixels.weight[n] += 1;
    }
    if (pixels.weight[n] > 0) pixels.profile[n] /= pixels.weight[n];
  }
}

// The range of the largest sum; empty if no value is positive.
IndexRange largest_range(std::span<const double> values) {
  IndexRange best;
  double largest = 0, sum = 0;
  std::size_t first = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    sum += values[i];
    if (sum <= 0) sum = 0, first = i + 1;
    if (sum > largest) largest = sum, best = {first, i + 1};
  }
  return best;
}

// A normal distribution; its ln is bounded at outliers.
struct Normal {
  double mean = 0, variance = 0;

  [[nodiscard]] double log_density(double x) const {
    return -0.5 * std::log(variance) - 0.5 * std::min(squared(x - mean) / variance, kWeak * kWeak);
  }
};

// Estimates the distribution of a group's rows [first, end), above or below its own; absent for few rows.
std::optional<Normal> beyond(const OwnPixels& pixels, std::size_t group, std::size_t first, std::size_t end) {
  if (end < first + kMinBeyond) return {};
  const std::size_t groups = pixels.light.size() / pixels.profile.size();
  double sum = 0, squares = 0;
  for (std::size_t n = first; n < end; ++n) {
    const double x = pixels.light[n * groups + group];
    sum += x, squares += x * x;
  }
  const auto count = static_cast<double>(end - first);
  return Normal{sum / count, std::max(squares / count - squared(sum / count), squared(kNextToNone))};
}

// Compares two hypotheses for each pixel x, of variance s²: ln p(x | light)/max(p(x | texture), p(x | surroundings)),
// with light N(slow + tone, s²), texture that swings as much N(slow, s² + tone²), surroundings as beyond(). Ratios of
// groups without own pixels are 0.
std::vector<double> likelihood_ratios(const OwnPixels& pixels, const ToneFit& fit) {
  const auto &slow = fit.slow, &all = fit.fitted;
  const std::size_t rows = pixels.profile.size(), groups = pixels.light.size() / rows;
  std::vector<double> residuals;
  double swing = 0, low = std::numeric_limits<double>::infinity(), high = -low;
  for (std::size_t n = 0; n < rows; ++n) {
    if (!(pixels.weight[n] > 0)) continue;
    low = std::min(low, slow[n]), high = std::max(high, slow[n]);
    swing += pixels.weight[n] * squared(all[n] - slow[n]);
    for (std::size_t i = n * groups; i < (n + 1) * groups; ++i)
      if (pixels.own[i]) residuals.push_back(std::abs(pixels.light[i] - all[n]));
  }
  std::vector<double> ratios(pixels.light.size());
  if (residuals.empty()) return ratios;
  swing /= static_cast<double>(residuals.size());
  const double own = std::max(variance_by_median(std::move(residuals)), squared(kNextToNone));
  for (std::size_t g = 0; g < groups; ++g) {
    std::size_t first = 0, end = rows;
    while (first < end && !pixels.own[first * groups + g]) ++first;
    while (end > first && !pixels.own[(end - 1) * groups + g]) --end;
    if (first == end) continue;
    const auto above = beyond(pixels, g, 0, first), below = beyond(pixels, g, end, rows);
    for (std::size_t n = 0; n < rows; ++n) {
      const double x = pixels.light[n * groups + g], level = std::clamp(slow[n], low, high);
      double other = Normal{level, own + swing}.log_density(x);
      if (const auto& side = 2 * n < first + end ? above : below) other = std::max(other, side->log_density(x));
      ratios[n * groups + g] = Normal{level + all[n] - slow[n], own}.log_density(x) - other;
    }
  }
  return ratios;
}

// The light's own pixels by their likelihood ratios: at least a cycle of a group.
void select(OwnPixels& pixels, const ToneFit& fit, double frequency) {
  const std::vector<double> ratios = likelihood_ratios(pixels, fit);
  const std::size_t rows = pixels.profile.size(), groups = pixels.light.size() / rows;
  std::vector<double> of_rows(rows);
  std::ranges::fill(pixels.own, std::uint8_t{0});
  for (std::size_t g = 0; g < groups; ++g) {
    for (std::size_t n = 0; n < rows; ++n) of_rows[n] = ratios[n * groups + g];
    const auto [first, end] = largest_range(of_rows);
    if (static_cast<double>(end - first) * frequency < 1) continue;
    for (std::size_t n = first; n < end; ++n) pixels.own[n * groups + g] = 1;
  }
  centre(pixels, fit.fitted);
}

}  // namespace

OwnPixels own_pixels(const Patch& patch, const ComplexValues& swing, const Region& box, std::size_t reach,
                     double least) {
  Complex sum = 0;
  for (std::size_t n = box.y; n < box.bottom(); ++n)
    for (std::size_t g = box.x; g < box.right(); ++g) sum += swing[n * patch.stride + g];
  const Complex phase = sum == Complex(0) ? Complex(1) : sum / std::abs(sum);
  const std::size_t first = box.y - std::min(box.y, reach);
  const std::size_t rows = std::min(box.bottom() + reach, patch.rows) - first, groups = box.width;
  OwnPixels out{std::vector<double>(rows * groups),
                std::vector<std::uint8_t>(rows * groups),
                std::vector<double>(rows),
                std::vector<double>(rows),
                {patch.first_column + box.x * patch.group, patch.first_row + first, groups * patch.group, rows},
                patch.group};
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t g = 0; g < groups; ++g) {
      const std::size_t row = first + n, from = row * patch.stride + box.x + g, to = n * groups + g;
      out.light[to] = patch.logs[from];
      out.own[to] = row >= box.y && row < box.bottom() &&
                    swing.real[from] * phase.real() + swing.imaginary[from] * phase.imag() > least;
    }
  centre(out, std::vector<double>(rows));
  return out;
}

double strongest_frequency(const OwnPixels& pixels, double lower, double upper) {
  const OwnPixels own = profile_of_own_rows(pixels);
  if (own.profile.empty()) return lower;
  return strongest_frequency(lower, upper, static_cast<double>(own.profile.size()), energy_in(own));
}

std::optional<double> fit_outline(OwnPixels& pixels, double frequency) {
  centre(pixels, std::vector<double>(pixels.profile.size()));
  for (int round = 0; round < kMaxIterations; ++round) {
    const double lower = frequency * (1 - kFrequencyReach), upper = std::min(frequency * (1 + kFrequencyReach), 0.499);
    frequency = strongest_frequency(pixels, lower, upper);
    if (frequency <= lower || frequency >= upper) return {};
    const ToneFit fit = fit_tone(pixels, frequency);
    centre(pixels, fit.fitted);
    const std::vector<std::uint8_t> before = pixels.own;
    select(pixels, fit, frequency);
    const auto [first, end] = extent_of(pixels.weight);
    if (first == end) return {};
    if (pixels.own == before) break;
  }
  return frequency;
}

Region own_box(const OwnPixels& pixels) {
  const auto [first, end] = extent_of(pixels.weight);
  const std::size_t groups = pixels.light.size() / pixels.profile.size();
  std::size_t left = groups, right = 0;
  for (std::size_t i = 0; i < pixels.own.size(); ++i)
    if (pixels.own[i]) left = std::min(left, i % groups), right = std::max(right, i % groups + 1);
  return {pixels.box.x + left * pixels.group, pixels.box.y + first, (right - left) * pixels.group, end - first};
}

RefinedLight refined_light(const OwnPixels& pixels, double frequency, double noise) {
  const ToneFit fit = fit_tone(pixels, frequency);
  const auto &slow = fit.slow, &all = fit.fitted;
  const std::size_t rows = pixels.profile.size(), groups = rows > 0 ? pixels.light.size() / rows : 0;
  double total = 0, rest = 0, common = 0, spread = 0, count = 0;
  Complex uneven = 0;
  std::vector<double> tone(rows);
  for (std::size_t n = 0; n < rows; ++n) {
    double apart = 0;
    for (std::size_t i = n * groups; i < (n + 1) * groups; ++i) {
      if (!pixels.own[i]) continue;
      const double x = pixels.light[i];
      total += squared(x - slow[n]);
      rest += squared(x - all[n]);
      apart += squared(x - pixels.profile[n]);
    }
    common += pixels.weight[n] * squared(pixels.profile[n] - slow[n]);
    count += pixels.weight[n];
    spread += apart;
    uneven += apart * turned(frequency * static_cast<double>(n));
    tone[n] = pixels.weight[n] * (all[n] - slow[n]);
  }
  RefinedLight light{};
  light.frequency = frequency, light.frequency_std = standard_error(pixels, frequency);
  light.systematic = systematic_error(profile_of_own_rows(pixels).profile, frequency);
  light.phase = phase_at_start(tone, frequency, pixels.box.y);
  if (!(total > 0)) return light;
  const double explained = std::clamp(1 - rest / total, 0.0, 1.0);
  light.snr = explained / std::max(1 - explained, 1e-12);
  light.common = std::min(common / total, 1.0);
  light.periodic = light.common > 0 ? std::min(explained / light.common, 1.0) : 0;
  light.texture = std::max(rest - count * noise, 0.0) / std::max(total * explained, 1e-300);
  light.uneven = spread > 0 ? std::abs(uneven) / spread : 0;
  return light;
}

}  // namespace ocisac
