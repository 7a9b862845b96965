// The light of the rows of a picture, estimated from bundles of its columns.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/cleaning/light_share.hpp"

namespace ocisac {

constexpr std::size_t kSlowestRows = 128;  // per cycle; slower changes are those of the picture as well
constexpr double kSlowCycles = 2.5;        // in the picture, up to which bands of any length are like its shades

// Number of cosines of longer periods (append_slow_light), without a constant.
constexpr std::size_t slow_terms(std::size_t rows) { return 2 * rows / kSlowestRows; }

// One frame in at most 192 bundles of neighbouring columns, since all columns of a row have the same light.
class ColumnBundles {
 public:
  // Adds the colours of one frame: frames is 1 in each. `share` is that of the light in each column, if it is known.
  explicit ColumnBundles(std::span<const BandedPicture> colours, std::span<const double> share = {});
  explicit ColumnBundles(const BandedPicture& picture, std::span<const double> share = {})
      : ColumnBundles(std::span(&picture, 1), share) {}

  // Means of `height` rows, which show a light as well as each row does where it changes little over them.
  [[nodiscard]] ColumnBundles of_rows(std::size_t height) const;
  // Rows of such means of a light that changes over `lag` rows; 1 in small pictures.
  [[nodiscard]] std::size_t rows_of_means(std::size_t lag) const;

  // Refines a row light of mean 1, with its scale kept (refine_row_light). The information of a row is at most 1.
  [[nodiscard]] RowLight refined(std::span<const double> rows, const RowLightPrior& model = {}, int steps = 6) const;

  // The row light without a model or an initial value: mean 1, its slow changes attributed to the picture.
  [[nodiscard]] RowLight free() const;

  // row_misfit with the shares of a row light of mean 1.
  [[nodiscard]] double misfit(std::span<const double> rows, std::size_t lag) const;
  // Decrease of the misfit by division by the light, at its comparison_lag.
  [[nodiscard]] double gain(std::span<const double> rows) const;

  [[nodiscard]] std::size_t rows() const { return bundles_.rows; }

 private:
  [[nodiscard]] std::vector<double> share_of_columns(std::span<const double> rows) const;
  [[nodiscard]] RowLight refined_with(std::span<const double> share, std::span<const double> rows,
                                      const RowLightPrior& model, int steps) const;

  ColumnBundles() = default;

  Blocks bundles_;
  std::vector<double> share_;  // of each bundle, where it is known
};

// The sum of some colours.
ColumnBundles sum_of(std::span<const BandedPicture> colours, std::span<const std::size_t> some);

// Groups of colours with nearly the same course along the rows, the one with the largest swing first. All are
// of one shape.
std::vector<std::vector<std::size_t>> alike_colours(std::span<const BandedPicture> colours);

// Correlation of two courses of rows, 0 where one does not vary.
double correlation(std::span<const double> a, std::span<const double> b);

// Rows scaled to mean 1 and the darkest ones to 0: the part of the light that is certainly modulated.
std::vector<double> fully_modulated_rows(std::span<const double> rows);

// Share of the rows' weighted variance that a model explains.
double explained_share(std::span<const double> rows, std::span<const double> model, std::span<const double> weight);

}  // namespace ocisac
