#include "ocisac/cleaning/column_bundles.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "cleaning/block_shares.hpp"
#include "cleaning/cleaned_picture.hpp"
#include "cleaning/merged_blocks.hpp"
#include "cleaning/quantile.hpp"
#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/rows/basis.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr std::size_t kMostColumns = 192, kLeastColumns = 48;
constexpr std::size_t kRowsOfShares = 512;  // means of rows show the shares of columns as well as each does
constexpr std::size_t kRowsOfLag = 4;       // means in the lag between compared rows
constexpr double kDark = 0.02;              // quantile
constexpr double kMinShare = 0.02;          // of a column, relative to those with a large one
constexpr double kMinDepth = 1e-3;

// Row means over the known pixels; rows without any are interpolated.
Values row_means(const BandedPicture& picture) {
  const Blocks rows = block_means(picture, 1, picture.columns);
  Values means = rows.light;
  std::size_t before = picture.rows;  // the last row that is known
  for (std::size_t n = 0; n < picture.rows; ++n) {
    if (!std::isfinite(rows.variance[n])) continue;
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

// Removes what the slow terms, which are orthogonal, explain, the mean included.
void remove_slow_changes(std::span<double> values) {
  const double rows = static_cast<double>(values.size()), mean = mean_of(values);
  Values from_edge(values.size()), term(values.size()), sine(values.size());
  std::iota(from_edge.begin(), from_edge.end(), 0.5);
  for (double& value : values) value -= mean;  // exactly 0 for even values
  for (std::size_t order = 1; order <= slow_terms(values.size()); ++order) {
    check_interrupt();
    fill_wave(from_edge, 0.5 * static_cast<double>(order) / rows, term, sine);
    const double part = 2 / rows * std::inner_product(term.begin(), term.end(), values.begin(), 0.0);
    for (std::size_t n = 0; n < values.size(); ++n) values[n] -= part * term[n];
  }
}

// Divides by the slow changes along the rows, which are attributed to the picture.
Values without_trend(const Values& rows) {
  const double mean = mean_of(rows);
  if (!(mean > 0)) return Values(rows.size(), 1.0);
  Values fast = rows;
  remove_slow_changes(fast);
  Values result(rows.size());
  for (std::size_t n = 0; n < rows.size(); ++n) result[n] = rows[n] / std::max(rows[n] - fast[n], kSmallShare * mean);
  return result;
}

}  // namespace

ColumnBundles::ColumnBundles(std::span<const BandedPicture> colours, std::span<const double> share) {
  const BandedPicture& picture = colours.front();
  require(picture.frames == 1, "frames", picture.frames, "1");
  for (const BandedPicture& colour : colours) check(colour, Values(picture.rows, 1.0));
  require(share.empty() || share.size() == picture.columns, "share", share.size(), "one value a column");
  const std::size_t most = std::max(kLeastColumns, std::min(kMostColumns, kEnoughPixels / picture.rows));
  const std::size_t width = blocks_of(picture.columns, most);
  bundles_ = block_means(colours, 1, width);
  share_ = means_of_rows(share, std::max<std::size_t>(share.size(), 1), width);
}

ColumnBundles ColumnBundles::of_rows(std::size_t height) const {
  ColumnBundles means;
  means.bundles_ = block_means(bundles_.picture(), height, 1);
  means.share_ = share_;
  return means;
}

std::size_t ColumnBundles::rows_of_means(std::size_t lag) const {
  return std::max<std::size_t>(1, std::min(lag / kRowsOfLag, rows() / kRowsOfShares));
}

std::vector<double> ColumnBundles::share_of_columns(std::span<const double> rows) const {
  require(rows.size() == bundles_.rows, "rows", rows.size(), "one value a row");
  if (!share_.empty()) return share_;
  Values lit(rows.begin(), rows.end());
  for (double& value : lit) value = std::max(value, 0.0);
  const std::size_t height = rows_of_means(comparison_lag(lit, lit.size()));
  const Blocks blocks = block_means(bundles_.picture(), height, 1);
  const Values each = light_share(blocks.picture(), means_of_rows(lit, lit.size(), height), false);
  Values share(blocks.columns);
  for (std::size_t i = 0; i < each.size(); ++i) share[i % blocks.columns] += each[i] / static_cast<double>(blocks.rows);
  return share;
}

RowLight ColumnBundles::refined_with(std::span<const double> share, std::span<const double> rows,
                                     const RowLightPrior& model, int steps) const {
  RowLight found = refine_row_light(bundles_.picture(), share, rows, steps, model);
  const double most = std::max(*std::max_element(found.information.begin(), found.information.end()),
                               std::numeric_limits<double>::min());
  for (double& value : found.information) value /= most;
  return found;
}

RowLight ColumnBundles::refined(std::span<const double> rows, const RowLightPrior& model, int steps) const {
  const Values of_columns = share_of_columns(rows);
  const double most = std::max(quantile(of_columns, kBrightRows), kMinDepth);
  // One share for each column: with a share for each pixel, a group of rows could have any swing.
  Values share(bundles_.light.size()), start(rows.begin(), rows.end());
  for (std::size_t i = 0; i < share.size(); ++i)
    share[i] = std::clamp(of_columns[i % bundles_.columns] / most, kMinShare, 1.0);
  for (double& value : start) value = std::max(1 + most * (value - 1), 0.0);
  return refined_with(share, start, model, steps);
}

RowLight ColumnBundles::free() const {
  const Values share(bundles_.light.size(), 1.0);  // relative to the columns with the largest share
  Values start = without_trend(row_means(bundles_.picture()));
  const double mean = mean_of(start);
  for (double& value : start) value /= mean;
  RowLight found = refined_with(share, start, {}, 6);
  for (int again = 0; again < 2; ++again) found = refined(fully_modulated_rows(without_trend(found.light)));
  return {fully_modulated_rows(without_trend(found.light)), found.information};
}

double ColumnBundles::misfit(std::span<const double> rows, std::size_t lag) const {
  return row_misfit(bundles_.picture(), rows, share_of_columns(rows), lag);
}

double ColumnBundles::gain(std::span<const double> rows) const {
  const std::size_t lag = comparison_lag(rows, rows.size());
  const double none = 0;
  return row_misfit(bundles_.picture(), rows, {&none, 1}, lag) - misfit(rows, lag);
}

ColumnBundles sum_of(std::span<const BandedPicture> colours, std::span<const std::size_t> some) {
  std::vector<BandedPicture> pictures;
  for (const std::size_t k : some) pictures.push_back(colours[k]);
  return ColumnBundles(pictures);
}

std::vector<std::vector<std::size_t>> alike_colours(std::span<const BandedPicture> colours) {
  std::vector<Values> swings;
  Values energy;
  for (const BandedPicture& colour : colours) {
    check(colour, Values(colours.front().rows, 1.0));
    Values& swing = swings.emplace_back(row_means(colour));
    remove_slow_changes(swing);
    energy.push_back(scalar_product(swing, swing));
  }
  std::vector<std::size_t> order(colours.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return energy[a] > energy[b]; });
  std::vector<std::vector<std::size_t>> groups;
  for (const std::size_t k : order) {
    const auto is_alike = [&](const auto& group) { return correlation(swings[group.front()], swings[k]) > kNearlyAll; };
    const auto same = std::find_if(groups.begin(), groups.end(), is_alike);
    if (same == groups.end())
      groups.push_back({k});
    else
      same->push_back(k);
  }
  return groups;
}

double correlation(std::span<const double> a, std::span<const double> b) {
  return likeness(without_mean(a), without_mean(b));
}

std::vector<double> fully_modulated_rows(std::span<const double> rows) {
  Values result(rows.begin(), rows.end());
  const double most = most_of_rows(rows);
  for (double& value : result) value = std::min(value, most);
  const double low = quantile(result, kDark), mean = mean_of(result);
  if (mean - low < 1e-9 * std::max(std::abs(mean), std::numeric_limits<double>::min())) return Values(rows.size(), 1.0);
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
