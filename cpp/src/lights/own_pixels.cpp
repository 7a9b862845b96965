#include "lights/own_pixels.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <numeric>
#include <span>

#include "lights/profile_frequency.hpp"

namespace ocisac {

namespace {

using Complex = std::complex<double>;

constexpr std::size_t max_orders = 3;
constexpr std::size_t max_groups = 16;  // of a jackknife
constexpr double dependent = 1e-9;      // relative energy of a column that others explain
constexpr int ascents = 3;              // Newton steps of a frequency
constexpr int outline_rounds = 6;
constexpr double outline_reach = 0.12;  // of the frequency in a round, relative
constexpr double outlier = 9;           // squared, in standard deviations
constexpr double smallest_spread = 1e-3;
constexpr double excluded = -1e3;
constexpr std::size_t min_beyond = 4;  // rows

double squared(double x) { return x * x; }

// Weighted least squares of the profile on mean, slope, curvature (of a bright core) and harmonics, whose amplitude
// may change along the rows as a slope beneath the lamp makes it. Terms enter one by one by rows of the Cholesky factor
// of the normal equations; the amount of a term is its share of the profile beyond the terms before it.
class ToneFit {
 public:
  ToneFit(const OwnPixels& pixels, double frequency) : terms_(pixels.profile.size()) {
    const auto orders = std::clamp<std::size_t>(static_cast<std::size_t>(0.499 / frequency), 1, max_orders);
    const ComplexValues turns = turns_of(frequency, terms_.size());
    for (std::size_t n = 0; n < terms_.size(); ++n) {
      const double x = along(n);
      terms_[n] = {1, x, x * x};
      Complex harmonic = 1;
      for (std::size_t h = 0; h < orders; ++h) {
        harmonic = product(harmonic, Complex(turns.real[n], turns.imaginary[n]));
        terms_[n][slow_terms + 2 * h] = harmonic.real(), terms_[n][slow_terms + 2 * h + 1] = harmonic.imag();
      }
    }
    std::array<Terms, max_terms> products{};
    Terms sums{};
    for (std::size_t n = 0; n < terms_.size(); ++n) {
      if (!(pixels.weight[n] > 0)) continue;
      for (std::size_t k = 0; k + 1 < max_terms; ++k) add_products(products[k], pixels.weight[n] * terms_[n][k], n);
      add_products(sums, pixels.weight[n] * pixels.profile[n], n);
    }
    for (std::size_t k = 0; k < slow_terms; ++k) add(k, products[k], sums[k]);
    of_slow_ = coefficients();
    for (std::size_t k = slow_terms; k + 1 < max_terms; ++k) add(k, products[k], sums[k]);
    const Terms of_all = coefficients();
    constexpr std::size_t changing = max_terms - 1;
    double sum = 0;
    for (std::size_t n = 0; n < terms_.size(); ++n) {
      const double term = along(n) * (value(of_all, n) - value(of_slow_, n));
      terms_[n][changing] = term;
      if (!(pixels.weight[n] > 0)) continue;
      add_products(products[changing], pixels.weight[n] * term, n);
      sum += pixels.weight[n] * term * pixels.profile[n];
    }
    add(changing, products[changing], sum);
    of_all_ = coefficients();
  }

  // Σ weight·x² of the tone.
  [[nodiscard]] double tone() const {
    return std::inner_product(amounts_.begin() + slow_terms, amounts_.end(), amounts_.begin() + slow_terms, 0.0);
  }
  // (rows): all but the tone; all fitted terms. Rows without weight have the continued fit.
  [[nodiscard]] std::vector<double> slow() const { return values(of_slow_); }
  [[nodiscard]] std::vector<double> fitted() const { return values(of_all_); }
  [[nodiscard]] double terms() const { return static_cast<double>(std::ranges::count(used_, true)); }

 private:
  static constexpr std::size_t slow_terms = 3, max_terms = slow_terms + 2 * max_orders + 1;
  using Terms = std::array<double, max_terms>;

  // Place of a row, −1 to 1.
  [[nodiscard]] double along(std::size_t n) const {
    return 2 * static_cast<double>(n) / static_cast<double>(terms_.size()) - 1;
  }

