#include "ocisac/tones/find_frequency.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <iterator>
#include <numbers>
#include <numeric>
#include <utility>

#include "core/levels.hpp"
#include "core/spectrum.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_blocks.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "ocisac/rows/basis.hpp"
#include "ocisac/tones/periodic_fit.hpp"
#include "rows/fit.hpp"
#include "rows/verdict.hpp"
#include "tones/clipping.hpp"
#include "tones/frequency_search.hpp"
#include "tones/spectral_votes.hpp"
#include "tones/surroundings.hpp"
#include "tones/texture.hpp"
#include "tones/tone_combination.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr std::size_t kFewestRows = 8;
constexpr std::size_t kMaxHarmonics = 31;
constexpr int kSteps = 2;  // from a quarter of a bin to a thousandth

// Signals scaled to unit energy, so that bright overlays do not dominate; constant ones are left out.
PeriodicSignals unit_signals(const PeriodicSignals& signals) {
  std::vector<double> out;
  out.reserve(signals.samples().size());
  for (std::size_t s = 0; s < signals.count(); ++s) {
    if (!(signals.energies()[s] > 0)) continue;
    const double scale = 1 / std::sqrt(signals.energies()[s]);
    std::ranges::transform(signals.signal(s), std::back_inserter(out), [=](double v) { return scale * v; });
  }
  return {std::move(out), signals.rows()};
}

// The strongest local maxima of the votes, in cycles per row.
std::vector<double> spectral_peaks(const PeriodicSignals& signals, const FrequencySearch& range,
                                   std::size_t max_count) {
  const std::size_t length = optimal_dft_length(2 * signals.rows());
  const auto votes = spectral_votes(signals.samples(), signals.rows(), length);
  const auto inside = [&](std::size_t k) {
    const double f = static_cast<double>(k) / static_cast<double>(length);
    return f >= range.lower && f <= range.upper;
  };
  const auto vote = [&](std::size_t k) { return k < votes.size() && inside(k) ? votes[k] : 0; };
  std::vector<std::size_t> peaks;
  for (std::size_t k = 1; k < votes.size(); ++k)
    if (inside(k) && vote(k) > vote(k - 1) && vote(k) >= vote(k + 1)) peaks.push_back(k);
  std::stable_sort(peaks.begin(), peaks.end(), [&](std::size_t a, std::size_t b) { return votes[a] > votes[b]; });
  peaks.resize(std::min(peaks.size(), max_count));
  std::vector<double> frequencies;
  for (const std::size_t k : peaks) frequencies.push_back(static_cast<double>(k) / static_cast<double>(length));
  return frequencies;
}

// Of signals of unit energy, each with its own noise level; smaller is better.
double misfit(std::span<const double> residuals, const PeriodicModel& model, std::size_t rows) {
  double sum = 0;
  for (const double residual : residuals) sum += schwarz_criterion(residual + 1e-12, rows, model.parameters());
  return sum;
}

// A few cycles are below the resolution of a spectrum: minimises the misfit of a tone on a fine grid up to 4 cycles, or
// over the whole range if that is narrow.
std::vector<double> grid_minima(const PeriodicSignals& signals, const FrequencySearch& range) {
  const auto rows = static_cast<double>(signals.rows());
  const bool narrow = (range.upper - range.lower) * rows < 4;
  const double last = narrow ? range.upper : std::min(range.upper, 4 / rows);
  if (!(range.lower <= last)) return {};
  const auto steps = static_cast<std::size_t>(std::ceil((last - range.lower) * rows / 0.25));
  std::vector<double> grid, misfits, minima;
  for (std::size_t i = 0; i <= steps; ++i) {
    const double share = steps == 0 ? 0 : static_cast<double>(i) / static_cast<double>(steps);
    grid.push_back(range.lower + share * (last - range.lower));
    const auto model = periodic_model(grid.back(), signals.rows(), 1);
    misfits.push_back(misfit(fit_periodic(signals, model, grid.back(), false).residual_energy, model, signals.rows()));
  }
  for (std::size_t i = 0; i < grid.size(); ++i)
    if ((i == 0 || misfits[i] < misfits[i - 1]) && (i + 1 == grid.size() || misfits[i] <= misfits[i + 1]))
      minima.push_back(grid[i]);
  return minima;
}

