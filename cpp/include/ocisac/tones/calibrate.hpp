// Estimate of the row time from a light of known frequency.
#pragma once

#include "ocisac/tones/find_frequency.hpp"

namespace ocisac {

struct Calibration {
  double row_time;      // s
  double row_time_std;  // s
  FoundFrequency found;
};

// T_r = (cycles per row) / frequency, for a light whose `frequency` (Hz, above 0) is below half the row rate.
Calibration calibrate(const AnyFramesView& frames, double frequency, const FrequencySearch& search);

}  // namespace ocisac
