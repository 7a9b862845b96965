// Model of a column for the Wiener equaliser: smooth light and tones, or light and noise with power spectra.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "rows/fit.hpp"

namespace ocisac {

// Smooth light in a column: its most probable width and power, and the light that the rows saw.
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

// Power densities of the rows: light · seen(shape) + noise.
struct LightAndNoise {
  double light = 0, noise = 0;
  std::size_t shape = 0;
};

// For columns of `rows` rows (at least 16) at one exposure. Method: docs/explanation/tones.md.
class ColumnAnalysis {
 public:
  // `length`: of the DFT that the gain is for.
  ColumnAnalysis(std::size_t rows, double exposure_rows, std::size_t length);

  struct Result {
    std::vector<double> course;  // (rows) light of the smooth part and the tones that were subtracted from `column`
    LightAndNoise rest;          // of the residual
  };
  // `column`: without its least-squares line. `noise`: variance of a row's noise; absent: estimated.
  [[nodiscard]] Result take_off_course(std::span<double> column, std::optional<double> noise) const;

  // (length/2 + 1) The minimum-mean-square gain for the light's mean over a row time about the end of each exposure,
  // without the delay of half an exposure.
  [[nodiscard]] std::vector<std::complex<double>> gain(const LightAndNoise& rest) const;

 private:
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  using Vector = Eigen::VectorXd;

  void make_shapes(double exposure_rows);
  [[nodiscard]] Vector power_of(const Vector& column) const;  // its periodogram, (bins)
  [[nodiscard]] LightAndNoise fit(const Vector& periodogram, std::optional<double> noise) const;
  [[nodiscard]] SmoothLight::Estimate smooth_light(const Vector& column, std::optional<double> noise) const;
  [[nodiscard]] std::vector<double> new_tones(const Vector& spectrum, const LightAndNoise& rest,
                                              std::span<const double> known) const;
  [[nodiscard]] FrequencyFit find_tones(const Vector& column, std::optional<double> noise,
                                        const SmoothLight::Estimate& smooth, LightAndNoise& left) const;
  [[nodiscard]] Vector light_of(const FrequencyFit& tones) const;

  std::size_t rows_, length_, bins_, grouped_;  // bins of a group
  double exposure_rows_;
  SmoothLight smooth_;
  Matrix seen_;                                            // (shapes × bins) mean 1
  std::vector<std::vector<std::complex<double>>> wanted_;  // (shapes × bins)
  Matrix groups_seen_, weights_;                           // (shapes × groups), (shapes·ratios × groups)
  Vector log_sums_;                                        // (shapes·ratios)
};

}  // namespace ocisac
