// What varies along the rows beside a light's chips: slow light as mains hum, and tones of other lamps.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace ocisac {

// Row n reads, beside noise,
//
//   y_n = constant + Σ_k a_k·cos(πk(n + ½)/rows) + Σ_tone Σ_h (b·cos 2πhfn + c·sin 2πhfn) + (u + v·x + w·x²)·s_n
//
// k up to 2·rows·slow: light that varies more slowly than `slow`; h = 1 … kToneHarmonics below half a cycle a row; s_n
// the chips through the exposure, where they are known, of a swing that varies along the frame, x = −1 … 1.
struct RowNuisance {
  double slow = 0;            // cycles per row; 0: none
  std::vector<double> tones;  // cycles per row

  [[nodiscard]] bool empty() const { return slow == 0 && tones.empty(); }
};

inline constexpr std::size_t kToneHarmonics = 3;

struct NuisanceFit {
  std::vector<double> rest;  // (rows) the signal less slow light and tones
  double squares = 0;        // left by all of the model
};

// Least squares; `exposed`: s_n, empty where the chips are not known: then h = 1 only, since each term takes some of
// the chips with it. Absent where the rows do not determine it.
std::optional<NuisanceFit> remove_nuisance(std::span<const double> signal, const RowNuisance& nuisance,
                                           std::span<const double> exposed = {});

// The tone that stands out most between two frequencies (cycles per row): its frequency, and its power (Hann window)
// over the median of all of them.
struct StrongestTone {
  double frequency = 0, prominence = 0;
};
StrongestTone strongest_tone(std::span<const double> signal, double lowest, double highest);

// The signal less a square wave of duty ½ about this frequency (cycles per row, good to half a spectral line of the
// frame): of the frequency and phase that leave least.
std::vector<double> without_square_wave(std::span<const double> signal, double frequency);

}  // namespace ocisac
