// Refines a suspected light to its box and frequency.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "core/levels.hpp"
#include "lights/light_patch.hpp"
#include "lights/profile_frequency.hpp"
#include "lights/screening.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

constexpr double kMinRows = 24;  // of a light's box

struct RefinedLight {
  Region box = {};                          // of the fundamental above 15 % of its largest amplitude
  double frequency = 0, frequency_std = 0;  // cycles per row
  SystematicError systematic = {};          // of the frequency
  double phase = 0;                         // rad, of the fundamental's sum at row 0 of the picture
  double snr = 0;                           // periodic part over the residual, in the box
  double amplitude = 0;                     // of the fundamental, DN
  double common = 0;                        // fraction of the box's swing that is common to all columns
  double periodic = 0;                      // fraction of that common swing that its tone with harmonics explains
  double chance = 0;                        // probability of that in noise that the columns share, white along the rows
  double texture = 0;                       // residual swing minus noise, over the periodic part
  double uneven = 0;       // modulation depth of the texture at the frequency; 0 where light multiplies it
  double depth = 0;        // swing over mean light, where it is bright in the box
  double contour = 0;      // correlation of local swing and local light, in the box and around it
  double across = 0;       // energy of the box's swing in quadrature to its sum, over all of it
  double tilt = 0;         // rows by which its bars fall per column; 0 of a light
  double tilt_std = 0;     // standard error; 0: unknown
  std::size_t edges = 0;   // of the waveform of data
  double clock = 0;        // nats: evidence of a clock in them
  bool only_tone = false;  // the waveform is one tone in white noise
  bool inside = false;     // box and measures are those of the light's own pixels
};

constexpr double kLongestInner = 12;  // cycles in an inner box
// Reach of a search about a frequency, relative: of a suspect, and of a round.
constexpr double kFirstReach = 0.22, kFrequencyReach = kSmallShare;

// Log light along the rows of a light.
struct Profile {
  std::vector<double> matched;  // (patch rows): Σ over the light's columns of weight × log swing; 0 outside
  std::vector<double> weight;   // Σ of squared weights
  double energy = 0;            // Σ of squared log swing, in the box
  double common = 0;            // energy of the weighted mean over the columns
  double noise = 0;             // Σ of the noise variance, in the box
  double uneven = 0;  // modulation depth, at the frequency, of the variance across the columns in the box, 0 to 1
  std::vector<double> even;  // (patch rows): Σ over the columns of weight × log swing, equal in all rows of the box
};

double common_share(const Profile& profile);

// The light of a profile that a tone or a waveform explains to this fraction of its energy.
RefinedLight light_of(const Profile& profile, const Patch& patch, const Region& box, double frequency, double error,
                      double explained);

// Fraction of the energy Σ matched²/weight of a profile explained by a least-squares fit of weight·(`most` harmonics).
double periodic_share(std::span<const double> matched, std::span<const double> weight, double frequency,
                      std::size_t most);

// Tilt of the bars in a part of the patch, from the phase of the swing z of each group of columns u: the slope s that
// maximises |Σ z·e^(−jsu)|. `seen`: frequency of the demodulation.
void measure_tilt(const Patch& patch, const ComplexValues& swing, const Region& core, double seen, RefinedLight& light);

// Demodulation at the suspect's frequency f with a Hann window of two cycles, which removes the mean, gives a map of
// the light's swing. The box is the region where the swing has the phase of its sum. The frequency maximises the energy
// of f, 2f and 3f in log light weighted by the local swing: a real, positive envelope does not bias the peak, even for
// few cycles. Its standard error is a jackknife over groups of cycles. Absent if box or amplitude falls below 0.7 of
// the least rows, cycles or amplitude in a round. `rounds`: minimum; one suffices if the suspect's box and frequency
// come from the last frame. Rounds go on until box and frequency stand. `inside`: box and measures are
// those of the light's own pixels (own_pixels.hpp): where texture around a lamp swings in phase with it, a whole box is
// too large.
std::optional<RefinedLight> refine_source(const LitFrame& frame, const Suspect& suspect, double min_cycles,
                                          bool inside = false, int rounds = 2);

// Lights that send data: no spectral line, but a common waveform of all columns and a clock in its edges.
//
// Rows and columns are estimated alternately, twice. Rows: where the log light, minus its mean over four cycles of the
// suspect's frequency, correlates between the left and the right half of the columns (local correlation above 0.6).
// Columns: those that correlate with the middle (above 0.5) and have at least 0.1 times its swing. The waveform is the
// common component of the box's columns, each element weighted with its local swing. Frequency: its strongest tone near
// the suspect's, or the one tone beside white noise that it is; snr: common swing over the residual; amplitude: its
// RMS. Absent if fewer than six edges remain.
std::optional<RefinedLight> find_data_light(const LitFrame& frame, const Suspect& suspect);

}  // namespace ocisac
