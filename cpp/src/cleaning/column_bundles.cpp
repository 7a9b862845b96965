#include "ocisac/cleaning/column_bundles.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "cleaning/block_shares.hpp"
#include "cleaning/cleaned_picture.hpp"
#include "cleaning/quantile.hpp"
#include "cleaning/row_misfit.hpp"
#include "cleaning/slow_changes.hpp"
#include "core/statistics.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr std::size_t most_columns = 192, least_columns = 48, most_samples = 1U << 17U;  // of all bundles
constexpr std::size_t rows_of_shares = 512;   // means of rows show the shares of columns as well as each does
constexpr std::size_t rows_of_lag = 4;        // means in the lag between compared rows
constexpr double bright = 0.95, dark = 0.02;  // quantiles
constexpr double min_share = 0.02;            // of a column, relative to those with a large one
constexpr double min_depth = 1e-3;
constexpr double least_trend = 0.1;  // of the mean
constexpr double enough_rows = 0.9;  // of a column that counts
constexpr double alike = 0.9, alike_depth = 0.7;
constexpr double smallest = 1e-300, smallest_swing = 1e-100;

// Means of `height` × `width` neighbours; the last ones have what is left.
Values means_of(std::span<const double> values, std::size_t rows, std::size_t columns, std::size_t height,
                std::size_t width) {
  const std::size_t down = blocks_of(rows, height), across = blocks_of(columns, width);
  Values means(down * across);
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t k = 0; k < columns; ++k) means[n / height * across + k / width] += values[n * columns + k];
  for (std::size_t n = 0; n < down; ++n)
    for (std::size_t k = 0; k < across; ++k)
      means[n * across + k] /=
          static_cast<double>(std::min(height, rows - n * height) * std::min(width, columns - k * width));
  return means;
}

// Share of the rows in which each column is known.
Values known_share(const BandedPicture& picture) {
  Values share(picture.columns);
  for (std::size_t n = 0; n < picture.rows; ++n)
    for (std::size_t k = 0; k < picture.columns; ++k)
      share[k] += std::isfinite(picture.variance[n * picture.columns + k]) ? 1 : 0;
  for (double& value : share) value /= static_cast<double>(picture.rows);
  return share;
}

// Row means over the columns that are known in most rows; rows without any are interpolated.
Values row_means(const BandedPicture& picture) {
  const Values share = known_share(picture);
  const double enough = std::min(enough_rows, *std::max_element(share.begin(), share.end()));
  Values means(picture.rows), counts(picture.rows);
  for (std::size_t n = 0; n < picture.rows; ++n) {
    for (std::size_t k = 0; k < picture.columns; ++k) {
      const std::size_t at = n * picture.columns + k;
      if (share[k] < enough || !std::isfinite(picture.variance[at])) continue;
      means[n] += picture.light[at];
      counts[n] += 1;
    }
    means[n] /= std::max(counts[n], 1.0);
  }
  std::size_t before = picture.rows;  // the last row that is known
  for (std::size_t n = 0; n < picture.rows; ++n) {
    if (!(counts[n] > 0)) continue;
    for (std::size_t m = before == picture.rows ? 0 : before + 1; m < n; ++m) {
      const double start = before == picture.rows ? means[n] : means[before];
      const double along =
          before == picture.rows ? 1 : static_cast<double>(m - before) / static_cast<double>(n - before);
      means[m] = start + along * (means[n] - start);
    }
    before = n;
  }
  if (before == picture.rows) return Values(picture.rows, 1.0);
  std::fill(means.begin() + static_cast<std::ptrdiff_t>(before), means.end(), means[before]);
  for (double& value : means) value = std::max(value, 0.0);
  return means;
}

// Divides by the slow changes along the rows, which are attributed to the picture.
Values without_trend(const Values& rows) {
  const double mean = mean_of(rows);
  if (!(mean > 0)) return Values(rows.size(), 1.0);
  Values fast = rows;
  remove_slow_changes(fast);
  Values result(rows.size());
  for (std::size_t n = 0; n < rows.size(); ++n) result[n] = rows[n] / std::max(rows[n] - fast[n], least_trend * mean);
  return result;
}

}  // namespace

ColumnBundles::ColumnBundles(const BandedPicture& picture, std::span<const double> share) : rows_(picture.rows) {
  require(picture.frames == 1, "frames", picture.frames, "1");
  check(picture, Values(rows_, 1.0));
  require(share.empty() || share.size() == picture.columns, "share", share.size(), "one value a column");
  const std::size_t most = std::max(least_columns, std::min(most_columns, most_samples / rows_));
  const std::size_t width = blocks_of(picture.columns, most);
  columns_ = blocks_of(picture.columns, width);
  light_ = means_of(picture.light, rows_, picture.columns, 1, width);
  variance_ = means_of(picture.variance, rows_, picture.columns, 1, width);
  for (std::size_t i = 0; i < variance_.size(); ++i)
    variance_[i] /= static_cast<double>(std::min(width, picture.columns - i % columns_ * width));
  if (!share.empty()) share_ = means_of(share, 1, share.size(), 1, width);
}

