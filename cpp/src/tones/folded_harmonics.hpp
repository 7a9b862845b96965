// Harmonics of a square wave above half the row rate, which rows show at aliases.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "ocisac/tones/tone_gain.hpp"
#include "tones/harmonic_model.hpp"

namespace ocisac {

// Level of a harmonic relative to that of the fundamental, of a wave whose bright part has its middle at phase 0.
double harmonic_ratio(int order, double duty, double exposure_cycles);

// Tied harmonics have the ratios to the fundamental that duty and exposure tell. A light of level 1 and phase φ then
// shows, in the estimates of `model`, a fundamental that depends on φ alone: its phase tells φ, and with φ the level.
class TiedHarmonics {
 public:
  TiedHarmonics(const HarmonicModel& model, std::span<const int> tied, double cycles_per_row, double duty,
                double exposure_cycles);

  struct Light {
    double level,
        spread;    // relative to the fundamental that is shown; and its error by other lights that show the same
    double mean;   // light that the harmonics add to the mean, relative to the level
    double turn;   // of the phase that is shown, to the light's, rad
    double slope;  // of the logarithm of the level over the phase that is shown, 1/rad
  };
  // Phase of the fundamental that is shown, in the middle row, negative sincs turned, and its standard error, rad.
  // Nothing where no light shows it.
  [[nodiscard]] std::optional<Light> light(double phase, double phase_std) const;

 private:
  struct Lights {              // that show the same phase
    double least, most;        // level, also of lights that show nearly this phase
    double level, mean, turn;  // sums
    int count;
  };
  std::vector<Lights> lights_;  // by the phase that is shown, in steps of a turn
  [[nodiscard]] const Lights& lights_at(double place) const;
};

}  // namespace ocisac
