#include "ocisac/tones/calibrate.hpp"

#include <utility>

#include "ocisac/core/require.hpp"

namespace ocisac {

Calibration calibrate(const AnyFramesView& frames, double frequency, const FrequencySearch& search) {
  require_positive("frequency", frequency);
  FoundFrequency found = find_lamp_frequency(frames, search);
  const double row_time = found.frequency / frequency, row_time_std = found.frequency_std / frequency;
  return {row_time, row_time_std, std::move(found)};
}

}  // namespace ocisac
