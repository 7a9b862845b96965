// The light of the rows of a picture, estimated from bundles of its columns.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/cleaning/light_share.hpp"

namespace ocisac {

// One frame in at most 192 bundles of neighbouring columns, since all columns of a row have the same light.
class ColumnBundles {
 public:
  // picture.frames is 1; `share`: of the light in each column, where it is known.
  explicit ColumnBundles(const BandedPicture& picture, std::span<const double> share = {});

  // Refines a row light of mean 1, with its scale kept (refine_row_light). The information of a row is at most 1.
  [[nodiscard]] RowLight refined(std::span<const double> rows, const RowLightPrior& model = {}, int steps = 6) const;

  // The row light without a model or an initial value: mean 1, its slow changes attributed to the picture.
  [[nodiscard]] RowLight free() const;

  [[nodiscard]] double depth(std::span<const double> rows) const;  // mean share of a row light of mean 1
  [[nodiscard]] double misfit(std::span<const double> rows, std::size_t lag) const;  // row_misfit with those shares
  // Decrease of the misfit by division by the light, at its comparison_lag.
  [[nodiscard]] double gain(std::span<const double> rows) const;

  [[nodiscard]] std::size_t rows() const { return rows_; }

 private:
  [[nodiscard]] BandedPicture picture() const { return {light_, variance_, 1, rows_, columns_}; }
  [[nodiscard]] std::vector<double> share_of_columns(std::span<const double> rows) const;
  [[nodiscard]] RowLight refined_with(std::span<const double> share, std::span<const double> rows,
                                      const RowLightPrior& model, int steps) const;

  std::size_t rows_, columns_ = 0;
  std::vector<double> light_, variance_;  // (rows × columns): means, and their noise variance
  std::vector<double> share_;             // of each bundle, where it is known
};

// Groups of colours with nearly the same course and depth along the rows, the one with the largest swing first. All are
// of one shape.
std::vector<std::vector<std::size_t>> alike_colours(std::span<const BandedPicture> colours);

// Rows scaled to mean 1 and the darkest ones to 0: the part of the light that is certainly modulated.
std::vector<double> fully_modulated_rows(std::span<const double> rows);

// Share of the rows' weighted variance that a model explains.
double explained_share(std::span<const double> rows, std::span<const double> model, std::span<const double> weight);

}  // namespace ocisac
