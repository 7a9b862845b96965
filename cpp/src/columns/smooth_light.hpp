// Smooth light in a column: its most probable width and power, and the light that the rows saw.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

namespace ocisac {

// For columns of `rows` rows at one exposure, without their least-squares lines. Method: docs on equalisation.
class SmoothLight {
 public:
  using Vector = Eigen::VectorXd;

  SmoothLight(std::size_t rows, double exposure_rows);

  struct Estimate {
    double score = 0;  // −2·ln of the evidence; of noise alone where the light is not evident
    bool evident = false;
    double noise = 0;    // variance that is left
    Vector seen, light;  // (rows) by the rows, and at the ends of their exposures; empty where it is not evident
  };
  // `noise`: variance of a row's noise; absent: estimated.
  [[nodiscard]] Estimate estimate(const Vector& column, std::optional<double> noise) const;

  // (rows × 2) orthonormal lines as the rows see them, and their light at the ends of the exposures.
  [[nodiscard]] const Eigen::MatrixXd& line() const { return line_; }
  [[nodiscard]] const Eigen::MatrixXd& line_light() const { return line_light_; }

 private:
  using Matrix = Eigen::MatrixXd;

  // Covariance of the rows, a row's variance 1: basis·vectors·diag(values)·vectorsᵀ·basisᵀ.
  struct Width {
    Vector power;  // (waves) variances
    Vector values;
    Matrix vectors;
  };

  Matrix line_, line_light_;
  Matrix basis_;      // (rows × terms) orthonormal, orthogonal to lines
  Matrix projected_;  // (terms × waves) waves as the rows see them
  Matrix light_;      // (rows × waves) light of the waves, less that of the lines in what the rows see of them
  std::vector<Width> widths_;
};

}  // namespace ocisac
