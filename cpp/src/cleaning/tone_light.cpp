#include "ocisac/cleaning/tone_light.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "cleaning/row_basis.hpp"
#include "cleaning/slow_changes.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/tones/find_frequency.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr int steps_to_fit = 24, steps_to_follow = 10;  // with known shares, from another frame
constexpr double much_likelier = 0.01;                  // min. decrease of the misfit
constexpr double largest_change = 0.25;                 // cycles in the frame: the range of a linear step
constexpr double quarter = 0.25;                        // cycles between compared rows

double from_middle(Eigen::Index row, Eigen::Index rows) {
  return static_cast<double>(row) - 0.5 * static_cast<double>(rows - 1);
}

// Number of harmonics below half the row rate, at most `harmonics`.
Eigen::Index resolved(std::size_t harmonics, double frequency) {
  Eigen::Index count = 0;
  while (static_cast<std::size_t>(count) < harmonics && static_cast<double>(count + 1) * frequency < 0.5) ++count;
  return count;
}

// Cosines, then sines, of the harmonics, phases from the middle row, into columns from `first` on.
void put_harmonics(Basis& basis, Eigen::Index first, Eigen::Index count, double frequency) {
  for (Eigen::Index n = 0; n < basis.rows(); ++n)
    for (Eigen::Index k = 0; k < count; ++k) {
      const double cycles = from_middle(n, basis.rows()) * (static_cast<double>(k + 1) * frequency);
      const double angle = 2 * std::numbers::pi * (cycles - std::floor(cycles));
      basis(n, first + k) = std::cos(angle);
      basis(n, first + count + k) = std::sin(angle);
    }
}

// A constant, then the harmonics, then `more` columns of zeros.
Basis periodic_basis(std::size_t rows, Eigen::Index count, double frequency, Eigen::Index more = 0) {
  Basis basis = Basis::Zero(static_cast<Eigen::Index>(rows), 1 + 2 * count + more);
  basis.col(0).setOnes();
  put_harmonics(basis, 1, count, frequency);
  return basis;
}

// Scaled to mean 1 and a minimum of 0.
Values fully_modulated(Values tone) {
  const double mean = std::accumulate(tone.begin(), tone.end(), 0.0) / static_cast<double>(tone.size());
  double darkest = 0;
  for (double& value : tone) darkest = std::max(darkest, mean - value);
  for (double& value : tone) value = darkest > 1e-9 ? 1 + (value - mean) / darkest : 1;
  return tone;
}

// The tone fitted to the picture from `light`, and its frequency f by one Gauss–Newton step; d/df is proportional to
// the row.
ToneLight tone_of_picture(const ColumnBundles& picture, std::span<const double> light, std::size_t harmonics,
                          double frequency, int steps) {
  const Eigen::Index count = resolved(harmonics, frequency);
  Basis basis = periodic_basis(picture.rows(), count, frequency, 2);
  const Eigen::Index rows = basis.rows(), drift = 1 + 2 * count;
  const auto length = static_cast<double>(rows);
  for (Eigen::Index n = 0; n < rows; ++n) {
    basis(n, drift) = from_middle(n, rows) / length * basis(n, 1);
    basis(n, drift + 1) = from_middle(n, rows) / length * basis(n, 1 + count);
  }
  const RowLight refined = picture.refined(light, {.basis = span_of(basis)}, steps);
  const Eigen::VectorXd terms = fitted_terms(basis, vector_of(refined.light));
  const double cosine = terms[1], sine = terms[1 + count];
  double change = (terms[drift] * sine - terms[drift + 1] * cosine) /
                  (2 * std::numbers::pi * length * std::max(cosine * cosine + sine * sine, 1e-300));
  const bool is_small = std::abs(change) * length <= largest_change;
  if (!is_small || frequency + change <= 0 || frequency + change >= 0.5) change = 0;
  Basis moved = Basis::Zero(rows, 2 * count);
  put_harmonics(moved, 0, count, frequency + change);
  return {fully_modulated(values_of(moved * terms.segment(1, 2 * count))), frequency + change, harmonics};
}

