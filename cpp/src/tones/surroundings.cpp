#include "tones/surroundings.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <numbers>
#include <utility>

#include "core/levels.hpp"
#include "core/recently_used.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "ocisac/rows/tone_search.hpp"
#include "ocisac/tones/periodic_fit.hpp"
#include "rows/fit.hpp"
#include "rows/verdict.hpp"
#include "tones/folded_harmonics.hpp"
#include "tones/texture.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMaxTones = 3;
constexpr double kPeak = 20;  // of the residual's periodogram over its floor, for a significant tone

// All harmonics below half the row rate, at least a quarter of a bin apart; at most one for eight rows.
std::vector<double> all_harmonics(const std::vector<double>& lights, std::size_t row_count) {
  const auto rows = static_cast<double>(row_count);
  std::vector<double> all, kept;
  for (const double cycles : lights)
    for (int h = 1; h * cycles < 0.5 - 0.5 / rows; ++h) all.push_back(h * cycles);
  std::ranges::sort(all);
  for (const double cycles : all)
    if ((kept.empty() || cycles - kept.back() > 0.25 / rows) && kept.size() < row_count / 8) kept.push_back(cycles);
  return kept;
}

// Orthonormal basis of mean and harmonics. The last used ones are kept: their decomposition takes longer than all else.
std::shared_ptr<const MatrixXd> basis_of(const std::vector<double>& harmonics, std::size_t rows) {
  static RecentlyUsed<std::pair<std::size_t, std::vector<double>>, MatrixXd, 8> kept;
  return kept.get({rows, harmonics}, [&] {
    return std::make_shared<const MatrixXd>(orthogonal_factors(tone_design(centred_rows(rows), harmonics)).basis);
  });
}

// Tones that explain the residual or leave white noise; none if they do not.
std::vector<double> find_tones(const VectorXd& column, const MatrixXd& basis) {
  const auto count = static_cast<std::size_t>(column.size()), length = padded_length(count);
  FrequencyFit found{{}, {}, beside(basis, column)};
  const VectorXd first = found.rest;
  double floor = 0;
  while (true) {
    const std::span<const double> rest(found.rest.data(), count);
    const auto power = periodogram(rest, count, length);
    if (found.frequencies.empty()) floor = noise_floor(power);
    const auto slowest = power.begin() + static_cast<std::ptrdiff_t>(length / count);  // a cycle in the frame
    const auto peak = std::max_element(slowest, power.end());
    const double noise = floor * static_cast<double>(count);
    const bool explained = found.rest.squaredNorm() - noise < kSmallShare * (first.squaredNorm() - noise);
    if (explained || (*peak < kPeak * floor && is_white(rest))) return found.frequencies;
    if (*peak < kPeak * floor || found.frequencies.size() == kMaxTones) return {};
    found.frequencies.push_back(static_cast<double>(peak - power.begin()) / static_cast<double>(length));
    found = refine_frequencies(centred_rows(count), std::move(found.frequencies), basis, first);
  }
}

// True for the sidebands of a light that varies along the rows: f + d with d, or f + d with f − d; a gradient has them
// at f itself. Rows in a wrong order, or of other exposures, by two or four have them at a quarter of the row rate or a
// half beside f.
bool modulates(const std::vector<double>& tones, double cycles_per_row, double rows) {
  constexpr double kSame = 0.6, kSlow = 3;  // cycles in the frame
  for (std::size_t i = 0; i < tones.size(); ++i) {
    const double side = (tones[i] - cycles_per_row) * rows;
    for (const double image : {tones[i] - cycles_per_row, tones[i] + cycles_per_row})
      if (std::abs(side) > 1 && std::abs(std::remainder(image, 0.25)) * rows < kSame) return true;
    for (std::size_t j = 0; j < tones.size(); ++j)  // one tone, of half of f or slower than all of f, is no pair
      if (const double slow = tones[j] * rows;
          j != i && slow < kSlow && (std::abs(std::abs(side) - slow) < kSame || std::abs(side) < kSame))
        return true;
    for (std::size_t j = 0; j < i; ++j)
      if (std::abs(side + (tones[j] - cycles_per_row) * rows) < kSame) return true;
  }
  return false;
}

// True for deviations that noise does not make: `misfit` is chi-squared of that many degrees of freedom.
bool is_significant(double misfit, double freedom) { return misfit >= freedom + 6 * std::sqrt(2 * freedom) + 12; }

// `tones`: others, beside which harmonics are fitted.
double distortion_of(const VectorXd& column, const FittedLight& light, const std::vector<double>& harmonics,
                     const MatrixXd& steady, const std::vector<double>& tones) {
  std::vector<double> cycles;
  std::vector<int> orders;
  const auto rows = static_cast<double>(column.size());
  for (int h = 1; h * light.cycles_per_row < 0.5 * (1 - 1 / rows); ++h)
    if (std::ranges::any_of(harmonics, [&](double c) { return std::abs(c - h * light.cycles_per_row) < 1e-12; })) {
      cycles.push_back(h * light.cycles_per_row);
      orders.push_back(h);
    }
  if (orders.size() < 2) return 0;
  cycles.insert(cycles.end(), tones.begin(), tones.end());
  const VectorXd coefficients =
      coefficients_of(tone_design(centred_rows(static_cast<std::size_t>(column.size())), cycles), column);
  std::vector<std::complex<double>> levels;
  for (Index a = 1; levels.size() < orders.size(); a += 2) levels.emplace_back(coefficients(a), -coefficients(a + 1));
  const double freedom = std::max(rows - static_cast<double>(steady.cols()), 1.0);
  const VectorXd residual = beside(steady, column);
  return harmonic_distortion(light, static_cast<std::size_t>(column.size()), orders, levels,
                             2 / rows * residual.squaredNorm() / freedom);
}

}  // namespace

