// A light that sends data: no line in the spectrum, but one waveform in all its columns, and a clock in its edges.
#pragma once

#include <cstddef>
#include <optional>

#include "lights/refinement.hpp"
#include "lights/screening.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

struct DataLight {
  RefinedLight light;  // its strongest tone near the suspect's; snr: common swing over the rest; amplitude: its RMS
  std::size_t edges;   // of its waveform
  double evidence;     // nats: half a one for every edge, and that of their clock
};

// Rows and columns are taken in turn, twice. Rows: where log light, less its mean over four cycles of the suspect's
// frequency, swings alike in the left and the right half of the columns (local correlation above 0.6). Columns: those
// that swing as the middle does (correlation above 0.5, and 0.15 as far). What the columns of the box have in common,
// each element weighted with its own local swing, is the waveform. `dark`, `floor`: as of refine_source().
// Nothing where fewer than six edges are left.
std::optional<DataLight> find_data_light(const AnyFramesView& frames, std::size_t frame, double dark, double floor,
                                         const Suspect& suspect);

}  // namespace ocisac
