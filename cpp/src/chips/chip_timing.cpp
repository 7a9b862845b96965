#include "chips/chip_timing.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

#include "chips/channel_equations.hpp"
#include "columns/moving_mean.hpp"
#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "core/spectrum.hpp"
#include "core/statistics.hpp"
#include "ocisac/chips/preamble.hpp"
#include "ocisac/core/constants.hpp"
#include "rows/fit.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

// Fractions of an edge's height, in the order of how often they are right: 0.5 is for linear light.
constexpr std::array kThresholds{0.5, 0.35, 0.2, 0.65};
constexpr std::size_t kAround = 12;  // turning points to either side with a common threshold, tried beside these
constexpr std::array<std::size_t, 3> kSmoothing{0, 2, 8};  // reach of the moving mean, rows
constexpr std::size_t kMinEdges = 4;
constexpr std::size_t kCandidates = 16;
constexpr double kMaxDuty = 0.2;       // chips, in the search; the bound after the fit is slightly larger
constexpr double kMaxResidual = 0.17;  // chips; edges at random places have 1/√12 = 0.29

// Coherence of the edges with a lattice of one frequency.
struct Coherence {
  double score = 0;  // fraction of the edges, 0 … 1
  double duty = 0;   // delay of the falling edges, cycles
  double phase = 0;  // cycles
};

// Sums of the rising and of the falling edges at places x, Σ exp(−j2πfx), at f = lowest + step·k, k = 0 … count − 1:
// a nonuniform FFT (Greengard, Lee 2004), twice oversampled. `step` is at most half a cycle in the span of the edges.
std::array<std::vector<std::complex<double>>, 2> edge_spectra(const Edges& edges, double lowest, double step,
                                                              std::size_t count) {
  constexpr int kReach = 8;  // samples of the Gaussian on either side: errors of 1e-8 of the number of edges
  constexpr double kDecay = 0.75 * std::numbers::pi / kReach;
  const std::size_t length = optimal_dft_length(2 * count + 2 * kReach);
  const auto cycles = static_cast<double>(length);
  const std::size_t centre = count / 2;
  const double middle = lowest + step * static_cast<double>(centre);
  std::vector<double> parts(4 * length);  // of rising edges: real, imaginary; of falling ones
  for (std::size_t edge = 0; edge < edges.rows.size(); ++edge) {
    const double turns = middle * edges.rows[edge];
    const auto weight = std::polar(1.0, -kTwoPi * (turns - std::floor(turns)));
    const double place = edges.rows[edge] * step * cycles, nearest = std::nearbyint(place);
    double* const real = &parts[edges.rising[edge] ? 0 : 2 * length];
    for (int i = -kReach; i <= kReach; ++i) {
      const double spread = std::exp(-kDecay * std::pow(nearest + i - place, 2));
      const auto at = static_cast<std::size_t>(nearest + i + cycles) % length;
      real[at] += spread * weight.real();
      real[length + at] += spread * weight.imag();
    }
  }
  const auto spectra = half_spectra(parts, length);
  const std::size_t bins = length / 2 + 1;
  std::array<std::vector<std::complex<double>>, 2> sums;
  for (std::size_t k = 0; k < count; ++k) {
    const bool above = k >= centre;
    const std::size_t bin = above ? k - centre : centre - k;
    const double wave = std::numbers::pi * static_cast<double>(bin) / cycles;
    const double scale = std::sqrt(kDecay / std::numbers::pi) * std::exp(wave * wave / kDecay);
    for (std::size_t falls = 0; falls < 2; ++falls) {
      auto real = spectra[2 * falls * bins + bin], imaginary = spectra[(2 * falls + 1) * bins + bin];
      if (!above) real = std::conj(real), imaginary = std::conj(imaginary);
      sums[falls].push_back(scale * (real + std::complex(-imaginary.imag(), imaginary.real())));
    }
  }
  return sums;
}

