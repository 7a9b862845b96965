// Least squares of a slow trend, a fundamental and harmonics of one shared, unknown frequency; amplitudes and phases
// per signal (separable least squares, Golub and Pereyra 1973; cf. IEEE Std 1057, four-parameter fit).
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

inline constexpr std::size_t kComparedHarmonics = 3;  // sufficient to distinguish a fundamental from its harmonics

// A slow trend, a tone of frequency f, and multiples of it.
struct PeriodicModel {
  std::size_t trend_degree = 0;  // up to 2
  std::vector<std::size_t> harmonics{1};

  [[nodiscard]] std::size_t parameters() const { return trend_degree + 1 + 2 * harmonics.size(); }
};

// Up to `max_harmonics` below half the row rate, none of less than a cycle in the frame, and a trend that few cycles do
// not resemble: a constant below 2 cycles, a line below 4, then a parabola. Lower orders if there are too few rows.
PeriodicModel periodic_model(double frequency, std::size_t rows, std::size_t max_harmonics);

struct PeriodicFit {
  PeriodicModel model;
  double frequency = 0;                 // f, cycles per row
  std::vector<double> residual_energy;  // (signals): Σ r(n)²
  std::vector<double> periodic_energy;  // (signals): explained by the harmonics beyond the trend
  std::vector<double> harmonic_energy;  // (harmonics): rows/2·(a² + b²), summed over the signals
  std::vector<double> coefficients;     // (parameters × signals): of the trend; a and b of each harmonic in turn
  double step = 0;                      // Gauss–Newton step of f towards the minimum of the summed residual energy

  // (2 × signals): a and b of the first harmonic, phases from the middle row.
  [[nodiscard]] std::span<const double> amplitudes() const;
  [[nodiscard]] double total_residual() const;
  [[nodiscard]] double total_periodic() const;
};

// Signals prepared for many fits: what cosines and what sines are multiplied with, from the middle row on.
class PeriodicSignals {
 public:
  // samples: (count × rows) dense.
  PeriodicSignals(std::vector<double> samples, std::size_t rows);

  [[nodiscard]] const std::vector<double>& samples() const { return samples_; }
  [[nodiscard]] std::span<const double> signal(std::size_t s) const {
    return std::span(samples_).subspan(s * rows_, rows_);
  }
  [[nodiscard]] std::size_t rows() const { return rows_; }
  [[nodiscard]] std::size_t count() const { return energies_.size(); }
  [[nodiscard]] std::size_t half() const { return (rows_ + 1) / 2; }  // rows from the middle to the end
  // Signals lie in strips, (width/strip × half × strip), 0 beyond `count`: few one by one, many 16 side by side.
  [[nodiscard]] std::size_t strip() const;
  [[nodiscard]] std::size_t width() const;
  [[nodiscard]] const std::vector<double>& energies() const { return energies_; }  // (count) Σ y(n)²
  // y(u) + y(−u), y(0) once, with which cosines are multiplied; y(u) − y(−u), with which sines are.
  [[nodiscard]] const std::array<std::vector<double>, 2>& parts() const { return parts_; }
  // Inner products of the parts with a trend's polynomials: (degrees 0 and 2, or 1 × count).
  [[nodiscard]] const std::array<std::vector<double>, 2>& trend() const { return trend_; }

 private:
  void add_trend();

  std::vector<double> samples_;
  std::size_t rows_;
  std::vector<double> energies_;
  std::array<std::vector<double>, 2> parts_, trend_;
};

// Signals preferably with mean removed (energies are differences); more rows than parameters of the model; f in cycles
// per row. Without `with_step`, `step` is 0, in half the time.
PeriodicFit fit_periodic(const PeriodicSignals& signals, const PeriodicModel& model, double frequency,
                         bool with_step = true);

// The minimum over f near that of a fit with its step, within [lower, upper] cycles per row, where that fit lies.
PeriodicFit refine_periodic(const PeriodicSignals& signals, PeriodicFit best, double lower, double upper,
                            int max_steps = 30);

// Residuals of the signals after the fit.
std::vector<double> residual_of(const PeriodicSignals& signals, const PeriodicFit& fit);

// Standard error at the minimum, from the residual, by the sandwich estimate. It allows for noise that is common to the
// signals of a group (the `group` neighbouring signals of one frame), increases with the light, or is correlated from
// row to row (Newey and West 1987, Bartlett weights; lag by Andrews 1991), and for texture at the tone. NaN without
// degrees of freedom. `residual`: residual_of() the fit.
double frequency_std(const PeriodicSignals& signals, std::size_t group, const PeriodicFit& fit,
                     std::span<const double> residual);

}  // namespace ocisac
