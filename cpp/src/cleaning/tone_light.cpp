#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "cleaning/merged_blocks.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/cleaning/judge_cleaning.hpp"
#include "ocisac/cleaning/row_model.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/rows/basis.hpp"
#include "ocisac/tones/find_frequency.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr int kSteps = 10;         // of Gauss and Newton
constexpr double kQuarter = 0.25;  // cycles: between compared rows; in the frame, the range of a linear step

// Cycles per row of a light that may be a shade of the picture.
bool is_slow(double frequency, std::size_t rows) {
  return frequency * static_cast<double>(kSlowestRows) < 1 || frequency * static_cast<double>(rows) < kSlowCycles;
}

// Fundamentals of its lamps; harmonics of the first one below half the row rate.
Values fundamentals_of(const ToneLight& tone) {
  return tone.second > 0 ? Values{tone.frequency, tone.second} : Values{tone.frequency};
}

Values harmonics_of(const ToneLight& tone) {
  Values harmonics;
  for (std::size_t k = 2; k <= tone.harmonics && static_cast<double>(k) * tone.frequency < 0.5; ++k)
    harmonics.push_back(static_cast<double>(k) * tone.frequency);
  return harmonics;
}

// A constant and slow terms, then the fundamentals times polynomials up to `degree`, then the harmonics; phases are
// from the middle row.
Eigen::MatrixXd design_of(std::size_t rows, const ToneLight& tone, std::size_t slow = 0, std::size_t degree = 0) {
  const RowSampling sampling = centred_rows(rows);
  Values basis;
  append_trend(basis, sampling, 0);
  append_slow_light(basis, sampling, slow);
  append_tones(basis, sampling, fundamentals_of(tone), degree);
  append_tones(basis, sampling, harmonics_of(tone));
  return matrix_of(basis, sampling);
}

// Scaled to mean 1 and a minimum of 0.
Values fully_modulated(Values tone) {
  const double mean = mean_of(tone);
  double darkest = 0;
  for (double& value : tone) darkest = std::max(darkest, mean - value);
  for (double& value : tone) value = darkest > 1e-9 ? 1 + (value - mean) / darkest : 1;
  return tone;
}

ToneLight fitted_tone(const ColumnBundles& picture, const Values& start, ToneLight tone) {
  tone.light = fully_modulated(start);
  for (int again = 0; again < 2; ++again) tone = refined_tone_light(picture, tone.light, tone);
  return tone;
}

// Least squares of the rows, weighted by their information: what the slow terms and the tone explain, and the tone.
struct OfRows {
  Values explained, waves;
};

OfRows fitted_to_rows(const RowLight& rows, const ToneLight& tone) {
  const std::size_t slow = slow_terms(rows.light.size());
  const Eigen::MatrixXd design = design_of(rows.light.size(), tone, slow);
  const Eigen::VectorXd root = vector_of(rows.information).array().sqrt();
  const Eigen::VectorXd terms = coefficients_of(root.asDiagonal() * design, root.cwiseProduct(vector_of(rows.light)));
  const Eigen::Index waves = design.cols() - 1 - static_cast<Eigen::Index>(slow);
  return {values_of(design * terms), values_of(design.rightCols(waves) * terms.tail(waves))};
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
  Values left = fitted_to_rows(rows, tone).explained;
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
  if (must_gain && picture.gain(best.light) < kMinGain) return {};
  const auto lag = static_cast<std::size_t>(std::max(std::nearbyint(kQuarter / tone.frequency), 1.0));
  std::vector<ToneLight> others;
  if (tone.harmonics > 1) others.push_back(fitted_tone(picture, fundamental, tone));
  if (const std::optional<ToneLight> two = with_second(rows, best.frequency))
    others.push_back(fitted_tone(picture, fitted_to_rows(rows, *two).waves, *two));
  double least = others.empty() ? 0 : picture.misfit(best.light, lag);
  for (ToneLight& tried : others) {
    const double misfit = picture.misfit(tried.light, lag);
    if (misfit >= least - kNextToNone) continue;
    best = std::move(tried);
    least = misfit;
  }
  return best;
}

}  // namespace

