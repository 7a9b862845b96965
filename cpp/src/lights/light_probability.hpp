// Probability that a refined tone or waveform is a light, from what it looks like in one picture: a logistic model.
#pragma once

#include <array>
#include <cstddef>

#include "lights/data_light.hpp"
#include "lights/refinement.hpp"

namespace ocisac {

using ToneTerms = std::array<double, 12>;
using DataTerms = std::array<double, 6>;

// Terms of the models; `suspects`: number of suspects in the picture that no light explains; `others`: expected number
// of other lights among those found.
ToneTerms terms_of(const RefinedLight& light, std::size_t suspects, double others);
DataTerms terms_of(const DataLight& data, std::size_t suspects);

// 1/(1 + e^{−(c + Σ a·x)}) of the terms x; coefficients by bench/light_probability.py.
double probability_of(const ToneTerms& terms);
double probability_of(const DataTerms& terms);

// Probability required of a light, so that photographs without lights have `false_alarms` on average.
double probability_for(double false_alarms);

}  // namespace ocisac