std::vector<Coherence> coherence(const Edges& edges, double lowest, double step, std::size_t count) {
  const auto [up, down] = edge_spectra(edges, lowest, step, count);
  std::vector<Coherence> result(count);
  for (std::size_t k = 0; k < count; ++k) {
    const double duty = std::clamp(std::arg(down[k] * std::conj(up[k])) / kTwoPi, -kMaxDuty, kMaxDuty);
    const auto total = up[k] + down[k] * std::polar(1.0, -kTwoPi * duty);
    result[k] = {std::abs(total) / static_cast<double>(edges.rows.size()), -duty, -std::arg(total) / kTwoPi};
  }
  return result;
}

// Peaks of the score of at least 60 % of the highest, in descending order.
std::vector<std::size_t> best_peaks(const std::vector<Coherence>& scores) {
  double highest = 0;
  for (const auto& at : scores) highest = std::max(highest, at.score);
  std::vector<std::size_t> peaks;
  for (std::size_t k = 0; k < scores.size(); ++k) {
    const double before = k > 0 ? scores[k - 1].score : -1, after = k + 1 < scores.size() ? scores[k + 1].score : -1;
    if (scores[k].score >= before && scores[k].score > after && scores[k].score >= 0.6 * highest) peaks.push_back(k);
  }
  std::ranges::stable_sort(peaks, [&](std::size_t a, std::size_t b) { return scores[a].score > scores[b].score; });
  peaks.resize(std::min(peaks.size(), kCandidates));
  return peaks;
}

double place_on(const ChipLattice& lattice, double chip, bool falling) {
  return lattice.clock.phase + lattice.clock.rows_per_chip * chip + (falling ? lattice.duty_offset : 0.0);
}

// Least squares over the edges with used[edge]; here `phase` is that of the rising edges.
std::optional<ChipLattice> solve(const Edges& edges, std::span<const double> chips,
                                 std::span<const std::uint8_t> used) {
  const double middle = chips[chips.size() / 2];  // for the conditioning
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  int count = 0, falls = 0;
  for (std::size_t k = 0; k < chips.size(); ++k) {
    if (!used[k]) continue;
    const Eigen::Vector3d row(1.0, chips[k] - middle, edges.rising[k] ? 0.0 : 1.0);
    normal += row * row.transpose();
    right += row * edges.rows[k];
    ++count;
    falls += !edges.rising[k];
  }
  const bool both = falls > 0 && falls < count;
  const Eigen::Index unknowns = both ? 3 : 2;
  if (count <= unknowns) return std::nullopt;
  const auto solved = solve_normal(normal.topLeftCorner(unknowns, unknowns), right.head(unknowns));
  if (!solved) return std::nullopt;
  const Eigen::VectorXd& values = solved->values;
  ChipLattice lattice{{values[1], values[0] - values[1] * middle}, 0, both ? values[2] : 0.0};
  if (lattice.clock.rows_per_chip <= 0) return std::nullopt;
  double squares = 0;
  for (std::size_t k = 0; k < chips.size(); ++k)
    if (used[k]) squares += std::pow(edges.rows[k] - place_on(lattice, chips[k], !edges.rising[k]), 2);
  // Rounding is no noise where the rate is nearly a whole number of rows: it repeats itself from edge to edge.
  const double chip = lattice.clock.rows_per_chip, span = std::abs(chips.back() - chips.front());
  const double turns = std::max(span * std::abs(chip - std::nearbyint(chip)), 1.0);
  const double rounded = edges.rounding() / (std::sqrt(3.0) * span * turns);
  lattice.rows_per_chip_std =
      std::hypot(std::sqrt(solved->inverse(1, 1) * squares / std::max(count - static_cast<int>(unknowns), 1)), rounded);
  return lattice;
}

// Edges within three robust standard deviations (median); excludes edges displaced by specks or wrong levels.
std::vector<std::uint8_t> inliers(const std::vector<double>& distance) {
  const double limit = 3 * (median(distance) / kMedianMagnitude + 0.02);
  std::vector<std::uint8_t> used(distance.size());
  std::ranges::transform(distance, used.begin(), [&](double d) { return static_cast<std::uint8_t>(d <= limit); });
  return used;
}