std::vector<double> ColumnBundles::share_of_columns(std::span<const double> rows) const {
  require(rows.size() == rows_, "rows", rows.size(), "one value a row");
  if (!share_.empty()) return share_;
  Values lit(rows.begin(), rows.end());
  for (double& value : lit) value = std::max(value, 0.0);
  const std::size_t lag = comparison_lag(lit, rows_);
  const std::size_t height = std::max<std::size_t>(1, std::min(lag / rows_of_lag, rows_ / rows_of_shares));
  const Values light = means_of(light_, rows_, columns_, height, 1);
  Values variance = means_of(variance_, rows_, columns_, height, 1);
  for (double& value : variance) value /= static_cast<double>(height);
  const std::size_t count = blocks_of(rows_, height);
  const Values share = light_share({light, variance, 1, count, columns_}, means_of(lit, rows_, 1, height, 1), false);
  return means_of(share, count, columns_, count, 1);
}

RowLight ColumnBundles::refined_with(std::span<const double> share, std::span<const double> rows,
                                     const RowLightPrior& model, int steps) const {
  RowLight found = refine_row_light(picture(), share, rows, steps, model);
  const double most = std::max(*std::max_element(found.information.begin(), found.information.end()), smallest);
  for (double& value : found.information) value /= most;
  return found;
}

RowLight ColumnBundles::refined(std::span<const double> rows, const RowLightPrior& model, int steps) const {
  const Values of_columns = share_of_columns(rows);
  const double most = std::max(quantile(of_columns, bright), min_depth);
  // One share for each column: with a share for each pixel, a group of rows could have any swing.
  Values share(light_.size()), start(rows.begin(), rows.end());
  for (std::size_t i = 0; i < share.size(); ++i) share[i] = std::clamp(of_columns[i % columns_] / most, min_share, 1.0);
  for (double& value : start) value = std::max(1 + most * (value - 1), 0.0);
  return refined_with(share, start, model, steps);
}

RowLight ColumnBundles::free() const {
  const Values share(light_.size(), 1.0);  // relative to the columns with the largest share
  Values start = without_trend(row_means(picture()));
  const double mean = mean_of(start);
  for (double& value : start) value /= mean;
  RowLight found = refined_with(share, start, {}, 6);
  for (int again = 0; again < 2; ++again) found = refined(fully_modulated_rows(without_trend(found.light)));
  return {fully_modulated_rows(without_trend(found.light)), found.information};
}

double ColumnBundles::depth(std::span<const double> rows) const { return mean_of(share_of_columns(rows)); }

double ColumnBundles::misfit(std::span<const double> rows, std::size_t lag) const {
  return row_misfit(picture(), rows, share_of_columns(rows), lag);
}

double ColumnBundles::gain(std::span<const double> rows) const {
  const std::size_t lag = comparison_lag(rows, rows_);
  const double none = 0;
  return row_misfit(picture(), rows, {&none, 1}, lag) - misfit(rows, lag);
}

std::vector<std::vector<std::size_t>> alike_colours(std::span<const BandedPicture> colours) {
  std::vector<Values> swings;
  Values deviation, depth;
  for (const BandedPicture& colour : colours) {
    check(colour, Values(colours.front().rows, 1.0));
    Values swing = row_means(colour);
    const double mean = mean_of(swing), rows = static_cast<double>(swing.size());
    remove_slow_changes(swing);
    const double energy = std::inner_product(swing.begin(), swing.end(), swing.begin(), 0.0);
    deviation.push_back(std::sqrt(energy / rows) + smallest_swing);
    depth.push_back(deviation.back() / std::max(mean, smallest));
    swings.push_back(std::move(swing));
  }
  const auto correlation = [&](std::size_t a, std::size_t b) {
    return std::inner_product(swings[a].begin(), swings[a].end(), swings[b].begin(), 0.0) /
           static_cast<double>(swings[a].size()) / (deviation[a] * deviation[b]);
  };
  std::vector<std::size_t> left(colours.size());
  std::iota(left.begin(), left.end(), std::size_t{0});
  std::stable_sort(left.begin(), left.end(), [&](std::size_t a, std::size_t b) { return deviation[a] > deviation[b]; });
  std::vector<std::vector<std::size_t>> groups;
  while (!left.empty()) {
    const std::size_t best = left.front();
    std::vector<std::size_t> group, others;
    for (const std::size_t k : left) {
      const bool belongs = k == best || (correlation(k, best) > alike && depth[k] > alike_depth * depth[best]);
      (belongs ? group : others).push_back(k);
    }
    groups.push_back(std::move(group));
    left = std::move(others);
  }
  return groups;
}

std::vector<double> fully_modulated_rows(std::span<const double> rows) {
  Values result(rows.begin(), rows.end());
  const double most = most_of_rows(rows);
  for (double& value : result) value = std::min(value, most);
  const double low = quantile(result, dark), mean = mean_of(result);
  if (mean - low < 1e-9 * std::max(std::abs(mean), smallest)) return Values(rows.size(), 1.0);
  for (double& value : result) value = std::max((value - low) / (mean - low), 0.0);
  const double scale = mean_of(result);
  for (double& value : result) value /= scale;
  return result;
}

double explained_share(std::span<const double> rows, std::span<const double> model, std::span<const double> weight) {
  require(model.size() == rows.size() && weight.size() == rows.size(), "model, weight", model.size(),
          "one value a row");
  const double mean = std::inner_product(rows.begin(), rows.end(), weight.begin(), 0.0) /
                      std::accumulate(weight.begin(), weight.end(), 0.0);
  double swing = 0, left = 0;
  for (std::size_t n = 0; n < rows.size(); ++n) {
    swing += weight[n] * (rows[n] - mean) * (rows[n] - mean);
    left += weight[n] * (rows[n] - model[n]) * (rows[n] - model[n]);
  }
  return swing > 0 ? 1 - left / swing : 0;
}

}  // namespace ocisac
