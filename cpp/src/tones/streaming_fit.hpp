// Least squares of mean + tones in one streaming pass over the pixels; rows are summed first if the loss is small.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "ocisac/core/views.hpp"
#include "ocisac/tones/projection.hpp"
#include "tones/harmonic_model.hpp"

namespace ocisac {

// Summing D neighbouring rows is a box filter, which scales a tone by g = sin(πνD)/(D·sin(πν)), ν = f·T_r. The fit of
// the sums includes g, so the estimate stays unbiased and only its variance grows. For a row n the model is c +
// a·cos(2πν(n − middle)) + b·sin(2πν(n − middle)).
class StreamingFit {
 public:
  // Selects the largest D of 8, 4, 2, 1 up to `most_rows` whose efficiency is at least `efficiency` for every tone: the
  // ratio of the amplitude's variances, with all rows over with sums. Weights for bytes are rounded to 13 bits or more
  // a limb; the estimate stays unbiased and its variance grows by less than 10⁻⁷.
  StreamingFit(std::size_t rows, std::span<const double> cycles_per_row, double efficiency, int most_rows, int limbs);

  // The fastest plan for passes over bytes or other samples, cached for later calls (the 32 last used).
  static std::shared_ptr<const StreamingFit> plan(std::size_t rows, const std::vector<double>& cycles_per_row,
                                                  double efficiency, bool bytes, int limbs = 1);

  // True if there are degrees of freedom left and every tone is resolvable, with at least a cycle, and separate from
  // others.
  [[nodiscard]] bool well_posed() const { return well_posed_; }

  struct Columns {
    std::vector<double> parameters;      // (1 + 2·tones, count): c, a_1, b_1, …, in DN as stored
    std::vector<double> noise_variance;  // (count), of one row
  };
  // Estimates of `count` columns from column `first` of the sums on. bytes: from a pass over bytes. `to` is overwritten
  // and resized; its memory is reused.
  void estimate(const Projection& sums, bool bytes, std::size_t first, std::size_t count, Columns& to) const;

  // Weights of the pass over the pixels, or over the light of their values.
  [[nodiscard]] const RowWeights& weights() const { return weights_; }
  // The model of the rows holds the flags of the tones and the covariance of the parameters.
  [[nodiscard]] const HarmonicModel& model() const { return model_; }
  [[nodiscard]] std::size_t rows_added() const {  // the first ones
    return weights_.groups() * static_cast<std::size_t>(weights_.row_group());
  }

 private:
  void adopt(std::size_t rows, std::span<const double> cycles_per_row, int row_group, int limbs);

  std::size_t estimates_;
  bool well_posed_ = false;
  double freedom_ = 0;    // degrees of freedom of the noise times D: squares of sums → variance of a row
  HarmonicModel model_;   // of the sums
  Eigen::MatrixXd gram_;  // (estimates × estimates): AᵀA of the design A of the sums
  // Matrices from totals and weighted sums to estimates (estimates × estimates), for exact weights and for those of
  // bytes.
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> of_samples_, of_bytes_;
  RowWeights weights_;
};

}  // namespace ocisac