// Measures how far each edge lies from the place of its chip, rows.
std::vector<double> distances(const Edges& edges, std::span<const double> chips, const ChipLattice& lattice) {
  std::vector<double> distance(chips.size());
  for (std::size_t k = 0; k < chips.size(); ++k)
    distance[k] = std::abs(edges.rows[k] - place_on(lattice, chips[k], !edges.rising[k]));
  return distance;
}

// Moves the phase to the mean of the rising and the falling edges' lattices.
ChipLattice centred(ChipLattice lattice) {
  lattice.clock.phase += 0.5 * lattice.duty_offset;
  return lattice;
}

// Code length of `changes` in so many cells, nats.
double entropy_of(double changes, double cells) {
  const double share = changes / cells;
  return share > 0 && share < 1 ? -cells * (share * std::log(share) + (1 - share) * std::log(1 - share)) : 0.0;
}

// Code length of the edges in nats: their residual, and the occupied places of the lattice, dark and bright ones by
// themselves: pulses of one chip fall where they must. `runs`: sum of the chips and number of the runs of either light.
double description_length(const ChipLattice& lattice, std::span<const double> distance,
                          std::span<const std::uint8_t> used, const std::array<std::array<double, 2>, 2>& runs,
                          std::size_t collisions) {
  const auto edges = static_cast<double>(distance.size());
  double squares = 0, inside = 0;
  for (std::size_t k = 0; k < distance.size(); ++k)
    if (used[k]) squares += distance[k] * distance[k], inside += 1;
  const double chip = lattice.clock.rows_per_chip, duty = lattice.duty_offset / chip;
  return (inside - 3) * std::log(std::max(std::sqrt(squares / inside), 0.05)) +
         (edges - inside) * std::log(chip / std::sqrt(kTwoPi * std::numbers::e)) +  // anywhere in a chip, not normal
         entropy_of(runs[0][1], runs[0][0]) + entropy_of(runs[1][1], runs[1][0]) + 4 * static_cast<double>(collisions) +
         8 * edges * duty * duty          // prefers the threshold with equal runs of both levels
         - 0.3 * edges * std::log(chip);  // prefers the slower lattice
}

// Alternates rounding of edges to chips and fitting.
std::optional<ChipTiming> settle(const Edges& edges, ChipLattice lattice) {
  std::vector<double> chips(edges.rows.size()), distance(chips.size());
  std::vector<std::uint8_t> used(edges.rows.size(), 1);
  for (int round = 0; round < 4; ++round) {
    for (std::size_t k = 0; k < chips.size(); ++k)
      chips[k] = std::nearbyint((edges.rows[k] - place_on(lattice, 0, !edges.rising[k])) / lattice.clock.rows_per_chip);
    const auto solved = solve(edges, chips, used);
    if (!solved) return std::nullopt;
    lattice = *solved;
    distance = distances(edges, chips, lattice);
    used = inliers(distance);
  }
  std::size_t collisions = 0;
  std::array<std::array<double, 2>, 2> runs{};
  for (std::size_t k = 1; k < chips.size(); ++k) {
    collisions += chips[k] <= chips[k - 1];
    runs[edges.rising[k - 1]][0] += std::max(chips[k] - chips[k - 1], 1.0);
    runs[edges.rising[k - 1]][1] += 1;
  }
  if (10 * collisions > chips.size() || std::abs(lattice.duty_offset) > 1.5 * kMaxDuty * lattice.clock.rows_per_chip)
    return std::nullopt;
  const double squares = scalar_product(distance, distance);
  const double residual = std::sqrt(squares / static_cast<double>(distance.size()));
  return ChipTiming{centred(lattice),
                    residual,
                    0,
                    description_length(lattice, distance, used, runs, collisions),
                    std::numeric_limits<double>::infinity(),
                    {}};
}

