// The frequency of a periodic light, found from the rows alone.
#pragma once

#include <cstddef>
#include <limits>
#include <span>

#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/tones/tone_columns.hpp"

namespace ocisac {

enum class Harmonics {
  automatic,    // as many as stand out of the noise
  fundamental,  // a cosine
  all           // all below half the row rate, at most 31: a square wave of any duty
};

struct FrequencySearch {
  double lower = 0;    // cycles per row; 0: one cycle in the frame
  double upper = 0.5;  // cycles per row
  Harmonics harmonics = Harmonics::automatic;
  bool select_columns = true;                                    // leave out columns that do not show the light
  double saturation = std::numeric_limits<double>::quiet_NaN();  // DN; NaN where there is no such level
};

struct FoundFrequency {
  double frequency;       // cycles per row; NaN where nothing varies or there are fewer than 8 rows
  double frequency_std;   // its standard error, from the residual
  double snr;             // power of the periodic part over that of the residual, of the signals fitted
  std::size_t harmonics;  // the highest one in the final fit
  Flags flags;            // saturated, few_cycles, no_tone, at_bound
  ToneColumns columns;
};

// One frequency, shared by all columns and frames; amplitudes and phases are free.
FoundFrequency find_frequency(const AnyFramesView& frames, const FrequencySearch& search);

// Of several views of the same scene, the index of the one whose frequency has the smallest standard error; the first
// where none shows a tone.
std::size_t pick_colour(std::span<const AnyFramesView> colours, const FrequencySearch& search);

}  // namespace ocisac