  void add_products(Terms& products, double factor, std::size_t n) const {
    for (std::size_t k = 0; k < max_terms; ++k) products[k] += factor * terms_[n][k];
  }

  // The factor's row k: `products` with the terms before it and with itself, `sum` with the profile. A term that others
  // explain is left out.
  void add(std::size_t k, const Terms& products, double sum) {
    Terms& row = factor_[k];
    double energy = products[k];
    for (std::size_t i = 0; i < k; ++i) {
      if (!used_[i]) continue;
      row[i] =
          (products[i] - std::inner_product(row.begin(), row.begin() + i, factor_[i].begin(), 0.0)) / factor_[i][i];
      energy -= squared(row[i]), sum -= row[i] * amounts_[i];
    }
    if (!(energy > dependent * products[k])) return row.fill(0);
    row[k] = std::sqrt(energy), amounts_[k] = sum / row[k], used_[k] = true;
  }

  [[nodiscard]] Terms coefficients() const {
    Terms out{};
    for (std::size_t k = max_terms; k-- > 0;) {
      if (!used_[k]) continue;
      double rest = amounts_[k];
      for (std::size_t i = k + 1; i < max_terms; ++i) rest -= factor_[i][k] * out[i];
      out[k] = rest / factor_[k][k];
    }
    return out;
  }

  [[nodiscard]] double value(const Terms& coefficients, std::size_t n) const {
    return std::inner_product(coefficients.begin(), coefficients.end(), terms_[n].begin(), 0.0);
  }

  [[nodiscard]] std::vector<double> values(const Terms& coefficients) const {
    std::vector<double> out(terms_.size());
    for (std::size_t n = 0; n < out.size(); ++n) out[n] = value(coefficients, n);
    return out;
  }