// The cheapest of lattices; its lead is over those of other rates: by half a chip or more in the span of the edges.
std::optional<ChipTiming> cheapest_of(std::span<const ChipTiming> lattices, double span) {
  const auto best = std::ranges::min_element(lattices, {}, &ChipTiming::cost);
  if (best == lattices.end()) return std::nullopt;
  ChipTiming result = *best;
  result.lead = std::numeric_limits<double>::infinity();
  for (const ChipTiming& other : lattices) {
    const double apart = span / other.lattice.clock.rows_per_chip - span / result.lattice.clock.rows_per_chip;
    result.lead = std::min(result.lead, other.cost - result.cost + (std::abs(apart) < 0.5 ? other.lead : 0.0));
  }
  return result;
}

bool locked(const ChipTiming& timing) {
  return timing.residual <= kMaxResidual * timing.lattice.clock.rows_per_chip && timing.certainty > kMinCertainty;
}

// True if a lattice of a whole number of these chips fits the edges of another threshold. A wrong one delays falling
// edges, for some exposures by half a chip, and edges at random places of a fast lattice fit no slower one.
bool divides(const ChipTiming& timing, const ChipTiming& slower) {
  const double ratio = slower.lattice.clock.rows_per_chip / timing.lattice.clock.rows_per_chip;
  return locked(slower) && std::nearbyint(ratio) > 1 && std::abs(ratio - std::nearbyint(ratio)) < 0.01;
}

}  // namespace

std::optional<FittedLattice> fit_lattice(const Edges& edges, std::span<const double> chips) {
  if (chips.size() < kMinEdges) return std::nullopt;
  const auto of_all = solve(edges, chips, std::vector<std::uint8_t>(chips.size(), 1));
  if (!of_all) return std::nullopt;
  const auto of_most = solve(edges, chips, inliers(distances(edges, chips, *of_all)));
  return FittedLattice{centred(of_most.value_or(*of_all)), centred(*of_all)};
}

namespace {

// True if the mean place of edges within their `chips`, an angle, differs between quarters of the rows in which edges
// agree, or if those of a quarter do not agree on their chip: a resultant of 0.65 is a spread of 0.15 chips, 0.11 at
// most of lights that were read right (rescaled, sharpened, textured, compressed). The outermost edges may be the ends
// of the lamp, and few edges may have one of several places by chance.
bool quarters_differ(const Edges& edges, const ChipLattice& lattice, std::size_t chips) {
  constexpr std::size_t kQuarters = 4;
  constexpr double kWandering = 0.08, kAgreed = 0.8, kScattered = 0.65;  // chips; of means; resultants
  const double fewest = 2 * static_cast<double>(chips) + 1;              // edges
  struct Quarter {
    std::complex<double> sum;
    double count = 0;
  };
  std::array<Quarter, kQuarters> quarters;
  const double first = edges.rows.front(), span = edges.rows.back() - first;
  for (std::size_t k = 1; k + 1 < edges.rows.size(); ++k) {
    const double place = (edges.rows[k] - place_on(lattice, 0, !edges.rising[k])) / lattice.clock.rows_per_chip;
    Quarter& quarter = quarters[static_cast<std::size_t>((edges.rows[k] - first) / span * kQuarters)];
    quarter.sum += std::polar(1.0, kTwoPi * place / static_cast<double>(chips));
    quarter.count += 1;
  }
  const auto is_scattered = [&](const Quarter& of) {
    return chips == 1 && of.count >= fewest && std::abs(of.sum) < kScattered * of.count;
  };
  if (std::ranges::any_of(quarters, is_scattered)) return true;
  const auto agrees = [&](const Quarter& of) { return of.count >= fewest && std::abs(of.sum) > kAgreed * of.count; };
  Quarter together;
  for (const Quarter& of : quarters)
    if (agrees(of)) together = {together.sum + std::abs(of.sum), together.count + of.count};
  const double variance = -2 * std::log(together.sum.real() / together.count);
  for (const Quarter& a : quarters)
    for (const Quarter& b : quarters) {
      if (!agrees(a) || !agrees(b)) continue;
      const double apart = std::abs(std::arg(a.sum * std::conj(b.sum)));
      if (apart > kTwoPi * kWandering && apart > kSure * std::sqrt(variance * (1 / a.count + 1 / b.count))) return true;
    }
  return false;
}

}  // namespace

