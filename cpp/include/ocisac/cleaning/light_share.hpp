// The share of a modulated light in every pixel of a picture, and the light of every row, told apart from texture.
//
// A pixel reads v = c·(1 + q·P_n): c what it would read had the light shone steadily, q the light's share of it, P_n
// the row light less its mean of 1. Of two rows of one column, v/(1 + q·P) differ by texture alone; texture is mostly
// little and now and then an edge, so q (or P) is where the sum of log(τ² + difference²) is least.
#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

namespace ocisac {

// Linear light of one or several frames of a still scene, dense, C order (frames × rows × columns).
struct BandedPicture {
  std::span<const double> light;     // above dark
  std::span<const double> variance;  // of its noise, > 0; infinite where a pixel tells nothing (saturated)
  std::size_t frames = 1, rows = 0, columns = 0;
};

// 1 + q·P is kept above this: what is left of a pixel's light in a darker row is no measure of it.
constexpr double min_light = 0.05;

// Rows apart at which the light changes most for the texture in between: where its mean squared change first reaches
// 0.7 of its variance. `row_light`: (frames × rows).
std::size_t comparison_lag(std::span<const double> row_light, std::size_t rows);

// Share of the light in every pixel (rows × columns), 0 to the largest at which no row is darker than dark.
//
// Iteratively reweighted least squares over pairs of pixels `comparison_lag` rows apart, and of the same pixel in
// neighbouring frames; a pixel's share is that of its surroundings, within a reach that shrinks from 48 to 8 pixels
// (at least 2 lags) and ends at the edges of the picture as cleaned so far. Then, for one frame, shares that go on with
// the steady light around, as where a lamp's light ends, are tried against it. `smooth`: the widest steps are taken on
// columns added up by fours, and at last the shares' total variation about slow slopes is lowered, across the edges of
// the picture, as far as the pairs of pixels allow (for means over columns the steps before will do).
// row_light: (frames × rows), finite, >= 0, mean about 1. Time in proportion to the pixels; 22 buffers of their size.
std::vector<double> light_share(const BandedPicture& picture, std::span<const double> row_light, bool smooth = true);

struct RowLight {
  std::vector<double> light;        // (rows)
  std::vector<double> information;  // (rows) inverse of the variance of each, were the others known
};

// What is known of the row light beforehand.
struct RowModel {
  std::span<const double> basis;  // (rows × terms): it differs from where it starts by a sum of these; empty: anyhow
  double deviation =
      std::numeric_limits<double>::infinity();  // of a row from where it starts, standard deviation; above 0
};

// The row light of one frame by `steps` Gauss–Newton steps from `row_light` on pairs of rows 1, 2, 4, 8 and 16 apart
// over all columns; `share`: (rows × columns). What changes slower than that is left as it was, where no basis tells
// it. With a deviation, what the picture says counts a tenth: neighbouring columns hold much the same texture.
RowLight refine_row_light(const BandedPicture& picture, std::span<const double> share,
                          std::span<const double> row_light, int steps = 6, const RowModel& model = {});

}  // namespace ocisac
