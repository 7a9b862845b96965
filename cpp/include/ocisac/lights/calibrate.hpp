// Frequency of the lamp in a picture, and the row time from a lamp of known frequency.
#pragma once

#include <cstddef>
#include <span>

#include "ocisac/tones/find_frequency.hpp"

namespace ocisac {

// As find_frequency, for a picture of a lamp. Its outline, text and drawn lines may resemble a tone better than its
// stripes do. Unless a tone explains the whole frame (snr of 4), the lights that detect_sources() finds in the first
// frame are therefore taken: the one whose swing has the largest energy. The flag model_misfit marks a light that a
// tone of the whole frame contradicts, an unlikely one or data where the frame has no tone, one in less than a
// hundredth of the columns, as text has, and a tone without any light. Frequencies below two cycles are searched if
// there is nothing else, or where the search has a lower bound.
FoundFrequency find_lamp_frequency(const AnyFramesView& frames, const FrequencySearch& search);

// Index of the colour plane in which the tone of find_lamp_frequency has the largest SNR; planes with few_cycles,
// at_bound or model_misfit come after the others. 0 if none contains a tone.
std::size_t pick_colour(std::span<const AnyFramesView> colours, const FrequencySearch& search);

struct Calibration {
  double row_time;      // s
  double row_time_std;  // s
  FoundFrequency found;
  double probability;  // of the light; NaN where a tone explains the whole frame, or there is no light
};

// T_r = (cycles per row) / frequency, for a lamp whose `frequency` (Hz, above 0) is below half the row rate.
// model_misfit also marks frames that would last longer than a second, as with a frequency in kHz for one in Hz, and
// rows of less than 0.1 µs.
Calibration calibrate(const AnyFramesView& frames, double frequency, const FrequencySearch& search);

}  // namespace ocisac