// A pause of a half or a third of a chip leaves a lattice of these, of which each part of the rows uses every second or
// third place.
bool wanders(const Edges& edges, const ChipLattice& lattice) {
  return quarters_differ(edges, lattice, 1) || quarters_differ(edges, lattice, 2) || quarters_differ(edges, lattice, 3);
}

std::optional<ChipTiming> find_lattice(const Edges& edges, std::size_t rows, FrequencyRange range) {
  if (edges.rows.size() < kMinEdges) return std::nullopt;
  const double width = range.highest - range.lowest;
  const auto steps = static_cast<std::size_t>(std::max(std::ceil(width * 2 * static_cast<double>(rows)), 8.0));
  const double step = width / static_cast<double>(steps);
  const auto scores = coherence(edges, range.lowest, step, steps + 1);
  std::vector<ChipTiming> settled;
  for (std::size_t peak : best_peaks(scores)) {
    check_interrupt();
    const double period = 1 / (range.lowest + step * static_cast<double>(peak));
    const auto timing = settle(edges, {{period, scores[peak].phase * period}, 0, scores[peak].duty * period});
    if (!timing || timing->lattice.clock.rows_per_chip * range.lowest > 1 / 0.99 ||
        timing->lattice.clock.rows_per_chip * range.highest < 1 / 1.01)
      continue;
    settled.push_back(*timing);
  }
  auto best = cheapest_of(settled, edges.rows.back() - edges.rows.front());
  if (!best) return best;
  const double by_chance = best->lattice.clock.rows_per_chip / (std::sqrt(12.0) * std::max(best->residual, 0.02));
  best->certainty =
      (static_cast<double>(edges.rows.size()) - 3) * std::log(by_chance) - std::log(static_cast<double>(steps + 1));
  return best;
}

namespace {

// Turning points of a moving mean of so many values. Without a known noise, by the span of the signal alone.
std::vector<std::size_t> points_of(std::span<const double> smooth, double averaged, double noise, double span) {
  const double hysteresis = std::fmin(6 * noise / std::sqrt(2 * averaged - 1), 0.08 * span);
  return prune_turning_points(smooth, turning_points(smooth, hysteresis));
}

double span_of(std::span<const double> signal) { return std::ranges::max(signal) - std::ranges::min(signal); }

// Sums of the edges of each part of the rows, falling ones moved onto rising ones, at the lowest frequency at which the
// parts agree within themselves, whatever the phase between them.
struct PartSums {
  double frequency = 0;
  std::vector<std::complex<double>> sums;
};

PartSums coherent_parts(const std::vector<Edges>& parts, double rows, FrequencyRange range) {
  const double width = range.highest - range.lowest;
  const auto steps = static_cast<std::size_t>(std::max(std::ceil(width * 4 * rows), 8.0));
  const double step = width / static_cast<double>(steps);
  std::vector<std::array<std::vector<std::complex<double>>, 2>> spectra;
  for (const Edges& part : parts) spectra.push_back(edge_spectra(part, range.lowest, step, steps + 1));
  std::vector<double> scores(steps + 1);
  std::vector<std::complex<double>> falls(steps + 1);
  for (std::size_t k = 0; k <= steps; ++k) {
    double squares = 0;
    for (const auto& [up, down] : spectra) {
      squares += std::norm(up[k]) + std::norm(down[k]);
      falls[k] += down[k] * std::conj(up[k]);
    }
    scores[k] = squares + 2 * std::abs(falls[k]);
  }
  const double least = kNearlyAll * std::ranges::max(scores);
  std::size_t at = 0;
  while (scores[at] < least) ++at;
  while (at < steps && scores[at + 1] > scores[at]) ++at;
  PartSums found{range.lowest + step * static_cast<double>(at), {}};
  const auto back = std::polar(1.0, -std::arg(falls[at]));
  for (const auto& [up, down] : spectra) found.sums.push_back(up[at] + down[at] * back);
  return found;
}

}  // namespace

