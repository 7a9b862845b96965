// Other tones and distortion in a column of a periodic light, which tone_gain's model omits.
#pragma once

#include <complex>
#include <span>
#include <vector>

namespace ocisac {

// A light of the model.
struct FittedLight {
  double cycles_per_row;
  double exposure_cycles;  // f·T_e; NaN: unknown
  double duty;             // of a square wave; 0: a tone
};

struct Surroundings {
  std::vector<double> tones;  // cycles per row of additive tones, to be fitted with the lights
  bool inseparable = false;   // one of them is within one cycle per frame of a light
  double distortion = 0;      // amplitude of harmonics that fit neither waveform nor exposure, over the light's
  double unevenness = 0;      // of the tone over the rows: see unevenness(); other columns may have more
};

// RMS amplitude of what waveform and exposure do not explain of the harmonics, over that of the fundamental; 0 where it
// is not significant. `orders`: the fundamental first; `levels`: a·cos + b·sin of each over the rows counted from the
// middle, as a − jb; `variance`: of a and b. Exposures up to 10 % off are admitted.
double harmonic_distortion(const FittedLight& light, std::size_t rows, std::span<const int> orders,
                           std::span<const std::complex<double>> levels, double variance);

// A light's tone is the same share of its mean, at the same phase, in all parts of a column: along the rows, in pairs
// of rows, in every other row. RMS of what the parts deviate from that, over the tone; 0 where it is not significant,
// as of a lamp that fills a part of the rows. Rows that are read unevenly, moved by a lens correction, of another
// exposure or frame, and other light in some rows deviate. `left`: what the fit leaves of the rows; mean and level: its
// own.
double unevenness(std::span<const double> left, double cycles_per_row, double mean, std::complex<double> level);

// Phase of a tone that bends along the rows, beyond a line: RMS, rad, and the error of the frequency, cycles per row,
// by the part of such a bend that a frequency takes up; 0 where that is not significant. Rows that a lens correction
// moves, or that a pause parts, turn the phase by θ(v), v from −1 to 1. Of its Legendre coefficients those from the
// second to the fifth, of more cycles to the seventh, are seen; the first is the error.
struct Bend {
  double phase = 0, frequency = 0;
};
Bend bend_of_phase(std::span<const double> left, double cycles_per_row, std::complex<double> level);

// `column`: linear light of one frame. A tone is accepted only if at most three of them leave white noise, so that a
// light that varies along the rows, whose sidebands are no tones, has none.
Surroundings surroundings(std::span<const double> column, std::span<const FittedLight> lights);

}  // namespace ocisac
