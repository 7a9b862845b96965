// Detection of lights that send data: no spectral line, but a common waveform of all columns and a clock in its edges.
#pragma once

#include <optional>

#include "lights/refinement.hpp"
#include "lights/screening.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Rows and columns are estimated alternately, twice. Rows: where the log light, minus its mean over four cycles of the
// suspect's frequency, correlates between the left and the right half of the columns (local correlation above 0.6).
// Columns: those that correlate with the middle (above 0.5) and have at least 0.1 times its swing. The waveform is the
// common component of the box's columns, each element weighted with its local swing. Frequency: its strongest tone near
// the suspect's, or the one tone beside white noise that it is; snr: common swing over the residual; amplitude: its
// RMS. Absent if fewer than six edges remain.
std::optional<RefinedLight> find_data_light(const LitFrame& frame, const Suspect& suspect);

}  // namespace ocisac
