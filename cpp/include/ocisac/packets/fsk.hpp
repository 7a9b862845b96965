// Frequency-shift keying for rolling shutters (CM-FSK): one tone out of a set for each frame.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/tones/projection.hpp"

namespace ocisac {

inline constexpr std::size_t kMaxTones = 256;

// The tone detected in a frame.
struct FskSymbol {
  std::size_t symbol = 0;               // index of the most likely tone
  std::vector<double> log_likelihoods;  // (tones) ln p(rows | tone), maximum 0
  std::vector<double> llr;              // (bits) ln P(1)/P(0), nats, of the symbol's bits, the most significant first
  double snr = 0;                       // symbol energy over density of noise and other light, E_s/N_0
  double error_rate = 0;                // of symbols: noncoherent orthogonal tones at that ratio
  double amplitude = 0;                 // of the tone in the rows, in their unit
  double noise = 0;                     // standard deviation of a row
};

// Throws std::invalid_argument for tones that are not 2, 4, … 256 different ones above 0 and below half the row rate.
void check_tones(const Camera& camera, std::span<const double> tones);

// Noncoherent detection of one tone out of M at unknown phase, mean and slope along the frame. With r_m the length of
// the rows' projection on tone m (cosine and sine, freed of mean and slope) and e_m the one expected,
//
//   ln p(rows | m) = ln I₀(e_m·r_m/σ²) − e_m²/(2σ²) + const,   e_m = amplitude·|sinc(f_m·T_e)|·√(rows/2)
//
// σ² is the variance of what the strongest tone leaves, or the power of other light there, if that is more.
//
// Tones are orthogonal where they lie apart by multiples of 1/(rows·row_time).
class FskDemodulator {
 public:
  // `tones`: Hz, as check_tones wants them, at least one cycle in a frame of `rows` rows.
  FskDemodulator(const Camera& camera, std::span<const double> tones, std::size_t rows);

  [[nodiscard]] std::size_t bits() const { return bits_; }

  // `signal`: (rows) linear light. `amplitude`: of the light's tone before the exposure, from earlier frames.
  [[nodiscard]] FskSymbol demodulate(std::span<const double> signal, std::optional<double> amplitude = {}) const;

 private:
  std::size_t bits_ = 0;
  std::vector<double> cycles_;     // (tones) per row
  std::vector<double> responses_;  // (tones) |sinc(f·T_e)|, at least kMinResponse
  RowWeights weights_;             // (mean, slope, then two a tone): orthonormal
};

// Probability that one of M orthogonal tones, detected noncoherently, is taken for another at E_s/N_0 = `snr`.
double fsk_symbol_error_rate(std::size_t tones, double snr);

}  // namespace ocisac