struct Candidate {
  double frequency = kNaN;
  double misfit = kInfinity;
};

constexpr double kMinShare = 0.2;  // of the fundamental; an aliased third harmonic of a square wave has 0.1

// Lower bound of the misfit of a model whose fundamental explains at most `energy`, which is kMinShare of the
// harmonics' or more, given the fit of the fundamental alone. Harmonics leak into each other: by 0.21 of the amplitude,
// a cycle apart or more, hence energies by less than (0.2^½/(0.2^½ − 0.21))² < 4. What that leaves to explain is spent
// where logarithms fall most.
double least_misfit(const PeriodicFit& tone, double energy, const PeriodicModel& model, std::size_t rows) {
  double explained = 4 / kMinShare * energy;
  std::vector<double> residuals = tone.residual_energy;
  for (std::size_t s = 0; s < residuals.size(); ++s) residuals[s] += tone.periodic_energy[s];
  std::ranges::sort(residuals);
  for (double& residual : residuals) {
    const double taken = std::min(residual, explained);
    residual -= taken;
    explained -= taken;
  }
  return misfit(residuals, model, rows);
}

// Share of the fundamental in the energy of the harmonics.
double share_of_fundamental(const PeriodicFit& fit) {
  const auto& energies = fit.harmonic_energy;
  return energies[0] / std::accumulate(energies.begin(), energies.end(), 0.0);
}

// True if a fundamental up to `reach` cycles in the frame beside this one may, with harmonics, have less than the
// misfit `best`.
bool may_win(const PeriodicFit& tone, double reach, double best, std::size_t rows) {
  const double frequency = tone.frequency, farthest = reach / static_cast<double>(rows);
  const auto lowest = periodic_model(frequency - farthest, rows, kComparedHarmonics),
             highest = periodic_model(frequency + farthest, rows, kComparedHarmonics);  // has fewest harmonics
  const std::size_t trend = tone.model.trend_degree;
  if ((frequency - farthest) * static_cast<double>(rows) < 1 || lowest.trend_degree != trend ||
      highest.trend_degree != trend)
    return true;
  const double kept = std::pow(sinc(reach), 2);  // what a fit explains of the energy of a tone that far off
  return least_misfit(tone, tone.total_periodic() / kept, highest, rows) < best;
}

// Refines the fundamental alone, then with its first harmonics, as long as it may have less than the misfit `best`. A
// sub-multiple of the true frequency has almost no fundamental and is rejected.
Candidate judged(const PeriodicSignals& signals, double frequency, const FrequencySearch& range, double best) {
  const std::size_t rows = signals.rows();
  constexpr double kReach = 0.5;  // cycles in the frame, of two steps
  PeriodicFit tone =
      fit_periodic(signals, periodic_model(frequency, rows, 1), std::clamp(frequency, range.lower, range.upper));
  if (!may_win(tone, kReach, best, rows)) return {};
  tone = refine_periodic(signals, std::move(tone), range.lower, range.upper, kSteps);
  if (!may_win(tone, 0, best, rows)) return {};
  const auto model = periodic_model(tone.frequency, rows, kComparedHarmonics);
  const auto fit =
      refine_periodic(signals, fit_periodic(signals, model, tone.frequency), range.lower, range.upper, kSteps);
  if (share_of_fundamental(fit) < kMinShare) return {};
  return {fit.frequency, misfit(fit.residual_energy, model, rows)};
}

}  // namespace

double coarse_frequency(const PeriodicSignals& signals, const FrequencySearch& range) {
  if (signals.count() == 0) return kNaN;
  std::vector<double> frequencies = spectral_peaks(signals, range, 5);
  for (const double f : grid_minima(signals, range))
    if (std::ranges::find(frequencies, f) == frequencies.end()) frequencies.push_back(f);
  Candidate best;
  for (const double frequency : frequencies) {
    const Candidate candidate = judged(signals, frequency, range, best.misfit);
    if (candidate.misfit < best.misfit) best = candidate;
  }
  return best.frequency;
}