double harmonic_distortion(const FittedLight& light, std::size_t rows, std::span<const int> orders,
                           std::span<const std::complex<double>> levels, double variance) {
  const double size = orders.empty() ? 0 : std::abs(levels[0]);
  if (orders.size() < 2 || orders[0] != 1 || !(size > 0)) return 0;
  const double freedom = 2 * static_cast<double>(orders.size() - 1);
  double misfit = 0, energy = 0;
  if (light.duty == 0) {
    for (const auto& level : levels.subspan(1)) energy += std::norm(level);
    return is_significant(energy / variance, freedom) ? std::sqrt(energy) / size : 0;
  }
  if (!(light.exposure_cycles >= 0) || std::abs(sinc(light.exposure_cycles)) < kNearNull) return 0;
  const double start = std::arg(levels[0]) + (sinc(light.exposure_cycles) < 0 ? std::numbers::pi : 0);
  const auto folded = folded_harmonics(rows, light.cycles_per_row, light.duty, light.exposure_cycles);
  // visit(deviation from what is expected, its slope by the exposure, variances along and across) of each harmonic.
  const auto for_each_deviation = [&](auto visit) {
    for (std::size_t k = 1; k < orders.size(); ++k) {
      const auto ratio = [&](double factor) {
        return std::copysign(size, sinc(light.exposure_cycles)) *
               harmonic_ratio(orders[k], light.duty, factor * light.exposure_cycles);
      };
      const double expected = ratio(1), relative = expected / size;
      const auto turned = levels[k] * std::polar(1.0, -orders[k] * start);
      const auto order = static_cast<std::size_t>(orders[k]);
      const double total = variance + (order < folded.onto.size() ? size * size * folded.onto[order] : 0);
      visit(turned - expected, (ratio(1.001) - ratio(0.999)) / 0.002, total * (1 + relative * relative),
            total * (1 + std::pow(orders[k] * relative, 2)));
    }
  };
  double product = 0, square = 0;
  for_each_deviation([&](std::complex<double> deviation, double slope, double variance_along, double) {
    product += deviation.real() * slope / variance_along;
    square += slope * slope / variance_along;
  });
  const double longer = square > 0 ? std::clamp(product / square, -kSmallShare, kSmallShare) : 0;
  for_each_deviation([&](std::complex<double> deviation, double slope, double variance_along, double variance_across) {
    deviation -= longer * slope;
    misfit += std::pow(deviation.real(), 2) / variance_along + std::pow(deviation.imag(), 2) / variance_across;
    energy += std::norm(deviation);
  });
  return is_significant(misfit, freedom) ? std::sqrt(energy) / size : 0;
}

namespace {

using Level = std::complex<double>;

// Mean and tone in a part of the rows, and the variance of a part of the tone.
struct PartOfRows {
  double mean;
  Level tone;
  double variance;
};

// Chi-squared and RMS of what the tones of the parts deviate from one share of their means.
std::pair<double, double> deviation_from_share(const std::vector<PartOfRows>& parts) {
  Level share = 0;
  const auto variance = [&](const PartOfRows& part) { return part.variance * (1 + std::norm(share) / 2); };
  for (int step = 0; step < 3; ++step) {
    Level product = 0;
    double square = 0;
    for (const PartOfRows& part : parts) {
      product += part.mean * part.tone / variance(part);
      square += part.mean * part.mean / variance(part);
    }
    share = product / square;
  }
  double misfit = 0, energy = 0;
  for (const PartOfRows& part : parts) {
    const double deviation = std::norm(part.tone - share * part.mean);
    misfit += deviation / variance(part);
    energy += deviation;
  }
  return {misfit, std::sqrt(energy / static_cast<double>(parts.size()))};
}

}  // namespace

