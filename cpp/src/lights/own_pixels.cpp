#include "lights/own_pixels.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numeric>
#include <span>
#include <utility>

#include "lights/profile_frequency.hpp"

namespace ocisac {

namespace {

using Complex = std::complex<double>;

constexpr std::size_t max_orders = 3;
constexpr std::size_t max_groups = 16;   // of a jackknife
constexpr double dependent = 1e-9;       // relative energy of a column that others explain
constexpr double frequency_step = 1e-7;  // cycles per row, of the search's end

double product(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

void subtract(std::vector<double>& from, double factor, std::span<const double> other) {
  for (std::size_t n = 0; n < from.size(); ++n) from[n] -= factor * other[n];
}

// Weighted least squares of the profile on mean, slope and harmonics by modified Gram-Schmidt.
class ToneFit {
 public:
  ToneFit(const OwnPixels& pixels, double frequency) : profile_(pixels.profile) {
    for (const double weight : pixels.weight) root_.push_back(std::sqrt(weight));
    for (std::size_t n = 0; n < root_.size(); ++n) rest_.push_back(root_[n] * profile_[n]);
    const double middle = 0.5 * static_cast<double>(root_.size());
    add([](std::size_t) { return 1.0; });
    add([&](std::size_t n) { return static_cast<double>(n) - middle; });
    slow_ = fitted();
    const double before = product(rest_, rest_);
    const auto orders = std::clamp<std::size_t>(static_cast<std::size_t>(0.499 / frequency), 1, max_orders);
    const Turns turns = turns_of(frequency, root_.size());
    std::vector<Complex> harmonic(root_.size(), 1);
    for (std::size_t h = 1; h <= orders; ++h) {
      for (std::size_t n = 0; n < harmonic.size(); ++n)
        harmonic[n] = ocisac::product(harmonic[n], Complex(turns.real[n], turns.imaginary[n]));
      add([&](std::size_t n) { return harmonic[n].real(); });
      add([&](std::size_t n) { return harmonic[n].imag(); });
    }
    tone_ = before - product(rest_, rest_);
  }

  // Σ weight·x² of the tone.
  [[nodiscard]] double tone() const { return tone_; }
  // (rows): mean and slope; all fitted terms.
  [[nodiscard]] const std::vector<double>& slow() const { return slow_; }
  [[nodiscard]] std::vector<double> fitted() const {
    std::vector<double> out(root_.size());
    for (std::size_t n = 0; n < out.size(); ++n) out[n] = root_[n] > 0 ? profile_[n] - rest_[n] / root_[n] : 0;
    return out;
  }

 private:
  void add(const auto& function) {
    std::vector<double> column(root_.size());
    for (std::size_t n = 0; n < column.size(); ++n) column[n] = root_[n] * function(n);
    const double before = product(column, column);
    for (const auto& other : basis_) subtract(column, product(column, other), other);
    const double energy = product(column, column);
    if (!(energy > dependent * before)) return;
    for (double& value : column) value /= std::sqrt(energy);
    subtract(rest_, product(column, rest_), column);
    basis_.push_back(std::move(column));
  }

  const std::vector<double>& profile_;
  std::vector<double> root_, rest_, slow_;
  std::vector<std::vector<double>> basis_;
  double tone_ = 0;
};

double tone_energy(const OwnPixels& pixels, double frequency) { return ToneFit(pixels, frequency).tone(); }

// Distance to the maximum of the energy near a frequency: a Newton step by differences.
double to_maximum(const OwnPixels& pixels, double frequency) {
  const double step = 0.02 / static_cast<double>(pixels.profile.size());
  const double below = tone_energy(pixels, frequency - step), above = tone_energy(pixels, frequency + step);
  const double bend = 2 * tone_energy(pixels, frequency) - below - above;
  return bend > 0 ? 0.5 * step * (above - below) / bend : frequency;
}

// Jackknife over groups of cycles: texture over a light has no independent rows.
double standard_error(const OwnPixels& pixels, double frequency) {
  const std::size_t rows = pixels.profile.size();
  const auto groups =
      std::clamp<std::size_t>(static_cast<std::size_t>(static_cast<double>(rows) * frequency), 4, max_groups);
  OwnPixels rest{{}, {}, pixels.profile, pixels.weight};
  double sum = 0, square = 0;
  for (std::size_t k = 0; k < groups; ++k) {
    const auto first = static_cast<std::ptrdiff_t>(k * rows / groups);
    const auto end = static_cast<std::ptrdiff_t>((k + 1) * rows / groups);
    std::fill(rest.weight.begin() + first, rest.weight.begin() + end, 0.0);
    const double moved = to_maximum(rest, frequency);
    sum += moved, square += moved * moved;
    std::copy(pixels.weight.begin() + first, pixels.weight.begin() + end, rest.weight.begin() + first);
  }
  const auto count = static_cast<double>(groups);
  return std::sqrt(std::max(square - sum * sum / count, 0.0) * (count - 1) / count);
}

double squared(double x) { return x * x; }

}  // namespace

OwnPixels own_pixels(const Patch& patch, const SwingMap& swing, const PatchRange& box, double least) {
  Complex sum = 0;
  for (std::size_t n = box.first_row; n < box.end_row; ++n)
    for (std::size_t g = box.first_group; g < box.end_group; ++g) sum += swing[n * patch.stride + g];
  const Complex phase = sum == Complex(0) ? Complex(1) : sum / std::abs(sum);
  const std::size_t rows = box.end_row - box.first_row, groups = box.end_group - box.first_group;
  OwnPixels out{std::vector<double>(rows * groups), std::vector<std::uint8_t>(rows * groups), std::vector<double>(rows),
                std::vector<double>(rows)};
  std::vector<double> means(groups), counts(groups);
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t g = 0; g < groups; ++g) {
      const std::size_t from = (box.first_row + n) * patch.stride + box.first_group + g, to = n * groups + g;
      out.light[to] = patch.logs[from];
      out.own[to] = swing.real[from] * phase.real() + swing.imaginary[from] * phase.imag() > least;
      if (out.own[to]) means[g] += out.light[to], counts[g] += 1;
    }
  for (std::size_t n = 0; n < rows; ++n) {
    for (std::size_t g = 0; g < groups; ++g) {
      const std::size_t i = n * groups + g;
      if (counts[g] > 0) out.light[i] -= means[g] / counts[g];
      if (out.own[i]) out.profile[n] += out.light[i], out.weight[n] += 1;
    }
    if (out.weight[n] > 0) out.profile[n] /= out.weight[n];
  }
  return out;
}

double strongest_frequency(const OwnPixels& pixels, double lower, double upper) {
  double step = 0.125 / static_cast<double>(pixels.profile.size()), best = lower, most = -1;
  const auto count = static_cast<std::size_t>((upper - lower) / step) + 1;
  const auto look_at = [&](double frequency) {
    const double energy = tone_energy(pixels, frequency);
    if (energy > most) most = energy, best = frequency;
  };
  for (std::size_t i = 0; i <= count; ++i) look_at(std::min(lower + static_cast<double>(i) * step, upper));
  if (best <= lower || best >= upper) return best;
  for (; step > frequency_step; step *= 0.5) {
    const double middle = best;
    look_at(middle - 0.5 * step);
    look_at(middle + 0.5 * step);
  }
  return best;
}

RefinedLight light_of(const OwnPixels& pixels, double frequency, double noise) {
  const ToneFit fit(pixels, frequency);
  const std::vector<double>&slow = fit.slow(), all = fit.fitted();
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
  light.phase = phase_at_start(tone, frequency, 0);
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
