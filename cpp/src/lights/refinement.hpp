// From a place that may hold a modulated light to its box and frequency.
#pragma once

#include <cstddef>
#include <optional>

#include "lights/screening.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Least rows and cycles of a box, and least amplitude in DN.
struct LightLimits {
  double rows, cycles, amplitude;
};

struct RefinedLight {
  std::size_t column, row, width, height;  // box of the fundamental above 15 % of its largest amplitude
  double frequency, frequency_std;         // cycles per row
  double phase;                            // rad, of the fundamental's sum at row 0 of the picture
  double snr;                              // periodic part over the rest, in the box
  double amplitude;                        // of the fundamental, DN
  double common;                           // share of the box's swing that all columns have in common
  double periodic;                         // share of that common swing that is periodic
  double texture;                          // rest of the swing, less what noise explains, over the periodic part
  double uneven;                           // depth of the texture's swing at the frequency; 0 where light multiplies it
};

// Demodulation at the suspect's frequency f with a Hann window of two cycles, which takes out the mean, gives the map
// of the light's swing. Its box is where the swing has the phase of its sum. The frequency maximises the energy of f,
// 2f and 3f in log light weighted by the local swing: an envelope that is real and positive moves no peak, however few
// cycles there are. Its standard error is a jackknife over groups of cycles. `dark`: DN of no light; a tone curve,
// which has no memory, keeps every period. `floor`: of the logarithm, DN. Nothing where box or amplitude is below 0.7
// of the limits on the way. `rounds`: one is enough where the suspect's box and frequency are those of the frame
// before.
std::optional<RefinedLight> refine_source(const AnyFramesView& frames, std::size_t frame, double dark,
                                          const Suspect& suspect, double floor, const LightLimits& limits,
                                          int rounds = 2);

}  // namespace ocisac
