#include "ocisac/cleaning/tone_light.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "cleaning/row_basis.hpp"
#include "cleaning/slow_changes.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/cleaning/judge_cleaning.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/tones/find_frequency.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr int steps = 10;                // of Gauss and Newton
constexpr double much_likelier = 0.01;   // min. decrease of the misfit
constexpr double largest_change = 0.25;  // cycles in the frame: the range of a linear step
constexpr double quarter = 0.25;         // cycles between compared rows

double from_middle(Eigen::Index row, Eigen::Index rows) {
  return static_cast<double>(row) - 0.5 * static_cast<double>(rows - 1);
}

// Frequencies of the waves of a tone: its harmonics below half the row rate, and the second lamp's.
Values waves_of(const ToneLight& tone) {
  Values waves;
  for (std::size_t k = 1; k <= tone.harmonics && static_cast<double>(k) * tone.frequency < 0.5; ++k)
    waves.push_back(static_cast<double>(k) * tone.frequency);
  if (tone.second > 0) waves.push_back(tone.second);
  return waves;
}

// Cosines, then sines, of the waves, phases from the middle row, into columns from `first` on.
void put_waves(Basis& basis, Eigen::Index first, const Values& waves) {
  const auto count = static_cast<Eigen::Index>(waves.size());
  for (Eigen::Index n = 0; n < basis.rows(); ++n)
    for (Eigen::Index k = 0; k < count; ++k) {
      const double cycles = from_middle(n, basis.rows()) * waves[static_cast<std::size_t>(k)];
      const double angle = 2 * std::numbers::pi * (cycles - std::floor(cycles));
      basis(n, first + k) = std::cos(angle);
      basis(n, first + count + k) = std::sin(angle);
    }
}

// A constant, then the waves, then `more` columns of zeros.
Basis periodic_basis(std::size_t rows, const Values& waves, Eigen::Index more = 0) {
  Basis basis = Basis::Zero(static_cast<Eigen::Index>(rows), 1 + 2 * static_cast<Eigen::Index>(waves.size()) + more);
  basis.col(0).setOnes();
  put_waves(basis, 1, waves);
  return basis;
}

// Scaled to mean 1 and a minimum of 0.
Values fully_modulated(Values tone) {
  const double mean = mean_of(tone);
  double darkest = 0;
  for (double& value : tone) darkest = std::max(darkest, mean - value);
  for (double& value : tone) value = darkest > 1e-9 ? 1 + (value - mean) / darkest : 1;
  return tone;
}

// The tone fitted to the picture from `light`, and the frequency f of each lamp by one Gauss–Newton step; d/df is
// proportional to the row.
ToneLight tone_of_picture(const ColumnBundles& picture, std::span<const double> light, ToneLight tone) {
  const Values waves = waves_of(tone);
  const auto count = static_cast<Eigen::Index>(waves.size());
  std::vector<Eigen::Index> fundamentals{0};
  if (tone.second > 0) fundamentals.push_back(count - 1);
  Basis basis = periodic_basis(picture.rows(), waves, 2 * static_cast<Eigen::Index>(fundamentals.size()));
  const Eigen::Index rows = basis.rows();
  const auto length = static_cast<double>(rows);
  Eigen::Index drift = 1 + 2 * count;
  for (const Eigen::Index wave : fundamentals)
    for (const Eigen::Index column : {1 + wave, 1 + count + wave}) {
      for (Eigen::Index n = 0; n < rows; ++n) basis(n, drift) = from_middle(n, rows) / length * basis(n, column);
      ++drift;
    }
  const RowLight refined = picture.refined(light, {.basis = span_of(basis)}, steps);
  const Eigen::VectorXd terms = fitted_terms(basis, vector_of(refined.light));
  drift = 1 + 2 * count;
  for (const Eigen::Index wave : fundamentals) {
    const double cosine = terms[1 + wave], sine = terms[1 + count + wave];
    const double change = (terms[drift] * sine - terms[drift + 1] * cosine) /
                          (2 * std::numbers::pi * length * std::max(cosine * cosine + sine * sine, 1e-300));
    drift += 2;
    double& frequency = wave == 0 ? tone.frequency : tone.second;
    const double moved = frequency + std::clamp(change, -largest_change / length, largest_change / length);
    const bool is_kept = wave > 0 || waves_of({{}, moved, tone.harmonics, tone.second}).size() == waves.size();
    if (moved > 0 && moved < 0.5 && is_kept) frequency = moved;
  }
  Basis moved = Basis::Zero(rows, 2 * count);
  put_waves(moved, 0, waves_of(tone));
  tone.light = fully_modulated(values_of(moved * terms.segment(1, 2 * count)));
  return tone;
}

ToneLight fitted_tone(const ColumnBundles& picture, const Values& start, ToneLight tone) {
  tone.light = fully_modulated(start);
  for (int again = 0; again < 2; ++again) tone = tone_of_picture(picture, tone.light, tone);
  return tone;
}

// Slow terms, then the waves.
Basis slow_and_periodic(std::size_t rows, const Values& waves) {
  const auto slow = static_cast<Eigen::Index>(slow_terms(rows));
  Basis basis = Basis::Zero(static_cast<Eigen::Index>(rows), slow + 2 * static_cast<Eigen::Index>(waves.size()));
  Values term(rows);
  for (Eigen::Index k = 0; k < slow; ++k) {
    slow_term(static_cast<std::size_t>(k), term);
    basis.col(k) = vector_of(term);
  }
  put_waves(basis, slow, waves);
  return basis;
}

