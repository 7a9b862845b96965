// Separation of a modulated light from the texture of a picture: its share in every pixel and the light of every row.
//
// Model: v = c·(1 + q·P_n), with c the pixel value under steady light, q the light's share of it, and P_n the row light
// minus its mean of 1. Between two rows of one column, v/(1 + q·P) differs by texture only. Texture is mostly small
// with occasional edges, so q (or P) minimises the sum of log(τ² + difference²).
#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

namespace ocisac {

// Linear light of one or several frames of a still scene, dense, C order (frames × rows × columns).
struct BandedPicture {
  std::span<const double> light;     // above dark
  std::span<const double> variance;  // noise variance, > 0; infinite where a pixel carries no information (saturated)
  std::size_t frames = 1, rows = 0, columns = 0;
};

// One frame of its own memory: a picture, means of its blocks, or frames one below the other.
struct Blocks {
  std::size_t rows = 0, columns = 0;
  std::vector<double> light, variance;

  [[nodiscard]] BandedPicture picture() const { return {light, variance, 1, rows, columns}; }
};

// Lower bound of 1 + q·P: in darker rows the remaining light of a pixel is no reliable measure.
constexpr double kMinLight = 0.05;

// Row lag that maximises the change of the light relative to the texture in between: the first at which the mean
// squared change reaches 0.7 of the variance. `row_light`: (frames × rows).
std::size_t comparison_lag(std::span<const double> row_light, std::size_t rows);

// Share of the light in every pixel (rows × columns), between 0 and the largest for which every row light stays >= 0.
//
// Iteratively reweighted least squares over pairs of pixels `comparison_lag` rows apart, and over the same pixel in
// neighbouring frames. Each estimate is averaged over its surroundings; the reach decreases from 48 to 8 pixels (at
// least 2 lags), and edges of the cleaned picture limit it. `smooth`: the widest steps run on sums of 4 columns, and a
// last stage reduces the shares' total variation about slow slopes, subject to the pairs of pixels. Means over columns
// do not need this stage.
// row_light: (frames × rows), finite, >= 0, mean about 1. Run time is proportional to the pixels; memory: 22 buffers of
// their size.
std::vector<double> light_share(const BandedPicture& picture, std::span<const double> row_light, bool smooth = true);

// Shares (rows × columns) of each colour; all are of one shape. row_lights: of each colour.
//
// A light that is the only one, or that lights all alike, has one share; shares by pixel then follow texture. They
// replace one share for each colour only where they increase the likelihood by more than they do under an even light.
std::vector<std::vector<double>> colour_shares(std::span<const BandedPicture> colours,
                                               std::span<const std::vector<double>> row_lights);

struct RowLight {
  std::vector<double> light;        // (rows)
  std::vector<double> information;  // (rows) inverse variance of each, given the others
};

// Prior of the row light.
struct RowLightPrior {
  // (rows × terms), column by column: the change from the start is a linear combination of these; empty: unconstrained.
  std::span<const double> basis;
  double deviation = std::numeric_limits<double>::infinity();  // standard deviation of a row from its start; > 0
};

// Row light of one frame by `steps` Gauss–Newton steps from `row_light` on pairs of rows 1, 2, 4, 8 and 16 apart, over
// all columns; `share`: (rows × columns). Without a basis, slower changes keep their start values. With a deviation,
// the evidence of the picture has weight 1/10, because the texture of neighbouring columns is correlated.
RowLight refine_row_light(const BandedPicture& picture, std::span<const double> share,
                          std::span<const double> row_light, int steps = 6, const RowLightPrior& model = {});

}  // namespace ocisac
