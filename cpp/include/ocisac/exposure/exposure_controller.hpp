// The next exposure of a camera from what the receiver and the sensing side measured in the last frame.
#pragma once

#include <cstdint>
#include <limits>
#include <span>

#include "ocisac/exposure/noisy_exposure.hpp"

namespace ocisac {

enum class ToneKind { communication, sensing };

// What is not known is NaN.
struct MeasuredTone {
  static constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
  double frequency;  // Hz, f_c or f_x·v; unknown: left out
  ToneKind kind = ToneKind::communication;
  double share = 1;                           // of its kind's weight, in proportion to the others' shares; >= 0
  double snr = unknown;                       // power ratio
  double gain = unknown, gain_std = unknown;  // measured at the frame's exposure
};

// Of one frame. Levels are shares of the full scale above dark.
struct ExposureMeasurement {
  static constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
  std::span<const MeasuredTone> tones{};
  double exposure = unknown, gain = unknown;  // the frame was taken with; unknown: as suggested last
  double level = unknown;                     // mean
  double peak = unknown;                      // of the brightest parts that must not saturate
  double saturated = 0;                       // share of the pixels
};

struct ExposureControllerOptions {
  ExposureWindow range;         // the camera's exposures
  double lowest_gain = 1;       // of the camera's amplifier, linear
  double highest_gain = 1;      //
  double comm_weight = 1;       // of all lights together
  double sense_weight = 1;      // of all motions together
  double hysteresis = 0.01;     // an exposure stays while the best is better by no more than this share
  double level_floor = 0.05;    // of the mean; 0: none
  double level_aim = 0.4;       // of the mean, by the amplifier, where it may
  double level_ceiling = 0.9;   // of the peak
  double max_saturated = 0.01;  // share of the pixels
  double min_snr = 1;           // tones below it are left out
  double noise_level = std::numeric_limits<double>::infinity();  // mean at gain 1 where shot noise equals read noise
};

// Why an exposure was chosen; several at once.
namespace exposure_reason {
constexpr std::uint32_t first = 1u << 0;             // nothing was suggested before
constexpr std::uint32_t held = 1u << 1;              // within the hysteresis of the best
constexpr std::uint32_t moved = 1u << 2;             // to the best
constexpr std::uint32_t brightness_floor = 1u << 3;  // the floor bounds the exposure from below
constexpr std::uint32_t ceiling = 1u << 4;           // the peak bounds it from above
constexpr std::uint32_t saturation = 1u << 5;        // saturated pixels bound it from above
constexpr std::uint32_t too_dark = 1u << 6;          // the camera cannot reach the floor
constexpr std::uint32_t too_bright = 1u << 7;        // the camera cannot stay below the ceiling
constexpr std::uint32_t floor_given_up = 1u << 8;    // floor and ceiling exclude each other: the ceiling counts
constexpr std::uint32_t no_tones = 1u << 9;          // nothing to choose by but brightness
constexpr std::uint32_t weak_left_out = 1u << 10;    // tones below min_snr, or of unknown frequency
constexpr std::uint32_t gain_mismatch = 1u << 11;    // a measured gain is not |sinc(f T)|
constexpr std::uint32_t no_brightness = 1u << 12;    // the mean level is unknown
}  // namespace exposure_reason

struct ExposureSuggestion {
  double exposure, gain;                 // s; linear
  double objective;                      // J(exposure), s; NaN without tones
  double best_exposure, best_objective;  // without hysteresis; NaN without tones
  double low, high;                      // s: what brightness and camera allow
  double noise_exposure;                 // T_n, s
  double level;                          // expected mean; NaN where unknown
  std::uint32_t reasons;
};

// Maximises J (noisy_exposure.hpp) over what the camera and the brightness allow, and stays where it is while that
// costs no more than the hysteresis: J(suggested)·(1 + hysteresis) >= J(T) of every allowed T, by the tones as
// measured. An update allocates nothing.
class ExposureController {
 public:
  explicit ExposureController(const ExposureControllerOptions& options);

  ExposureSuggestion update(const ExposureMeasurement& measurement);

  // Forgets what was suggested and where it saturated.
  void reset();

  [[nodiscard]] const ExposureControllerOptions& options() const { return options_; }

 private:
  struct Present {
    double exposure, gain, radiance;  // radiance: level a second at gain 1; NaN where unknown
  };
  [[nodiscard]] Present present_of(const ExposureMeasurement& measurement) const;
  [[nodiscard]] double largest_product(const ExposureMeasurement& measurement, const Present& present,
                                       std::uint32_t& reasons);
  [[nodiscard]] ExposureWindow window_of(double smallest, double largest, std::uint32_t& reasons) const;
  [[nodiscard]] double without_tones(const ExposureWindow& window, bool allowed, double present) const;
  void choose(std::span<const WeightedTone> tones, double present, ExposureSuggestion& chosen) const;
  [[nodiscard]] double gain_of(double exposure, double radiance, double smallest, double largest) const;

  ExposureControllerOptions options_;
  double exposure_, gain_;         // suggested last; NaN: nothing yet
  double limit_, limit_radiance_;  // product of exposure and gain that saturation allows, and where learnt
};

}  // namespace ocisac
