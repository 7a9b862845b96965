// A picture divided by its estimated light, as compared in light_share and refine_row_light; how much its rows differ.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/cleaning/light_share.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

// One frame divided by f = 1 + q·P with the current shares q.
struct Cleaned {
  std::vector<double> light;     // c = v/f
  std::vector<double> slope;     // P/f = −dc/dq / c, or of rows q/f = −dc/dP / c
  std::vector<double> variance;  // of c

  explicit Cleaned(std::size_t size) : light(size), slope(size), variance(size) {}
};

constexpr double kLeastLight = 0.02;  // of the mean light, below which logarithms show noise

// Of the steps of a robust fit to rows: wide at first, so that bands are not taken for edges.
constexpr std::array<double, 5> kRowTextures{0.5, 0.3, 0.2, 0.1, 0.05};
inline double row_texture(std::size_t step) { return kRowTextures[std::min(step, kRowTextures.size() - 1)]; }

inline double light_left(double share, double change) { return std::max(1 + share * change, kMinLight); }

inline void clean_row(const BandedPicture& picture, std::size_t frame, std::size_t row, double change,
                      std::span<const double> share, Cleaned& out, bool of_rows = false) {
  const std::size_t first = row * picture.columns, offset = frame * picture.rows * picture.columns;
  const double* const light = picture.light.data() + offset;
  const double* const variance = picture.variance.data() + offset;
  const double* const of_pixel = share.data();
  double* __restrict cleaned = out.light.data();
  double* __restrict slope = out.slope.data();
  double* __restrict spread = out.variance.data();
  for (std::size_t i = first; i < first + picture.columns; ++i) {
    const double left = light_left(of_pixel[i], change);
    cleaned[i] = light[i] / left;
    slope[i] = (of_rows ? of_pixel[i] : change) / left;
    spread[i] = variance[i] / (left * left);
  }
}

// Divided by its light; share_of(row, column): of a pixel.
template <class Share>
Blocks without_light(const BandedPicture& picture, std::span<const double> row_light, Share share_of) {
  Blocks result{picture.frames * picture.rows,
                picture.columns,
                {picture.light.begin(), picture.light.end()},
                {picture.variance.begin(), picture.variance.end()}};
  for (std::size_t n = 0, i = 0; n < result.rows; ++n)
    for (std::size_t k = 0; k < result.columns; ++k, ++i) {
      const double left = light_left(share_of(n % picture.rows, k), row_light[n] - 1);
      result.light[i] /= left;
      result.variance[i] /= left * left;
    }
  return result;
}

inline void check(const BandedPicture& picture, std::span<const double> row_light) {
  const std::size_t pixels = picture.frames * picture.rows * picture.columns;
  require(pixels > 0, "picture", pixels, "at least one pixel");
  require(picture.light.size() == pixels, "picture", picture.light.size(), "frames x rows x columns values");
  require(picture.variance.size() == pixels, "variance", picture.variance.size(), "one value a pixel");
  require(row_light.size() == picture.frames * picture.rows, "row_light", row_light.size(), "one value a row");
  for (const double value : picture.light) require_finite("picture", value);
  for (const double value : picture.variance) require(value > 0, "variance", value, "above 0");
  for (const double value : row_light) require_not_negative("row_light", value);
}

// How much rows a few apart differ, by which row lights and shares are compared: mean of log(τ² + (difference² + noise
// variance)/mean²), τ = 0.05, over pairs of pixels `lag` rows apart in one column. Lower is more likely; the logarithm
// limits the influence of edges. 0 without pairs: pixels of infinite variance and pairs without light do not count.
double pair_misfit(const BandedPicture& picture, std::size_t lag);

// The same after division by the light. row_light: (frames × rows), mean about 1; share: one for all, one a column, or
// one a pixel (rows × columns).
double row_misfit(const BandedPicture& picture, std::span<const double> row_light, std::span<const double> share,
                  std::size_t lag);

}  // namespace ocisac