std::optional<ToneLight> find_tone_light(const ColumnBundles& picture, const RowLight& rows,
                                         std::optional<double> enough) {
  require(rows.light.size() == picture.rows() && rows.information.size() == picture.rows(), "rows", rows.light.size(),
          "one value a row");
  const FoundFrequency found = frequency_of(rows.light);
  if (!std::isfinite(found.frequency) || ((found.flags & flag::no_tone) != 0 && enough)) return {};
  const ToneLight tone{{}, found.frequency, found.harmonics};
  if (is_slow(found.frequency, picture.rows())) return {};  // slow lights, or shades
  const auto is_enough = [&](const Values& explained) {
    return !enough || explained_share(rows.light, explained, rows.information) >= *enough;
  };
  if (!is_enough(fitted_to_rows(rows, tone).explained)) {
    const std::optional<ToneLight> two = with_second(rows, found.frequency);
    if (!two || !is_enough(fitted_to_rows(rows, *two).explained)) return {};
  }
  return likeliest(picture, rows, fitted_to_rows(rows, {{}, tone.frequency}).waves, tone, enough.has_value());
}

ToneLight refined_tone_light(const ColumnBundles& picture, std::span<const double> light, ToneLight tone) {
  require(tone.frequency > 0 && tone.frequency < 0.5, "frequency", tone.frequency, "above 0 and below 0.5");
  require(light.size() == picture.rows(), "light", light.size(), "one value a row");
  const std::size_t harmonics = harmonics_of(tone).size();
  const double fastest = std::max(tone.frequency * static_cast<double>(harmonics + 1), tone.second);
  const std::size_t height = picture.rows_of_means(static_cast<std::size_t>(kQuarter / fastest));
  const Values basis = means_of_rows(span_of(design_of(picture.rows(), tone, 0, 1)), picture.rows(), height);
  const Values start = means_of_rows(light, picture.rows(), height);
  const Values refined = picture.of_rows(height).refined(start, {.basis = basis}, kSteps).light;
  const auto rows_of_basis = static_cast<Eigen::Index>(refined.size());
  const Eigen::Map<const Eigen::MatrixXd> design(basis.data(), rows_of_basis,
                                                 static_cast<Eigen::Index>(basis.size()) / rows_of_basis);
  const Eigen::VectorXd terms = coefficients_of(design, vector_of(refined));
  std::vector<double*> lamps{&tone.frequency};
  if (tone.second > 0) lamps.push_back(&tone.second);
  Eigen::VectorXd waves(2 * (lamps.size() + harmonics));  // without the polynomials, which move the frequencies
  for (std::size_t k = 0; k < lamps.size(); ++k) {
    const Eigen::Vector4d own = terms.segment(static_cast<Eigen::Index>(1 + 4 * k), 4);
    const double squares = std::max(own[0] * own[0] + own[2] * own[2], 1e-300),
                 rows = static_cast<double>(picture.rows());
    const double change = (own[1] * own[2] - own[3] * own[0]) / (std::numbers::pi * rows * squares);
    const double limit = kQuarter / rows, before = *lamps[k];
    *lamps[k] += std::clamp(change, -limit, limit);
    const bool is_tone = *lamps[k] > 0 && *lamps[k] < 0.5 && harmonics_of(tone).size() == harmonics;
    if (!is_tone) *lamps[k] = before;
    waves.segment(static_cast<Eigen::Index>(2 * k), 2) << own[0], own[2];
  }
  waves.tail(static_cast<Eigen::Index>(2 * harmonics)) = terms.tail(static_cast<Eigen::Index>(2 * harmonics));
  const Eigen::MatrixXd course = design_of(picture.rows(), tone).rightCols(waves.size());
  tone.light = fully_modulated(values_of(course * waves));
  return tone;
}

}  // namespace ocisac
