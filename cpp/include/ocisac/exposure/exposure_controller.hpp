// Next exposure of a camera from the measurements of communication and sensing in the last frame.
#pragma once

#include <cstdint>
#include <span>

#include "ocisac/core/constants.hpp"
#include "ocisac/exposure/best_exposure.hpp"

namespace ocisac {

// NaN: unknown.
struct MeasuredTone {
  double frequency;                     // Hz, f_c or f_x·v; NaN: ignored
  bool is_sensing = false;              // else of communication
  double share = 1;                     // share of the weight of its kind, relative to the other shares; >= 0
  double snr = kNaN;                    // power ratio
  double gain = kNaN, gain_std = kNaN;  // measured at the frame's exposure
};

// Measurements of one frame. Levels are fractions of the full scale above dark.
struct ExposureMeasurement {
  std::span<const MeasuredTone> tones{};
  double exposure = kNaN, gain = kNaN;  // used for the frame; NaN: the last suggestion
  double level = kNaN;                  // mean
  double peak = kNaN;                   // level of the brightest parts that must not saturate
  double saturated = 0;                 // fraction of the pixels
};

struct ExposureControllerOptions {
  ExposureWindow range;            // the camera's exposures
  double lowest_gain = 1;          // of the camera's amplifier, linear
  double highest_gain = 1;         //
  double comm_weight = 1;          // total weight of all lights
  double sense_weight = 1;         // total weight of all motions
  double hysteresis = 0.01;        // the exposure is held while the relative improvement of the best is at most this
  double level_floor = 0.05;       // lower bound of the mean; 0: none
  double level_aim = 0.4;          // target of the mean, reached by the amplifier where possible
  double level_ceiling = 0.9;      // upper bound of the peak
  double max_saturated = 0.01;     // fraction of the pixels
  double min_snr = 1;              // weaker tones are ignored
  double noise_level = kInfinity;  // mean at gain 1 where shot noise equals read noise
};

// Reasons for the chosen exposure; bits of one mask.
namespace exposure_reason {
enum Reason : std::uint32_t {
  first = 1u << 0,             // no earlier suggestion
  held = 1u << 1,              // within the hysteresis of the best
  moved = 1u << 2,             // changed to the best
  brightness_floor = 1u << 3,  // the floor bounds the exposure from below
  ceiling = 1u << 4,           // the peak bounds it from above
  saturation = 1u << 5,        // saturated pixels bound it from above
  too_dark = 1u << 6,          // the camera cannot reach the floor
  too_bright = 1u << 7,        // the camera cannot stay below the ceiling
  floor_given_up = 1u << 8,    // floor and ceiling exclude each other: the ceiling counts
  no_tones = 1u << 9,          // no tones: chosen by brightness alone
  weak_left_out = 1u << 10,    // tones below min_snr or of unknown frequency were ignored
  gain_mismatch = 1u << 11,    // a measured gain differs from |sinc(f T)|
  no_brightness = 1u << 12,    // the mean level is unknown
};
}  // namespace exposure_reason

struct ExposureSuggestion {
  double exposure, gain;                 // s; linear
  double objective;                      // J(exposure), s; NaN without tones
  double best_exposure, best_objective;  // without hysteresis; NaN without tones
  double low, high;                      // s: range allowed by brightness and camera
  double noise_exposure;                 // T_n, s
  double level;                          // expected mean; NaN where unknown
  std::uint32_t reasons;
};

// Maximises J (best_exposure.hpp) over the exposures allowed by the camera and the brightness. The suggestion is held
// while J(suggested)·(1 + hysteresis) >= J(T) for every allowed T, with the tones as measured. An update allocates no
// memory.
class ExposureController {
 public:
  explicit ExposureController(const ExposureControllerOptions& options);

  ExposureSuggestion update(const ExposureMeasurement& measurement);

  // Clears the last suggestion and the saturation limit.
  void reset();

  [[nodiscard]] const ExposureControllerOptions& options() const { return options_; }

 private:
  struct Present {
    double exposure, gain, radiance;  // radiance: level per second at gain 1; NaN where unknown
  };
  [[nodiscard]] Present present_of(const ExposureMeasurement& measurement) const;
  [[nodiscard]] double largest_product(const ExposureMeasurement& measurement, const Present& present,
                                       std::uint32_t& reasons);
  [[nodiscard]] ExposureWindow window_of(double smallest, double largest, std::uint32_t& reasons) const;
  [[nodiscard]] double without_tones(const ExposureWindow& window, bool allowed, double present) const;
  void choose(std::span<const WeightedTone> tones, double present, ExposureSuggestion& chosen) const;
  [[nodiscard]] double gain_of(double exposure, double radiance, double smallest, double largest) const;

  ExposureControllerOptions options_;
  double exposure_, gain_;         // last suggestion; NaN: none yet
  double limit_, limit_radiance_;  // product of exposure and gain that saturation allows, and the radiance at which it
                                   // was measured
};

}  // namespace ocisac