double fold_error(const PeriodicFit& fit, double rows, int power) {
  const auto& orders = fit.model.harmonics;
  const auto slope = [&](std::size_t i) { return static_cast<double>(orders[i]) * std::sqrt(fit.harmonic_energy[i]); };
  double level = 0, information = 0, squares = 0;
  for (std::size_t i = 0; i < orders.size(); ++i) {
    information += slope(i) * slope(i);
    if (static_cast<double>(orders[i] + 1) * fit.frequency > 0.25)
      level = std::max(level, std::pow(orders[i], power - 1) * slope(i));
  }
  for (double order = std::ceil(0.5 / fit.frequency); order * fit.frequency < 3; ++order)
    for (std::size_t i = 0; i < orders.size(); ++i) {
      const double cycles = order * fit.frequency, own = static_cast<double>(orders[i]) * fit.frequency;
      if (std::abs(std::abs(cycles - std::nearbyint(cycles)) - own) * rows < 1.5)
        squares += std::pow(slope(i) * level / std::pow(order, power), 2);
    }
  return std::sqrt(squares / 8) / information / rows;
}

namespace {

// Noise of a sample. The second term is the rounding error; it prevents that noiseless signals seem to consist of
// harmonics.
double noise_power(const PeriodicFit& fit, const PeriodicSignals& signals) {
  const auto spare = static_cast<double>((signals.rows() - fit.model.parameters()) * signals.count());
  return std::max(fit.total_residual(), 1e-14 * fit.total_periodic()) / spare;
}

// A tone and harmonics, and the texture that is seen in what they leave.
struct BesideTexture {
  PeriodicFit fit;
  Texture texture;
};

BesideTexture beside_texture(const PeriodicSignals& signals, double frequency, std::size_t harmonics) {
  const std::size_t rows = signals.rows();
  PeriodicFit fit = fit_periodic(signals, periodic_model(frequency, rows, harmonics), frequency, false);
  const Texture texture = texture_about(frequency, residual_of(signals, fit), rows);
  return {std::move(fit), texture};
}

// True if noise and something of this power hardly explain the fundamental.
bool stands_out(const PeriodicSignals& signals, const PeriodicFit& fit, double power) {
  return fit.harmonic_energy[0] > chance_energy(2 * signals.count()) * (noise_power(fit, signals) + power);
}

// Compares the fundamental of this frequency with noise and texture of its expected power.
bool stands_out(const PeriodicSignals& signals, double frequency) {
  const auto [fit, texture] = beside_texture(signals, frequency, kComparedHarmonics);
  return stands_out(signals, fit, texture.power());
}

// True if noise, and texture of a power that is not known better than the spectrum tells it, hardly explains these
// harmonics: all, and the fundamental alone, which half the frequency of a light has of texture.
bool is_no_texture(const PeriodicSignals& signals, double frequency, const PeriodicModel& model) {
  constexpr double kChance = 1e-4;  // of some ten frequencies at which texture is strong
  const auto found =
      beside_texture(signals, frequency, std::max(kComparedHarmonics, orders_about(frequency, signals.rows())));
  std::vector<double> powers;
  std::vector<std::size_t> orders;
  for (std::size_t i = 0; i < found.fit.model.harmonics.size(); ++i) {
    const std::size_t order = found.fit.model.harmonics[i];
    if (std::ranges::find(model.harmonics, order) == model.harmonics.end()) continue;
    orders.push_back(order);
    powers.push_back(found.fit.harmonic_energy[i] / static_cast<double>(2 * signals.count()));
  }
  const auto chance_of = [&](std::size_t count) {
    return found.texture.chance(std::span(powers).first(count), std::span(orders).first(count));
  };
  return stands_out(signals, found.fit, 0) && chance_of(1) < kNextToNone && chance_of(powers.size()) < kChance;
}

// The fundamental of which `frequency` is a harmonic, or itself. Each of many parts pays for the harmonics of its
// model, which a faint light does not repay; combined, it does. Texture is no fundamental of a light.
double fundamental_of(const PeriodicSignals& combined, double frequency, const FrequencySearch& range) {
  const PeriodicSignals signals = unit_signals(combined);
  if (signals.count() == 0) return frequency;
  Candidate best;
  for (const double factor : {1.0, 1.0 / 2, 1.0 / 3, 2.0, 3.0}) {
    const double start = factor * frequency;
    if (start < range.lower || start > range.upper) continue;
    const Candidate candidate = judged(signals, start, range, best.misfit);
    if (candidate.misfit < best.misfit && stands_out(signals, candidate.frequency)) best = candidate;
  }
  return std::isnan(best.frequency) ? frequency : best.frequency;
}

// True if half or a third of the frequency is there, too, too weak for a fundamental (kMinShare).
bool has_weak_fundamental(const PeriodicSignals& signals, double frequency, const FrequencySearch& range) {
  constexpr double kLeastShare = 0.05;
  for (const double order : {2.0, 3.0}) {
    if (frequency / order < range.lower) continue;
    const auto model = periodic_model(frequency / order, signals.rows(), kComparedHarmonics);
    const PeriodicFit fit = fit_periodic(signals, model, frequency / order);
    if (share_of_fundamental(fit) >= kLeastShare && stands_out(signals, frequency / order)) return true;
  }
  return false;
}

// True where the strongest harmonic may be a fundamental, of which the second or third harmonic, folded at half the row
// rate, is taken for this one: both explain the rows.
bool may_be_folded(const PeriodicFit& fit, std::size_t rows) {
  const auto cycle = static_cast<std::size_t>(std::lround(1 / fit.frequency));  // rows
  if (!(std::abs(static_cast<double>(cycle) * fit.frequency - 1) * static_cast<double>(rows) < 1)) return false;
  const auto strongest =
      static_cast<std::size_t>(std::ranges::max_element(fit.harmonic_energy) - fit.harmonic_energy.begin());
  const std::size_t order = fit.model.harmonics[strongest];
  const auto meets = [&](std::size_t folded) { return (folded + 1) % cycle == 0 || (folded - 1) % cycle == 0; };
  return order > 1 && (meets(2 * order) || meets(3 * order));
}

// True if the rest holds a tone at least as strong, of which this one is the second or third harmonic, folded at half
// the row rate: no harmonic of pulses is stronger than their fundamental.
bool is_folded_harmonic(const PeriodicSignals& rest, const PeriodicFit& fit) {
  const double f = fit.frequency;
  return std::ranges::any_of(std::array{(1 - f) / 2, (1 - f) / 3, (1 + f) / 3}, [&](double fundamental) {
    const auto alone = fit_periodic(rest, periodic_model(fundamental, rest.rows(), 1), fundamental);
    return alone.harmonic_energy[0] >= fit.harmonic_energy[0];
  });
}

PeriodicFit refined(const PeriodicSignals& signals, const PeriodicModel& model, double frequency,
                    const FrequencySearch& range, int max_steps = 30) {
  const double start = std::clamp(frequency, range.lower, range.upper);
  return refine_periodic(signals, fit_periodic(signals, model, start), range.lower, range.upper, max_steps);
}

// The fundamental and the significant harmonics.
PeriodicModel pruned(const PeriodicFit& fit, const PeriodicSignals& signals) {
  PeriodicModel model{fit.model.trend_degree, {1}};
  for (std::size_t i = 1; i < fit.model.harmonics.size(); ++i)
    if (fit.harmonic_energy[i] > chance_energy(2 * signals.count()) * noise_power(fit, signals))
      model.harmonics.push_back(fit.model.harmonics[i]);
  return model;
}

// Adds harmonics step by step: each step refines the frequency enough for the next, whose minimum is narrower.
PeriodicFit final_fit(const PeriodicSignals& signals, double frequency, const FrequencySearch& range) {
  PeriodicFit final = refined(signals, periodic_model(frequency, signals.rows(), 1), frequency, range, kSteps);
  for (std::size_t count = 3; range.harmonics != Harmonics::fundamental && count <= kMaxHarmonics;
       count = 2 * count + 1) {
    const std::size_t before = final.model.harmonics.back();
    const auto model = periodic_model(final.frequency, signals.rows(), count);
    if (model.harmonics.size() == final.model.harmonics.size()) break;
    final = refined(signals, model, final.frequency, range, kSteps);
    if (range.harmonics == Harmonics::automatic && pruned(final, signals).harmonics.back() <= before) break;
  }
  return refined(signals, range.harmonics == Harmonics::automatic ? pruned(final, signals) : final.model,
                 final.frequency, range);
}

// Signals of the selected blocks, combined by their amplitudes.
CombinedTone combined_signals(const ColumnBlocks& blocks, const std::vector<std::uint8_t>& used,
                              const PeriodicFit& all) {
  const auto count = static_cast<Index>(blocks.frames * blocks.blocks);
  std::vector<Index> chosen;
  for (Index signal = 0; signal < count; ++signal)
    if (used[static_cast<std::size_t>(signal) % blocks.blocks]) chosen.push_back(signal);
  const Eigen::Map<const MatrixXd> signals(blocks.signals.data(), static_cast<Index>(blocks.rows), count);
  const MatrixXd samples = signals(Eigen::all, chosen),
                 coefficients = Eigen::Map<const MatrixXd>(all.coefficients.data(), count,
                                                           std::ssize(all.coefficients) / count)(chosen, Eigen::all);
  PeriodicFit of_used;
  of_used.model = all.model;
  for (const Index signal : chosen)
    of_used.residual_energy.push_back(all.residual_energy[static_cast<std::size_t>(signal)]);
  of_used.coefficients = values_of(coefficients);
  return combine_by_tone({samples.data(), static_cast<std::size_t>(samples.size())}, blocks.rows,
                         chosen.size() / blocks.frames, of_used);
}

// Excludes 0 and half the row rate, where cosine or sine vanish or equal the mean.
FrequencySearch resolvable(FrequencySearch search, double rows) {
  search.upper = std::clamp(search.upper, 0.1 / rows, 0.5 - 0.05 / rows);
  const double lower = search.lower > 0 ? search.lower : std::min(1 / rows, search.upper / 4);
  search.lower = std::clamp(lower, 0.1 / rows, search.upper);
  return search;
}

FoundFrequency nothing_found(const ColumnBlocks& blocks) {
  return {kNaN, kNaN,          0,
          0,    flag::no_tone, {std::vector<std::uint8_t>(blocks.columns, 1), std::vector<double>(blocks.columns)}};
}

constexpr int kSome = 16;  // signals, and bins on either side, that tell the noise about a tone

// Bins about a frequency, in cycles per row, of which the nearest may show the tone itself or the trend.
std::vector<double> bins_about(double frequency, std::size_t row_count) {
  constexpr int kNearest = 2;
  const auto rows = static_cast<double>(row_count);
  std::vector<double> bins;
  for (int bin = -kSome; bin <= kSome; ++bin)
    if (const double cycles = frequency * rows + bin;
        std::abs(bin) >= kNearest && cycles >= kNearest && cycles <= 0.5 * rows)
      bins.push_back(cycles / rows);
  return bins;
}

// Power of the noise at these bins over its mean power: that of the residual of a tone with harmonics, each signal's in
// its own mean.
double noise_about(const PeriodicSignals& signals, double frequency, const std::vector<double>& bins) {
  const std::size_t each = (signals.count() + kSome - 1) / kSome;
  std::vector<double> some, waves;
  for (std::size_t s = 0; s < signals.count(); s += each)
    some.insert(some.end(), signals.signal(s).begin(), signals.signal(s).end());
  // Harmonics that leak into the bins.
  const double reach = 1 + 1.5 * (bins.back() - frequency) / frequency;
  const auto removed = static_cast<std::size_t>(std::clamp(reach, 1.0, static_cast<double>(kMaxHarmonics)));
  const PeriodicSignals shown(std::move(some), signals.rows());
  const std::vector<double> residual =
      residual_of(shown, fit_periodic(shown, periodic_model(frequency, signals.rows(), removed), frequency, false));
  const auto height = static_cast<Eigen::Index>(signals.rows());
  const RowSampling sampling = centred_rows(signals.rows());
  append_tones(waves, sampling, bins);
  const Eigen::Map<const Eigen::MatrixXd> left(residual.data(), height,
                                               static_cast<Eigen::Index>(residual.size()) / height);
  const Eigen::MatrixXd lines = transposed_product(matrix_of(waves, sampling), left);
  // The lower three quarters of exponential variates have 0.538 of their mean: another lamp's tone is no noise.
  std::vector<double> powers;
  for (Eigen::Index s = 0; s < left.cols(); ++s) {
    const double energy = left.col(s).squaredNorm();
    for (Eigen::Index k = 0; k < lines.rows() && energy > 0; k += 2)
      powers.push_back(lines.col(s).segment<2>(k).squaredNorm() / energy);
  }
  if (powers.empty()) return 1;
  std::ranges::sort(powers);
  powers.resize((3 * powers.size() + 3) / 4);
  return mean_of(powers) / (1 - std::log(4.0) / 3);
}

// Significance test: with an individual noise level per signal, (rows − p)·log(1 + periodic/residual) of a model of
// given frequency is a sum of squared standard normal variables, two for each harmonic, times the power of the noise
// about it, which is not white of texture, of blocks of compression and of rows. `count`: of all signals, constant ones
// included.
bool is_significant(const PeriodicSignals& signals, const PeriodicFit& fit, std::size_t count) {
  const auto spare = static_cast<double>(signals.rows() - fit.model.parameters());
  double evidence = 0;
  for (std::size_t s = 0; s < fit.periodic_energy.size(); ++s)
    if (fit.periodic_energy[s] > 0) evidence += spare * std::log1p(fit.periodic_energy[s] / fit.residual_energy[s]);
  const double chance = chance_energy(2 * count * fit.model.harmonics.size());
  if (!(evidence > chance)) return false;
  const std::vector<double> bins = bins_about(fit.frequency, signals.rows());
  if (bins.empty()) return true;
  // About the tail of F, since the noise is estimated itself: exact for two variables of one signal.
  const double freedom = static_cast<double>(2 * bins.size() * std::min<std::size_t>(signals.count(), kSome)),
               own = chance_energy(2 * std::max(count, fit.model.harmonics.size())),
               least = chance * freedom * std::expm1(own / freedom) / own;
  const double most =
      0.5 * static_cast<double>(signals.rows()) / static_cast<double>(bins.size());  // all noise is there
  return evidence > most * least || evidence > least * std::max(noise_about(signals, fit.frequency, bins), 1.0);
}

bool shows_tone(const PeriodicSignals& signals, std::size_t count, double frequency) {
  return is_significant(signals, fit_periodic(signals, periodic_model(frequency, signals.rows(), 1), frequency, false),
                        count);
}

// Sum of the used signals of each frame.
std::vector<double> summed(const ColumnBlocks& blocks, const std::vector<std::uint8_t>& used) {
  std::vector<double> sums(blocks.frames * blocks.rows);
  const auto rows = static_cast<Index>(blocks.rows), each = static_cast<Index>(blocks.blocks);
  const Eigen::VectorXd weights =
      Eigen::Map<const Eigen::Array<std::uint8_t, Eigen::Dynamic, 1>>(used.data(), each).cast<double>();
  for (std::size_t frame = 0; frame < blocks.frames; ++frame)
    Eigen::Map<Eigen::VectorXd>(&sums[frame * blocks.rows], rows) =
        Eigen::Map<const MatrixXd>(&blocks.signals[frame * blocks.blocks * blocks.rows], rows, each) * weights;
  return sums;
}

// The same beside what stands still, the mean of the frames.
PeriodicSignals moving_light(const ColumnBlocks& blocks, const std::vector<std::uint8_t>& used) {
  std::vector<double> sums = summed(blocks, used);
  Eigen::Map<MatrixXd> frames(sums.data(), static_cast<Index>(blocks.rows), static_cast<Index>(blocks.frames));
  frames.colwise() -= frames.rowwise().mean().eval();
  return {std::move(sums), blocks.rows};
}

// The largest bend of the tone's phase in the signals, by what the model leaves. Rows after lost or repeated ones have
// another phase. Signals count by their share of the tone: one that combines what differs between columns holds
// texture, and hardly any of it.
Bend largest_bend(const std::vector<double>& residual, std::size_t rows, const PeriodicFit& final) {
  const std::size_t count = residual.size() / rows;
  Bend largest;
  double strongest = 0;
  for (std::size_t s = 0; s < count; ++s)
    strongest = std::max(strongest, std::hypot(final.amplitudes()[s], final.amplitudes()[count + s]));
  for (std::size_t s = 0; s < count && strongest > 0; ++s) {
    const std::complex<double> level{final.amplitudes()[s], -final.amplitudes()[count + s]};
    const Bend bend = bend_of_phase({&residual[s * rows], rows}, final.frequency, level);
    const double share = std::abs(level) / strongest;
    largest = {std::max(largest.phase, share * bend.phase), std::max(largest.frequency, share * bend.frequency)};
  }
  return largest;
}

// Searches the parts of the frame, each with its own noise, phase and overlays. Without a significant tone, searches
// their sum, which is better for a weak light over the whole frame. `in_parts`, `in_sum`: significance of the tone.
double coarse_frequency(const ColumnBlocks& blocks, const PeriodicSignals& parts, const FrequencySearch& range,
                        bool& in_parts, bool& in_sum) {
  const double frequency = coarse_frequency(parts, range);
  in_parts = std::isnan(frequency) || shows_tone(parts, blocks.frames * blocks.blocks, frequency);
  if (!in_parts && blocks.blocks > 1) {
    const PeriodicSignals sums =
        unit_signals({summed(blocks, std::vector<std::uint8_t>(blocks.blocks, 1)), blocks.rows});
    const double other = coarse_frequency(sums, range);
    if (!std::isnan(other) && shows_tone(sums, blocks.frames, other)) {
      in_sum = true;
      return other;
    }
  }
  return frequency;
}

Flags flags_of(double cycles, double cycles_std, bool columns_saturated) {
  Flags flags = 0;
  if (!(cycles_std < 0.25)) flags |= flag::no_tone;  // over the frame: neighbouring peaks are not distinguished
  if (cycles < 2) flags |= flag::few_cycles;
  if (columns_saturated) flags |= flag::saturated;
  return flags;
}

// The column of the first frame with the largest tone, its amplitude, and the step of the stored values. `all`: of the
// sums of the blocks.
struct StoredTone {
  std::vector<double> samples;
  double amplitude = 0, step = 0;
};

StoredTone strongest_column(const AnyFramesView& frames, const ColumnBlocks& blocks, const PeriodicFit& all) {
  const std::size_t count = blocks.frames * blocks.blocks;
  double largest = 0;
  std::size_t strongest = 0;
  for (std::size_t s = 0; s < count; ++s) {
    const double amplitude = std::hypot(all.amplitudes()[s], all.amplitudes()[count + s]);
    if (amplitude <= largest) continue;
    largest = amplitude;
    strongest = s % blocks.blocks;
  }
  return {column_signals(frames, 0, strongest * blocks.width, 1, {}), largest / static_cast<double>(blocks.width),
          step_of_samples(frames)};
}

// True for a tone that rounding of a gradient makes: smaller than half a step, beside noise of less than half a step,
// which would dither it.
bool is_rounding(const StoredTone& tone) {
  const double light = *std::ranges::max_element(tone.samples, {}, [](double v) { return std::abs(v); });
  if (!(tone.amplitude > kEqual * std::abs(light))) return true;
  return tone.amplitude < 0.5 * tone.step && noise_of_differences(tone.samples) < tone.step * tone.step / 4;
}

// Rows after which the phase comes again within half a cycle by the end of the frame.
std::size_t rows_until_repeated(double frequency, std::size_t rows) {
  std::size_t period = 1;
  while (period < rows &&
         std::abs(std::remainder(frequency * static_cast<double>(period), 1.0)) * static_cast<double>(rows) >= 0.5)
    ++period;
  return period;
}

// Standard error of the frequency by rounding, of variance 1/12 in steps, times exp(−2π²σ²) beside noise of σ steps:
// the Cramér–Rao bound of as many rows as see different phases. Others see the same error, which is like the tone and
// leaves nothing in the residual.
double rounding_of_frequency(const StoredTone& tone, const PeriodicFit& final) {
  const std::size_t rows = tone.samples.size();
  const PeriodicSignals stored(tone.samples, rows);
  const std::vector<double> left = residual_of(stored, fit_periodic(stored, final.model, final.frequency, false));
  const double steps = tone.amplitude / tone.step, square = tone.step * tone.step,
               noise = std::inner_product(left.begin(), left.end(), left.begin(), 0.0) /
                       (square * static_cast<double>(rows)),
               different = static_cast<double>(rows_until_repeated(final.frequency, rows));
  return std::exp(-kTwoPi * std::numbers::pi * std::max(noise - 1.0 / 12, 0.0)) /
         (std::numbers::sqrt2 * std::numbers::pi * steps * static_cast<double>(rows) * std::sqrt(different));
}

void check(const FrequencySearch& search) {
  require(std::isfinite(search.lower) && search.lower >= 0, "bounds", search.lower, "a lower bound of 0 or above");
  require(search.upper > search.lower, "bounds", search.upper, "an upper bound above the lower one");
  require(search.lower < 0.5, "bounds", search.lower, "a lower bound below half the row rate (in cycles per row: 0.5)");
}

}  // namespace