  std::vector<Terms> terms_;                  // of each row
  std::array<Terms, max_terms> factor_ = {};  // lower triangle
  Terms amounts_ = {}, of_slow_ = {}, of_all_ = {};
  std::array<bool, max_terms> used_ = {};
};

double tone_energy(const OwnPixels& pixels, double frequency) { return ToneFit(pixels, frequency).tone(); }

// Rows with own pixels, from the first to the last.
IndexRange own_rows(const OwnPixels& pixels) {
  std::size_t first = 0, end = pixels.weight.size();
  while (first < end && !(pixels.weight[first] > 0)) ++first;
  while (end > first && !(pixels.weight[end - 1] > 0)) --end;
  return {first, end};
}

// Profile and weight from the first to the last row with own pixels.
OwnPixels profile_of_own_rows(const OwnPixels& pixels) {
  const auto [first, end] = own_rows(pixels);
  const auto from = static_cast<std::ptrdiff_t>(first), to = static_cast<std::ptrdiff_t>(end);
  const auto &profile = pixels.profile, &weight = pixels.weight;
  return {{}, {}, {profile.begin() + from, profile.begin() + to}, {weight.begin() + from, weight.begin() + to}};
}

// The energy around a frequency by differences, of a light of that many rows.
struct Peak {
  double to_maximum;  // distance by a Newton step; the frequency itself where there is no maximum
  double curvature;   // −d²/df²
};

Peak peak_near(const OwnPixels& pixels, double frequency, double rows) {
  const double step = 0.02 / rows;
  const double below = tone_energy(pixels, frequency - step), above = tone_energy(pixels, frequency + step);
  const double bend = 2 * tone_energy(pixels, frequency) - below - above;
  return {bend > 0 ? 0.5 * step * (above - below) / bend : frequency, bend / (step * step)};
}

// Σ weight·x² of what no term explains, per row.
double rest_of_row(const OwnPixels& pixels, double frequency) {
  const ToneFit fit(pixels, frequency);
  const std::vector<double> fitted = fit.fitted();
  double sum = 0, rows = 0;
  for (std::size_t n = 0; n < pixels.weight.size(); ++n) {
    const double rest = pixels.profile[n] - fitted[n];
    sum += pixels.weight[n] * rest * rest, rows += pixels.weight[n] > 0 ? 1 : 0;
  }
  return sum / std::max(rows - fit.terms(), 1.0);
}

// The larger one of a jackknife over groups of cycles, as texture over a light has no independent rows, and of least
// squares with independent rows, σ² = 2·rest/curvature, since few groups may agree by chance.
double standard_error(const OwnPixels& pixels, double frequency) {
  const OwnPixels own = profile_of_own_rows(pixels);
  const std::size_t rows = own.profile.size();
  const auto groups =
      std::clamp<std::size_t>(static_cast<std::size_t>(static_cast<double>(rows) * frequency), 4, max_groups);
  OwnPixels rest = own;
  double sum = 0, square = 0;
  for (std::size_t k = 0; k < groups; ++k) {
    const auto first = static_cast<std::ptrdiff_t>(k * rows / groups);
    const auto end = static_cast<std::ptrdiff_t>((k + 1) * rows / groups);
    std::fill(rest.weight.begin() + first, rest.weight.begin() + end, 0.0);
    const double moved = peak_near(rest, frequency, static_cast<double>(rows)).to_maximum;
    sum += moved, square += moved * moved;
    std::copy(own.weight.begin() + first, own.weight.begin() + end, rest.weight.begin() + first);
  }
  const auto count = static_cast<double>(groups);
  const double spread = std::max(square - sum * sum / count, 0.0) * (count - 1) / count;
  const double curvature = peak_near(own, frequency, static_cast<double>(rows)).curvature;
  const double noise = curvature > 0 ? 2 * rest_of_row(own, frequency) / curvature : squared(frequency);
  return std::sqrt(std::max(spread, noise));
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
    return -0.5 * std::log(variance) - 0.5 * std::min(squared(x - mean) / variance, outlier);
  }
};

// Estimates the distribution of a group's rows [first, end), above or below its own; absent for few rows.
std::optional<Normal> beyond(const OwnPixels& pixels, std::size_t group, std::size_t first, std::size_t end) {
  if (end < first + min_beyond) return {};
  const std::size_t groups = pixels.light.size() / pixels.profile.size();
  double sum = 0, squares = 0;
  for (std::size_t n = first; n < end; ++n) {
    const double x = pixels.light[n * groups + group];
    sum += x, squares += x * x;
  }
  const auto count = static_cast<double>(end - first);
  return Normal{sum / count, std::max(squares / count - squared(sum / count), squared(smallest_spread))};
}

// Compares two hypotheses for each pixel x, of variance s²: ln p(x | light)/max(p(x | texture), p(x | surroundings)),
// with light N(slow + tone, s²), texture that swings as much N(slow, s² + tone²), surroundings as beyond(). Ratios of
// groups without own pixels are 0.
std::vector<double> likelihood_ratios(const OwnPixels& pixels, const ToneFit& fit) {
  const std::vector<double> slow = fit.slow();
  const std::vector<double> all = fit.fitted();
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
  const double own = std::max(variance_by_median(residuals), squared(smallest_spread));
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

// The light's own pixels by their likelihood ratios, each group with its neighbours: at least a cycle of a group, and
// groups side by side.
void select(OwnPixels& pixels, const ToneFit& fit, double frequency) {
  const std::vector<double> ratios = likelihood_ratios(pixels, fit);
  const std::size_t rows = pixels.profile.size(), groups = pixels.light.size() / rows;
  std::vector<double> sums(rows), of_groups(groups, excluded);
  std::ranges::fill(pixels.own, std::uint8_t{0});
  for (std::size_t g = 0; g < groups; ++g) {
    for (std::size_t n = 0; n < rows; ++n) {
      const double* at = &ratios[n * groups + g];
      sums[n] = at[0] + (g > 0 ? at[-1] : 0) + (g + 1 < groups ? at[1] : 0);
    }
    const auto [first, end] = largest_range(sums);
    if (static_cast<double>(end - first) * frequency < 1) continue;
    of_groups[g] = 0;
    for (std::size_t n = first; n < end; ++n) pixels.own[n * groups + g] = 1, of_groups[g] += ratios[n * groups + g];
  }
  const auto [left, right] = largest_range(of_groups);
  for (std::size_t i = 0; i < pixels.own.size(); ++i)
    if (i % groups < left || i % groups >= right) pixels.own[i] = 0;
  centre(pixels, fit.fitted());
}

}  // namespace

OwnPixels own_pixels(const Patch& patch, const ComplexValues& swing, const PatchRange& box, std::size_t reach,
                     double least) {
  Complex sum = 0;
  for (std::size_t n = box.first_row; n < box.end_row; ++n)
    for (std::size_t g = box.first_group; g < box.end_group; ++g) sum += swing[n * patch.stride + g];
  const Complex phase = sum == Complex(0) ? Complex(1) : sum / std::abs(sum);
  const std::size_t first = box.first_row - std::min(box.first_row, reach);
  const std::size_t rows = std::min(box.end_row + reach, patch.rows) - first, groups = box.end_group - box.first_group;
  OwnPixels out{
      std::vector<double>(rows * groups),
      std::vector<std::uint8_t>(rows * groups),
      std::vector<double>(rows),
      std::vector<double>(rows),
      {patch.first_column + box.first_group * patch.group, patch.first_row + first, groups * patch.group, rows},
      patch.group};
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t g = 0; g < groups; ++g) {
      const std::size_t row = first + n, from = row * patch.stride + box.first_group + g, to = n * groups + g;
      out.light[to] = patch.logs[from];
      out.own[to] = row >= box.first_row && row < box.end_row &&
                    swing.real[from] * phase.real() + swing.imaginary[from] * phase.imag() > least;
    }
  centre(out, std::vector<double>(rows));
  return out;
}

