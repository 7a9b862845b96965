// Frequency estimate of a periodic light from the rows alone.
#pragma once

#include <cstddef>
#include <limits>

#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/tones/tone_columns.hpp"

namespace ocisac {

enum class Harmonics {
  automatic,    // those significantly above the noise
  fundamental,  // a cosine
  all           // all below half the row rate, at most 31: a square wave of any duty
};

struct FrequencySearch {
  double lower = 0;    // cycles per row; 0: one cycle in the frame
  double upper = 0.5;  // cycles per row
  Harmonics harmonics = Harmonics::automatic;
  bool select_columns = true;                                    // exclude columns without the light
  double saturation = std::numeric_limits<double>::quiet_NaN();  // DN; NaN without such a level
};

struct FoundFrequency {
  double frequency;       // cycles per row; NaN for constant signals or fewer than 8 rows
  double frequency_std;   // its standard error, from the residual
  double snr;             // power of the periodic part over that of the residual, of the fitted signals
  std::size_t harmonics;  // the highest one in the final fit
  Flags flags;  // saturated, few_cycles, no_tone, at_bound; model_misfit: a tone of which this is a harmonic shows, too
  ToneColumns columns;
  bool may_be_texture = false;  // model_misfit is set for this alone
  bool is_folded = false;       // a tone of which this is a folded harmonic shows, too
};

// One frequency, shared by all columns and frames; amplitudes and phases are free.
FoundFrequency find_frequency(const AnyFramesView& frames, const FrequencySearch& search);

}  // namespace ocisac