FoundFrequency find_frequency(const AnyFramesView& frames, const FrequencySearch& search) {
  check(search);
  const ColumnBlocks blocks = column_blocks(frames, search.saturation);
  if (blocks.rows < kFewestRows) return nothing_found(blocks);
  const auto rows = static_cast<double>(blocks.rows);
  const FrequencySearch range = resolvable(search, rows);
  bool in_parts = false, in_sum = false;
  const PeriodicSignals stored(blocks.signals, blocks.rows), parts = unit_signals(stored);
  const double sighted = coarse_frequency(blocks, parts, range, in_parts, in_sum);
  if (std::isnan(sighted)) return nothing_found(blocks);

  PeriodicFit all;
  std::vector<std::uint8_t> used;
  double coherence = 1;
  const auto combined = [&](double frequency) {
    all = fit_periodic(stored, periodic_model(frequency, blocks.rows, kComparedHarmonics), frequency, false);
    used = search.select_columns && in_parts ? tone_blocks(blocks, all) : std::vector<std::uint8_t>(blocks.blocks, 1);
    CombinedTone tone = combined_signals(blocks, used, all);
    coherence = tone.coherence;
    return PeriodicSignals(std::move(tone.signals), blocks.rows);
  };
  PeriodicSignals signals = combined(sighted);
  const double coarse = fundamental_of(signals, sighted, range);
  if (std::abs(coarse - sighted) * rows > 1) signals = combined(coarse);
  const PeriodicFit final = final_fit(signals, coarse, range);
  const std::vector<double> residual = residual_of(signals, final);
  const double own_std = frequency_std(signals, signals.count() / blocks.frames, final, residual);
  ToneColumns columns = spread_over_columns(blocks, used, all);
  Flags flags = flags_of(final.frequency * rows, own_std * rows, columns.saturated);
  if (final.frequency <= range.lower || final.frequency >= range.upper) flags |= flag::at_bound;
  const StoredTone stored_tone = strongest_column(frames, blocks, all);
  if (!columns.saturated && is_rounding(stored_tone)) flags |= flag::quantised;
  if ((!in_parts && !in_sum) || !is_significant(signals, final, signals.count())) flags |= flag::no_tone;
  constexpr double kJump = 0.08;  // rad; a jump by φ leaves φ/5 beside frequency and phase, a real lens up to 0.054
  // RMS phase along the rows of one frame by the error of its frequency.
  const double turning = kTwoPi * rows / std::sqrt(12.0);
  const Bend bend = largest_bend(residual, signals.rows(), final);
  const double turned = own_std * turning * std::sqrt(static_cast<double>(blocks.frames));
  // Rows of two exposures in turns, one by one or by pairs.
  const bool is_of_pairs = std::abs(final.frequency - 0.25) < kSure * own_std || final.frequency > 0.5 - kMostly / rows;
  const bool is_folded = is_folded_harmonic({residual, signals.rows()}, final);
  const bool misfit = is_folded || is_of_pairs || has_weak_fundamental(signals, final.frequency, range) ||
                      may_be_folded(final, signals.rows()) || bend.phase > std::max(kJump, kSure * turned) ||
                      coherence < kMostly;
  const bool may_be_texture =
      !misfit && !is_no_texture(blocks.frames > 1 ? moving_light(blocks, used) : signals, final.frequency, final.model);
  if (misfit || may_be_texture) flags |= flag::model_misfit;
  const double rounded = stored_tone.step > 0 ? rounding_of_frequency(stored_tone, final) : 0,
               folded = range.harmonics == Harmonics::fundamental ? 0 : fold_error(final, rows, 2),
               std = std::hypot(std::hypot(own_std, bend.frequency), rounded, folded);
  const double noise = noise_power(final, signals) * rows * static_cast<double>(signals.count());
  return {final.frequency,
          std,
          final.total_periodic() / noise,
          final.model.harmonics.back(),
          flags,
          std::move(columns),
          may_be_texture,
          is_folded};
}

}  // namespace ocisac