// The parts are shares along the rows, in pairs of rows and every other row; the deviation is over the tone.
double unevenness(std::span<const double> left, double cycles_per_row, double mean, Level level) {
  constexpr double kCyclesOfPart = 1.5, kMostParts = 8;
  const std::size_t rows = left.size();
  const auto along =
      static_cast<std::size_t>(std::clamp(cycles_per_row * static_cast<double>(rows) / kCyclesOfPart, 1.0, kMostParts));
  const RowSampling sampling = centred_rows(rows);
  std::vector<double> cosine(rows), sine(rows);
  fill_wave(sampling.times, cycles_per_row, cosine, sine);
  // Products of (1, cosine, sine, left) in cells of a part along the rows and a row of four: parts are sums of cells.
  std::vector<Eigen::Matrix4d> cells(4 * along, Eigen::Matrix4d::Zero());
  for (std::size_t n = 0; n < rows; ++n) {
    const Eigen::Vector4d terms{1, cosine[n], sine[n], left[n]};
    cells[4 * (n * along / rows) + n % 4].noalias() += terms * terms.transpose();
  }
  double worst = 0;
  const auto compare = [&](std::size_t count, auto part_of) {
    std::vector<Eigen::Matrix4d> products(count, Eigen::Matrix4d::Zero());
    for (std::size_t cell = 0; cell < cells.size(); ++cell) products[part_of(cell)] += cells[cell];
    std::vector<PartOfRows> parts;
    for (const Eigen::Matrix4d& product : products) {
      const double of_rows = product(0, 0);
      const auto found =
          solve_symmetric(product.topLeftCorner<3, 3>(), product.topRightCorner<3, 1>(), kNextToNone * of_rows);
      if (!found || !(of_rows > 3)) return;
      const Eigen::Vector3d levels = *found;
      const double squares = product(3, 3) - levels.dot(product.topRightCorner<3, 1>());
      parts.push_back(
          {mean + levels(0), level + Level(levels(1), -levels(2)), 2 * squares / ((of_rows - 3) * of_rows)});
      if (!(parts.back().variance > 0)) return;
    }
    const auto [misfit, deviation] = deviation_from_share(parts);
    if (is_significant(misfit, 2 * static_cast<double>(count - 1)))
      worst = std::max(worst, deviation / std::abs(level));
  };
  if (along > 1) compare(along, [](std::size_t cell) { return cell / 4; });
  compare(2, [](std::size_t cell) { return cell / 2 % 2; });
  compare(2, [](std::size_t cell) { return cell % 2; });
  return worst;
}

Bend bend_of_phase(std::span<const double> left, double cycles_per_row, Level level) {
  constexpr double kFewestCycles = 2;
  constexpr double kTaken = 2;  // RMS phase that a frequency takes up of a bend, over what it leaves
  const auto rows = static_cast<double>(left.size());
  if (cycles_per_row * rows < kFewestCycles) return {};
  // Higher ones of few cycles resemble slow light.
  const Index degree = std::clamp<Index>(static_cast<Index>(cycles_per_row * rows), 5, 7);
  const RowSampling sampling = centred_rows(left.size());
  const MatrixXd steady = tone_design(sampling, {{cycles_per_row}}, 2);
  const VectorXd turned = -level.real() * steady.col(4) - level.imag() * steady.col(3);
  std::vector<double> bent;
  append_course(bent, sampling, span_of(turned), static_cast<std::size_t>(degree));
  const auto by_degree = matrix_of(bent, sampling);
  MatrixXd known(steady.rows(), 6);
  known << steady, by_degree.col(1);
  const MatrixXd basis = orthogonal_factors(known).basis, bends = beside(basis, by_degree.rightCols(degree - 1)),
                 rest = beside(basis, vector_of(left));
  const VectorXd angles = least_squares(bends, rest), noise = rest - bends * angles;
  const double squares = noise.squaredNorm(),
               white = squares / (rows - static_cast<double>(known.cols() + bends.cols()));
  const std::span<const double> unexplained(noise.data(), left.size());
  if (!(rest.squaredNorm() - squares > chance_energy(static_cast<std::size_t>(bends.cols())) *
                                           (white + texture_about(cycles_per_row, unexplained, left.size()).power())))
    return {};
  double square = 0;
  for (Index k = 0; k < angles.size(); ++k) square += angles(k) * angles(k) / static_cast<double>(2 * k + 5);
  const double phase = std::sqrt(square);
  return {phase, kTaken * phase * std::sqrt(12.0) / (kTwoPi * rows)};
}

Surroundings surroundings(std::span<const double> column, std::span<const FittedLight> lights) {
  std::vector<double> cycles_per_row;
  for (const FittedLight& light : lights) cycles_per_row.push_back(light.cycles_per_row);
  const std::vector<double> harmonics = all_harmonics(cycles_per_row, column.size());
  Surroundings result;
  if (harmonics.empty()) return result;
  const Eigen::Map<const VectorXd> given(column.data(), static_cast<Index>(column.size()));
  const VectorXd centred = given.array() - given.mean();
  const auto steady = basis_of(harmonics, column.size());
  const auto rows = static_cast<double>(column.size());
  auto tones = find_tones(centred, *steady);
  // A harmonic of a tone may be another one.
  const bool modulated = std::ranges::any_of(cycles_per_row, [&](double c) { return modulates(tones, c, rows); });
  if (modulated) tones.clear();
  for (const FittedLight& light : lights)
    if (light.duty > 0 || lights.size() == 1)
      result.distortion = std::max(result.distortion, distortion_of(centred, light, harmonics, *steady, tones));
  for (const double tone : tones)
    for (const double cycles : cycles_per_row) result.inseparable |= std::abs(tone - cycles) * rows < 1;
  result.tones = tones;
  return result;
}

}  // namespace ocisac
