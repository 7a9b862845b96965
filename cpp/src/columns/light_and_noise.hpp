// Model of a column for the Wiener equaliser: smooth light and tones, or light and noise with power spectra.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "columns/smooth_light.hpp"
#include "rows/fit.hpp"

namespace ocisac {

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

  struct Smooth {
    SmoothLight::Estimate light;
    bool is_all;  // no more light than noise is left beside it
  };
  struct Tones {
    FrequencyFit fit;    // as the rows see them, beside a line
    LightAndNoise left;  // in its rest
  };

  void make_shapes(double exposure_rows);
  [[nodiscard]] Vector power_of(const Vector& column) const;  // its periodogram, (bins)
  [[nodiscard]] LightAndNoise fit(const Vector& periodogram, std::optional<double> noise) const;
  [[nodiscard]] Smooth smooth_light(const Vector& column, std::optional<double> noise) const;
  [[nodiscard]] std::vector<double> new_tones(const Vector& spectrum, const LightAndNoise& rest,
                                              std::span<const double> known) const;
  [[nodiscard]] Tones find_tones(const Vector& column, std::optional<double> noise,
                                 const SmoothLight::Estimate& smooth) const;
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
