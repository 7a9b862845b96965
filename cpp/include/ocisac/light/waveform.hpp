// Light over time: tones, square and triangle waves, chips, samples, and sums and products of them.
#pragma once

#include <memory>
#include <vector>

namespace ocisac {

// amplitude·(1/2 + depth/2·cos(2π·frequency·t + phase)), eq. 5.
struct Tone {
  double frequency;      // Hz, >= 0 (0: steady light)
  double amplitude = 1;  // light at the maximum for depth 1
  double phase = 0;      // rad
  double depth = 1;      // 0 to 1
};

// `amplitude` while frequency·t + phase/2π is less than duty/2 away from a whole number, otherwise 0: a pulse is
// centred where the tone of the same phase has its maximum, so the fundamental is in phase with that tone for any duty.
struct SquareWave {
  double frequency;   // Hz, >= 0
  double duty = 0.5;  // share of a period that is bright, above 0 and below 1
  double amplitude = 1;
  double phase = 0;  // rad
};

// amplitude·(1/2 + depth/2·(1 − 4·distance)), distance: of frequency·t + phase/2π to the nearest whole number. The
// maximum is where the tone of the same phase has it; the fundamental is 8/π² of that tone's.
struct TriangleWave {
  double frequency;      // Hz, >= 0
  double amplitude = 1;  // light at the maximum for depth 1
  double phase = 0;      // rad
  double depth = 1;      // 0 to 1
};

// amplitude·levels[k] during [start + k/chip_rate, start + (k + 1)/chip_rate); dark before and after, or repeated
// without end. With time constants the light approaches each level as an RC circuit: dy/du = (level − y)/rise, u in
// chips, or over `fall` where y is above the level.
struct Chips {
  std::vector<double> levels;  // at least one
  double chip_rate;            // Hz, > 0
  double start = 0;            // s
  bool repeat = false;
  double amplitude = 1;
  double rise = 0;  // time constants, chips, 0 (instantly) to 1000
  double fall = 0;
};

// values[k] at start + k/sample_rate, linear in between; the end values hold before and after, or the samples repeat
// with the period len/sample_rate, linear from the last to the first.
struct Samples {
  std::vector<double> values;  // at least one
  double sample_rate;          // Hz, > 0
  double start = 0;            // s
  bool repeat = false;
};

class WaveformElement;

// A waveform: an immutable value, cheap to copy; a sum of products of the elements above. Levels and amplitudes are
// finite and within ±1e100. Invalid values throw std::invalid_argument.
class Waveform {
 public:
  struct Term {
    double coefficient = 1;
    std::vector<std::shared_ptr<const WaveformElement>> factors;  // none: steady light
  };

  Waveform(double level);  // steady light; implicit, so that numbers add and multiply
  Waveform(const Tone& tone);
  Waveform(const SquareWave& wave);
  Waveform(const TriangleWave& wave);
  Waveform(const Chips& chips);
  Waveform(const Samples& samples);

  const std::vector<Term>& terms() const { return terms_; }

  friend Waveform operator+(const Waveform& a, const Waveform& b);

  // Light transmitted or reflected by a moving object. At most one factor of a product may be Samples or a
  // TriangleWave; Chips with time constants may be multiplied by steady light only.
  friend Waveform operator*(const Waveform& a, const Waveform& b);

 private:
  explicit Waveform(std::vector<Term> terms);

  std::vector<Term> terms_;
};

}  // namespace ocisac
