// Edge-preserving smoothing of the shares: most edges of the picture are edges of the objects, not of the light.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "cleaning/edge_aware_filter.hpp"

namespace ocisac {

// Reduces ½·Σ weight·x² − Σ pull·x + λ·Σ √(ε² + |∇(q + x) − t|²) over changes x of the shares q: their total variation
// about a trend t, the median slope within 40 pixels, so that slopes cost nothing and edges little. Each step is one of
// iteratively reweighted least squares. Conjugate gradients solve its equations from coarse to fine, on the picture
// reduced 8, 4 and 2 times and then on its pixels.
class ShareSmoother {
 public:
  ShareSmoother(std::size_t rows, std::size_t columns);

  // Adds x to `share`. `pull`, `weight`: evidence of each pixel, (rows × columns).
  void step(std::span<const double> pull, std::span<const double> weight, std::span<double> share);

 private:
  // System: weight·x_i + Σ_j coupling_ij·(x_i − x_j) = right over the neighbours j.
  struct Level {
    std::size_t rows, columns;
    std::vector<double> weight, down, across;  // couplings to the next row and column, 0 where there is none
    std::vector<double> right;                 // right-hand side, then the residual
    std::vector<double> change;                // x
    std::vector<double> direction, product, inverse;

    Level(std::size_t rows_of, std::size_t columns_of);
    std::size_t size() const { return rows * columns; }
    void take_from(const Level& finer);     // sums over 2 × 2 pixels
    void start_from(const Level& coarser);  // start value: the change of the coarser pixel
    void solve(int iterations);
    void invert_diagonal();
    void apply(const std::vector<double>& x, std::size_t row, std::vector<double>& out) const;
    double multiply(double keep);  // direction = residual/diagonal + keep·direction; product = matrix·direction;
                                   // returns their scalar product
    double advance(double step);   // along the direction; returns the size of the residual
  };

  // Slopes of the shares per pixel, by blocks.
  struct Trend {
    std::vector<double> down, across;
  };

  void couple(std::span<const double> share);
  void find_trend(std::span<const double> share);
  void find_right(std::span<const double> pull, std::span<const double> share);
  double trend_down(std::size_t row, std::size_t column) const;
  double trend_across(std::size_t row, std::size_t column) const;

  std::size_t block_rows_, block_columns_;
  EdgeAwareFilter blocks_;
  std::vector<double> passages_;  // equal for all blocks
  Trend trend_;
  std::vector<Level> levels_;  // the finest first
};

}  // namespace ocisac
