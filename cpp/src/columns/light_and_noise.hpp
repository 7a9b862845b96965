// Model of a column for the Wiener equaliser: a smooth trend and tones, and light and noise with power spectra.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace ocisac {

// Power densities of the rows: light · seen(shape) + noise.
struct LightAndNoise {
  double light = 0, noise = 0;
  std::size_t shape = 0;
};

// For columns of `rows` rows (at least 16) at one exposure. Method: docs/tones.md.
class ColumnAnalysis {
 public:
  // `length`: of the DFT that the gain is for.
  ColumnAnalysis(std::size_t rows, double exposure_rows, std::size_t length);

  struct Result {
    std::vector<double> course;  // (rows) light of the trend and the tones that were subtracted from `column`
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
  void make_trend(double exposure_rows);
  [[nodiscard]] Vector periodogram(const Vector& column) const;
  [[nodiscard]] LightAndNoise fit(const Vector& periodogram, std::optional<double> noise) const;
  [[nodiscard]] Eigen::Index trend_terms(const Vector& column, std::optional<double> noise) const;
  [[nodiscard]] std::vector<double> new_tones(const Vector& spectrum, const LightAndNoise& rest,
                                              std::span<const double> known) const;
  [[nodiscard]] Matrix waves(std::span<const double> frequencies, double later) const;
  void refine(const Vector& column, std::vector<double>& frequencies) const;

  std::size_t rows_, length_, bins_, grouped_;  // bins of a group
  double exposure_rows_;
  Vector window_;
  Matrix seen_;                                            // (shapes × bins) mean 1
  std::vector<std::vector<std::complex<double>>> wanted_;  // (shapes × bins)
  Matrix groups_seen_, weights_;                           // (shapes × groups), (shapes·ratios × groups)
  Vector log_sums_;                                        // (shapes·ratios)
  Matrix trend_seen_, trend_light_;                        // (rows × terms) orthonormal, and their light
};

}  // namespace ocisac
