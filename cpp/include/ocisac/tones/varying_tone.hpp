// Gain of a tone whose light or amplitude varies slowly along the column: a gradient, a drifting or inaccurate
// frequency. It tests tone_gain's assumption that these are constant, and estimates the bias if they are not.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/tones/tone_gain.hpp"

namespace ocisac {

// Arrays (frames × columns), dense. Undetermined values are NaN and flagged.
//   gain      mean over the rows of the tone's amplitude, over the mean light and the waveform's ratio
//   gain_std  standard error of gain, with that by harmonics that fold onto mean or fundamental
//   mean      of the source's light, DN above dark
//   bias      gain of tone_gain minus this one
//   bias_std  its standard error where tone_gain's model holds
//   flags     model_misfit: the bias is above four of its standard errors and above tone_gain's standard error
struct VaryingToneGain {
  std::size_t frames = 0, columns = 0;
  std::vector<double> gain, gain_std, mean, bias, bias_std;
  std::vector<Flags> flags;
};

// Least squares of a trend and tones whose levels are polynomials of `degree`, 0 to 4. Of the options waveform, duty,
// background and threads count. Throws as tone_gain does, and for a degree outside its range.
VaryingToneGain varying_tone_gain(const AnyFramesView& frames, const Camera& camera, double frequency, int degree = 2,
                                  const ToneGainOptions& options = {});

}  // namespace ocisac