// Least squares of the rows, weighted by their information: what the slow terms and the waves explain, and the waves.
struct OfRows {
  Values explained, waves;
};

OfRows fitted_to_rows(const RowLight& rows, const Values& waves) {
  const Basis basis = slow_and_periodic(rows.light.size(), waves);
  const Eigen::VectorXd root = vector_of(rows.information).array().sqrt();
  const Basis weighted = root.asDiagonal() * basis;
  const Eigen::VectorXd terms = fitted_terms(weighted, root.cwiseProduct(vector_of(rows.light)));
  const auto count = 2 * static_cast<Eigen::Index>(waves.size());
  return {values_of(basis * terms), values_of(basis.rightCols(count) * terms.tail(count))};
}

// The frequency of the rows, which may be of any scale.
FoundFrequency frequency_of(const Values& rows) {
  const AnyFramesView view = dense_view(rows.data(), 1, rows.size(), 1);
  FrequencySearch search;
  search.saturation = saturation_level(view, {});
  return find_frequency(view, search);
}

// The fundamental of a tone and the sine of a second lamp, where what the first leaves of the rows has one.
std::optional<ToneLight> with_second(const RowLight& rows, double frequency) {
  ToneLight tone{{}, frequency};
  Values left = fitted_to_rows(rows, waves_of(tone)).explained;
  for (std::size_t n = 0; n < left.size(); ++n) left[n] = rows.light[n] - left[n];
  const FoundFrequency found = frequency_of(left);
  if (!std::isfinite(found.frequency) || (found.flags & flag::no_tone) != 0) return {};
  const double apart = std::abs(found.frequency - frequency) * static_cast<double>(left.size());
  if (is_slow(found.frequency, left.size()) || apart < 1) return {};
  tone.second = found.frequency;
  return tone;
}

// The fundamental alone, or with harmonics or a second lamp if these decrease the misfit clearly. The fit starts with
// the fundamental, because periodic texture resembles the harmonics of the rows. None where `must_gain` and the
// fundamental is no better than none.
std::optional<ToneLight> likeliest(const ColumnBundles& picture, const RowLight& rows, const Values& fundamental,
                                   const ToneLight& tone, bool must_gain) {
  ToneLight best = fitted_tone(picture, fundamental, {{}, tone.frequency});
  if (must_gain && picture.gain(best.light) < min_gain) return {};
  const auto lag = static_cast<std::size_t>(std::max(std::nearbyint(quarter / tone.frequency), 1.0));
  std::vector<ToneLight> others;
  if (tone.harmonics > 1) others.push_back(fitted_tone(picture, fundamental, tone));
  if (const std::optional<ToneLight> two = with_second(rows, best.frequency))
    others.push_back(fitted_tone(picture, fitted_to_rows(rows, waves_of(*two)).waves, *two));
  double least = others.empty() ? 0 : picture.misfit(best.light, lag);
  for (ToneLight& tried : others) {
    const double misfit = picture.misfit(tried.light, lag);
    if (misfit >= least - much_likelier) continue;
    best = std::move(tried);
    least = misfit;
  }
  return best;
}

void check(const ColumnBundles& picture, const ToneLight& tone) {
  require(tone.light.size() == picture.rows(), "tone", tone.light.size(), "one value a row");
  require(tone.frequency > 0 && tone.frequency < 0.5, "frequency", tone.frequency, "above 0 and below 0.5");
  require(tone.harmonics > 0, "harmonics", tone.harmonics, "1 or more");
}

}  // namespace

std::optional<ToneLight> find_tone_light(const ColumnBundles& picture, const RowLight& rows,
                                         std::optional<double> enough) {
  require(rows.light.size() == picture.rows() && rows.information.size() == picture.rows(), "rows", rows.light.size(),
          "one value a row");
  const FoundFrequency found = frequency_of(rows.light);
  if (!std::isfinite(found.frequency) || ((found.flags & flag::no_tone) != 0 && enough)) return {};
  const ToneLight tone{{}, found.frequency, found.harmonics};
  const Values waves = waves_of(tone);
  if (waves.empty() || is_slow(found.frequency, picture.rows())) return {};  // slow lights, or shades
  const auto is_enough = [&](const Values& explained) {
    return !enough || explained_share(rows.light, explained, rows.information) >= *enough;
  };
  if (!is_enough(fitted_to_rows(rows, waves).explained)) {
    const std::optional<ToneLight> two = with_second(rows, found.frequency);
    if (!two || !is_enough(fitted_to_rows(rows, waves_of(*two)).explained)) return {};
  }
  return likeliest(picture, rows, fitted_to_rows(rows, {tone.frequency}).waves, tone, enough.has_value());
}

ToneLight tone_light_at(const ColumnBundles& picture, const ToneLight& tone, double frequency) {
  ToneLight moved{tone.light, frequency, tone.harmonics, tone.second};
  check(picture, moved);
  const Values waves = waves_of(moved);
  const Basis basis = periodic_basis(picture.rows(), waves);
  const RowLight refined = picture.refined(tone.light, {.basis = span_of(basis)}, steps);
  const Eigen::VectorXd terms = fitted_terms(basis, vector_of(refined.light));
  const auto count = 2 * static_cast<Eigen::Index>(waves.size());
  moved.light = fully_modulated(values_of(basis.rightCols(count) * terms.tail(count)));
  return moved;
}

ToneLight followed_tone_light(const ColumnBundles& picture, const ToneLight& tone) {
  check(picture, tone);
  return tone_of_picture(picture, Values(picture.rows(), 1.0), tone);
}

}  // namespace ocisac