ToneLight fitted_tone(const ColumnBundles& picture, const Values& start, std::size_t harmonics, double frequency) {
  ToneLight tone{fully_modulated(start), frequency, harmonics};
  for (int again = 0; again < 2; ++again)
    tone = tone_of_picture(picture, tone.light, harmonics, tone.frequency, steps_to_fit);
  return tone;
}

// The fundamental alone, or with harmonics if these decrease the misfit clearly. Periodic texture resembles harmonics
// if the fit starts with those of the rows, so both starts are tried.
ToneLight likeliest(const ColumnBundles& picture, const Values& all_of_rows, const Values& fundamental,
                    std::size_t harmonics, double frequency) {
  ToneLight best = fitted_tone(picture, fundamental, 1, frequency);
  if (harmonics == 1) return best;
  const auto lag = static_cast<std::size_t>(std::max(std::nearbyint(quarter / frequency), 1.0));
  double least = picture.misfit(best.light, lag);
  for (const Values* start : {&fundamental, &all_of_rows}) {
    ToneLight tried = fitted_tone(picture, *start, harmonics, frequency);
    const double misfit = picture.misfit(tried.light, lag);
    if (misfit >= least - much_likelier) continue;
    best = std::move(tried);
    least = misfit;
  }
  return best;
}

// The frequency of the rows, which may be of any scale.
FoundFrequency frequency_of(const Values& rows) {
  const AnyFramesView view = dense_view(rows.data(), 1, rows.size(), 1);
  FrequencySearch search;
  search.saturation = saturation_level(view, {});
  return find_frequency(view, search);
}

// Slow terms, then the harmonics.
Basis slow_and_periodic(std::size_t rows, Eigen::Index count, double frequency) {
  const auto slow = static_cast<Eigen::Index>(slow_terms(rows));
  Basis basis = Basis::Zero(static_cast<Eigen::Index>(rows), slow + 2 * count);
  Values term(rows);
  for (Eigen::Index k = 0; k < slow; ++k) {
    slow_term(static_cast<std::size_t>(k), term);
    basis.col(k) = vector_of(term);
  }
  put_harmonics(basis, slow, count, frequency);
  return basis;
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
  const Eigen::Index count = resolved(found.harmonics, found.frequency);
  if (count == 0 || found.frequency * slowest_rows < 1) return {};  // slower ones are slow lights, or shades
  const Basis basis = slow_and_periodic(picture.rows(), count, found.frequency);
  const Eigen::VectorXd root = vector_of(rows.information).array().sqrt();
  const Basis weighted = root.asDiagonal() * basis;
  const Eigen::VectorXd terms = fitted_terms(weighted, root.cwiseProduct(vector_of(rows.light)));
  if (enough && explained_share(rows.light, values_of(basis * terms), rows.information) < *enough) return {};
  const Basis tones = basis.rightCols(2 * count) * terms.tail(2 * count).asDiagonal();
  const Eigen::VectorXd fundamental = tones.col(0) + tones.col(count);
  return likeliest(picture, values_of(tones.rowwise().sum()), values_of(fundamental), found.harmonics, found.frequency);
}

ToneLight tone_light_at(const ColumnBundles& picture, const ToneLight& tone, double frequency) {
  check(picture, {tone.light, frequency, tone.harmonics});
  const Eigen::Index count = resolved(tone.harmonics, frequency);
  const Basis basis = periodic_basis(picture.rows(), count, frequency);
  const RowLight refined = picture.refined(tone.light, {.basis = span_of(basis)}, steps_to_fit);
  const Eigen::VectorXd terms = fitted_terms(basis, vector_of(refined.light));
  return {fully_modulated(values_of(basis.rightCols(2 * count) * terms.tail(2 * count))), frequency, tone.harmonics};
}

ToneLight followed_tone_light(const ColumnBundles& picture, const ToneLight& tone) {
  check(picture, tone);
  return tone_of_picture(picture, Values(picture.rows(), 1.0), tone.harmonics, tone.frequency, steps_to_follow);
}

}  // namespace ocisac