RowWarp warp_of_edges(std::span<const double> signal, double noise, FrequencyRange range) {
  constexpr std::size_t kMostParts = 16;  // a displacement is smooth; tones of other lamps are not
  const auto points = points_of(signal, 1, noise, span_of(signal));
  const Edges edges = edges_between(signal, points, kThresholds[0]);
  const std::size_t count = std::min(edges.rows.size() / kMinEdges, kMostParts);
  if (count < 3) return {};  // a straight line fits any two
  const double rows = static_cast<double>(signal.size()) / static_cast<double>(count);
  std::vector<Edges> parts(count);
  for (std::size_t k = 0; k < edges.rows.size(); ++k) {
    Edges& part = parts[std::min(static_cast<std::size_t>(edges.rows[k] / rows), count - 1)];
    part.rows.push_back(edges.rows[k]);
    part.rising.push_back(edges.rising[k]);
  }
  const PartSums found = coherent_parts(parts, rows, range);
  // The phase of each part, less its mean and a straight line, which are those of the clock.
  const auto last = static_cast<Eigen::Index>(count) - 1;
  Eigen::MatrixXd line(count, 2);
  Eigen::VectorXd turns(count);
  for (Eigen::Index k = 0; k <= last; ++k) {
    const double turn = std::arg(found.sums[static_cast<std::size_t>(k)]) / kTwoPi,
                 before = k > 0 ? turns[k - 1] : turn;
    turns[k] = before + std::remainder(turn - before, 1.0);
    line.row(k) << 1, static_cast<double>(k);
  }
  turns -= line * solve_normal(line.transpose() * line, line.transpose() * turns)->values;
  RowWarp warp(signal.size());
  for (std::size_t m = 0; m < warp.size(); ++m) {
    const double place = std::clamp((static_cast<double>(m) + 0.5) / rows - 0.5, 0.0, static_cast<double>(last));
    const auto at = std::min(static_cast<Eigen::Index>(place), last - 1);
    warp[m] = std::lerp(turns[at], turns[at + 1], place - static_cast<double>(at)) / found.frequency;
  }
  return warp;
}

TimingSearch find_chip_timing(std::span<const double> signal, double noise, FrequencyRange range) {
  const double span = span_of(signal);
  TimingSearch search{std::nullopt, std::numeric_limits<std::size_t>::max()};
  for (std::size_t reach : kSmoothing) {
    const auto averaged = static_cast<double>(reach + 1);
    const double highest = reach == 0 ? range.highest : std::min(range.highest, 0.5 / averaged);
    if (range.lowest >= highest) break;
    const auto smooth = moving_mean(signal, reach);
    const auto points = points_of(smooth, averaged, noise, span);
    search.edges = std::min(search.edges, points.size() - 1);
    std::vector<ChipTiming> lattices;
    std::optional<ChipTiming> best;
    for (std::size_t k = 0; k <= kThresholds.size(); ++k) {
      const Edges edges = k < kThresholds.size() ? edges_between(smooth, points, kThresholds[k])
                                                 : edges_between(smooth, points, kThresholds[0], kAround);
      auto timing = find_lattice(edges, signal.size(), {range.lowest, highest});
      if (!timing || (best && timing->cost < best->cost && divides(*timing, *best))) continue;
      timing->edges = edges;
      lattices.push_back(*timing);
      best = cheapest_of(lattices, static_cast<double>(signal.size()));
    }
    if (best && locked(*best)) {
      search.timing = std::move(best);
      break;
    }
  }
  if (search.edges == std::numeric_limits<std::size_t>::max()) search.edges = 0;
  return search;
}

}  // namespace ocisac
