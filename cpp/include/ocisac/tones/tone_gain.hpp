// The normalised gain of tones in pixel columns (eqs. 13–16 and 24 of the paper).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

enum class GainMethod {
  fit,  // least squares at the exact frequency: mean + tones + harmonics (cf. IEEE Std 1057)
  dft,  // the paper's method: the DFT bin nearest to the tone (eqs. 24–25, figure 8)
};

enum class WaveformShape { tone, square };

struct ToneGainOptions {
  GainMethod method = GainMethod::fit;
  WaveformShape waveform = WaveformShape::tone;  // square: the fit includes all harmonics below half the row rate
  double duty = 0.5;                             // of the square wave, inside (0, 1)
  std::span<const double> background = {};       // DN above dark: empty (0), one value, or (frames × columns)
  double efficiency = 1;                         // min fraction of the fit's efficiency, (0, 1]
  int threads = 1;                               // upper bound: see for_each_block in parallel.hpp
  // fit: test the strongest columns of each frame for other tones, which are fitted too, for distortion and for rows
  // that deviate. See docs/explanation/tones.md.
  bool robust = false;
  // All columns of a frame combined into one, weighted by their brightness above background; saturated columns are
  // excluded if others remain.
  bool pooled = false;
};

// Arrays (tones × frames × columns), dense; of pooled columns one a frame. Undetermined values are NaN and flagged.
//   gain      2|X(f)|/X(0) over the waveform's own ratio at full depth: |sinc(f·T_e)| in theory
//   gain_std  standard error of gain
//   phase     of the light's fundamental at the end of row 0's exposure, rad in (−π, π], without the exposure's delay
//             where the exposure is known
//   mean      of the source's light, background subtracted, DN above dark
//   snr       ρ_c = G²·ρ̄, ρ̄ = mean²/(noise variance of a row) (eqs. 13–14)
// The magnitude is √(|amplitude|² − expected noise power), which is unbiased above the noise.
struct ToneGain {
  std::size_t tones = 0, frames = 0, columns = 0;
  std::vector<double> gain, gain_std, phase, mean, snr;
  std::vector<Flags> flags;
};

// The same in the caller's memory.
struct ToneGainView {
  std::span<double> gain, gain_std, phase, mean, snr;
  std::span<Flags> flags;
};

// Frequencies in Hz, > 0, at least one. Throws std::invalid_argument for invalid values.
ToneGain tone_gain(const AnyFramesView& frames, const Camera& camera, std::span<const double> frequencies,
                   const ToneGainOptions& options = {});

// Writes into `result`, whose arrays hold as many values each.
void tone_gain(const AnyFramesView& frames, const Camera& camera, std::span<const double> frequencies,
               const ToneGainOptions& options, const ToneGainView& result);

// Amplitude of the fundamental over the mean, at full depth and without exposure: 1 for a tone, 2·sinc(duty) for a
// square wave (4/π at duty 1/2).
double full_depth_ratio(WaveformShape waveform, double duty);

// Harmonics of a square wave above half the row rate. `orders`: up to eight of 0.5 % of the fundamental or more, fitted
// at their aliases, 1.5 cycles in the frame from all else of the model; `tied`: others, up to the 127th; `error`: of
// the gain, relative, by those of them that fall onto the mean or the fundamental, RMS over their phases; `onto`: mean
// square amplitude over that of the fundamental that they add to each harmonic, by order. Their sizes follow from duty
// and exposure; `exposure_cycles`: f·T_e.
struct FoldedHarmonics {
  std::vector<int> orders, tied;
  double error = 0;
  std::vector<double> onto;
};
FoldedHarmonics folded_harmonics(std::size_t rows, double cycles_per_row, double duty, double exposure_cycles);

// The multiples of a square wave of `duty` that lie below half the row rate and do not vanish, up to the 512th; at
// least {1}.
std::vector<int> square_wave_harmonics(double cycles_per_row, double duty);

// Mean light that black at 0 adds to a sample there by the noise that it cuts off, of a mean level as the rows show it;
// on average no more than the rows show above `off`, the level without the lamp. In steps.
double lost_at_black(double level, double deviation, double off);

}  // namespace ocisac