double strongest_frequency(const OwnPixels& pixels, double lower, double upper) {
  const auto [first, end] = own_rows(pixels);
  if (first == end) return lower;
  const OwnPixels own = profile_of_own_rows(pixels);
  const auto rows = static_cast<double>(end - first);
  const double step = 0.125 / rows;
  const auto count = static_cast<std::size_t>((upper - lower) / step) + 1;
  double best = lower, most = -1;
  for (std::size_t i = 0; i <= count; ++i) {
    const double frequency = std::min(lower + static_cast<double>(i) * step, upper);
    const double energy = tone_energy(own, frequency);
    if (energy > most) most = energy, best = frequency;
  }
  if (best <= lower || best >= upper) return best;
  for (int ascent = 0; ascent < ascents; ++ascent)
    best += std::clamp(peak_near(own, best, rows).to_maximum, -0.5 * step, 0.5 * step);
  return best;
}

std::optional<double> fit_outline(OwnPixels& pixels, double frequency) {
  centre(pixels, std::vector<double>(pixels.profile.size()));
  for (int round = 0; round < outline_rounds; ++round) {
    const double lower = frequency * (1 - outline_reach), upper = std::min(frequency * (1 + outline_reach), 0.499);
    frequency = strongest_frequency(pixels, lower, upper);
    if (frequency <= lower || frequency >= upper) return {};
    const ToneFit fit(pixels, frequency);
    centre(pixels, fit.fitted());
    const std::vector<std::uint8_t> before = pixels.own;
    select(pixels, fit, frequency);
    const auto [first, end] = own_rows(pixels);
    if (first == end) return {};
    if (pixels.own == before) break;
  }
  return frequency;
}

Region own_box(const OwnPixels& pixels) {
  const auto [first, end] = own_rows(pixels);
  const std::size_t groups = pixels.light.size() / pixels.profile.size();
  std::size_t left = groups, right = 0;
  for (std::size_t i = 0; i < pixels.own.size(); ++i)
    if (pixels.own[i]) left = std::min(left, i % groups), right = std::max(right, i % groups + 1);
  return {pixels.box.x + left * pixels.group, pixels.box.y + first, (right - left) * pixels.group, end - first};
}

RefinedLight light_of(const OwnPixels& pixels, double frequency, double noise) {
  const ToneFit fit(pixels, frequency);
  const std::vector<double> slow = fit.slow();
  const std::vector<double> all = fit.fitted();
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
