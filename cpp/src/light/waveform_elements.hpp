// The elements of a waveform; each computes its mean light over an exposure.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "light/instants.hpp"
#include "light/time_line.hpp"
#include "light/waveform_kernels.hpp"
#include "ocisac/light/waveform.hpp"

namespace ocisac {

// A set of exposures: of length `exposure`, ending at line.at(x) for each x of the instants.
struct Exposures {
  TimeLine line;
  double exposure = 0;  // s; 0 samples a point
  Instants& instants;
};

// A waveform, or a part of one, prepared for a set of exposures: writes scale · mean light over exposure first + i for
// each of the means.
using MeanLight = std::function<void(std::size_t first, double scale, const kernels::MeansOutput& to)>;

// amplitude·cos(2π·(frequency·t + turns)).
struct Cosine {
  double amplitude = 1;
  DoubleDouble frequency;
  DoubleDouble turns;
};

// A time interval for the pieces of a product; their times count from its origin.
struct Stretch {
  DoubleDouble origin;
  double length = 0;

  TimeLine line() const { return {origin, 1}; }
};

// Light value + slope·(t − begin) from `begin` to the next step; begin counts from the interval's origin.
struct Step {
  DoubleDouble begin;
  double value = 0;
  double slope = 0;
};

class WaveformElement {
 public:
  virtual ~WaveformElement() = default;

  virtual MeanLight mean_light(const Exposures& exposures) const = 0;  // valid as long as the element

  // Upper bound of the magnitude.
  virtual double peak() const = 0;

  // An element of a product is either cosines (steady light: frequency 0) or steps.
  virtual std::vector<Cosine> cosines() const { return {}; }
  virtual std::vector<Step> steps(const Stretch&) const { return {}; }  // the first at or before the origin
  virtual double max_steps(double /*length*/) const { return 0; }
  virtual bool has_slopes() const { return false; }
  virtual bool has_decays() const { return false; }  // neither cosines nor steps: no factor of a product
};

using WaveformFactors = std::vector<std::shared_ptr<const WaveformElement>>;

// The mean light of a product of several elements.
MeanLight product_light(const WaveformFactors& factors, const Exposures& exposures);

std::shared_ptr<const WaveformElement> make_element(const Tone& tone);
std::shared_ptr<const WaveformElement> make_element(const SquareWave& wave);
std::shared_ptr<const WaveformElement> make_element(const TriangleWave& wave);
std::shared_ptr<const WaveformElement> make_element(const Chips& chips);
std::shared_ptr<const WaveformElement> make_element(const Samples& samples);

// Throws std::invalid_argument unless finite and within ±1e100.
void require_level(const char* argument, double level);

// rate·exposure, the cycles of an exposure; throws std::invalid_argument that names `argument` where there are too
// many.
DoubleDouble cycles_of(double rate, double exposure, const char* argument);

// An exposure whose length in cycles is too short to divide by counts as a point.
inline bool is_point(DoubleDouble cycles) { return cycles.high < 1e-290; }

}  // namespace ocisac
