// Least squares of a slow trend, a fundamental and harmonics of one shared, unknown frequency; amplitudes and phases
// per signal (separable least squares, Golub and Pereyra 1973; cf. IEEE Std 1057, four-parameter fit).
#pragma once

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
  std::vector<double> amplitudes;       // (2 × signals): a and b of the first harmonic, phases from the middle row
  double step = 0;                      // Gauss–Newton step of f towards the minimum of the summed residual energy

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
  // One signal in each lane, in dense strips of 16: (width/16 × half × 16), 0 beyond `count`. place: of a signal's
  // first row.
  [[nodiscard]] std::size_t width() const;
  [[nodiscard]] std::size_t place(std::size_t s) const;
  [[nodiscard]] const std::vector<double>& energies() const { return energies_; }  // (count) Σ y(n)²
  [[nodiscard]] const std::vector<double>& even() const { return even_; }          // y(u) + y(−u), y(0) once
  [[nodiscard]] const std::vector<double>& odd() const { return odd_; }            // y(u) − y(−u)
  // Inner products with the polynomials of a trend, degrees 0, 2 and 1: (3 × count).
  [[nodiscard]] const std::vector<double>& trend() const { return trend_; }

 private:
  void add_trend();

  std::vector<double> samples_;
  std::size_t rows_;
  std::vector<double> energies_, even_, odd_, trend_;
};

// Signals preferably with mean removed (energies are differences); more rows than parameters of the model; f in cycles
// per row. Without `with_step`, `step` is 0, in half the time.
PeriodicFit fit_periodic(const PeriodicSignals& signals, const PeriodicModel& model, double frequency,
                         bool with_step = true);

// The minimum over f near that of a fit with its step, within [lower, upper] cycles per row, where that fit lies.
PeriodicFit refine_periodic(const PeriodicSignals& signals, PeriodicFit best, double lower, double upper,
                            int max_steps = 30);

// Subtracts the model's fit at this frequency from each signal.
std::vector<double> residual_of(std::span<const double> signals, std::size_t rows, const PeriodicModel& model,
                                double frequency);

// Standard error at the minimum, from the residual, by the sandwich estimate. It allows for noise that is common to the
// signals of a group (the `group` neighbouring signals of one frame), increases with the light, or is correlated from
// row to row (Newey and West 1987, Bartlett weights; lag by Andrews 1991), and for texture at the tone. NaN without
// degrees of freedom. `residual`: of the signals, if it is wanted.
double frequency_std(std::span<const double> signals, std::size_t rows, std::size_t group, const PeriodicModel& model,
                     double frequency, std::vector<double>* residual = nullptr);

}  // namespace ocisac
