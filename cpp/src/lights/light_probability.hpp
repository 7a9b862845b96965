// Probability that a refined tone is a light, from what it looks like in one picture.
#pragma once

#include <array>
#include <cstddef>

#include "lights/data_light.hpp"
#include "lights/refinement.hpp"

namespace ocisac {

using ToneFeatures = std::array<double, 11>;
using DataFeatures = std::array<double, 7>;

// Features of the logistic models; `suspects`: number of suspects in the picture that no light explains; `others`:
// expected number of other lights among those found.
ToneFeatures features_of(const RefinedLight& light, std::size_t suspects, double others);
DataFeatures features_of(const DataLight& data, std::size_t suspects);

// 1/(1 + e^{−(c + Σ a·x + Σ b·x²)}) of the features x; coefficients by bench/light_probability.py.
// `inside`: of a light's own pixels.
double probability_of(const ToneFeatures& features, bool inside);
// For users; decisions rest on the fit p. The logit is a·ln p − b·ln(1 − p) + c (beta calibration, Kull et al. 2017),
// and more among many lights, which few of the fit's scenes have.
double corrected_probability_of(const ToneFeatures& features, bool inside);
double probability_of(const DataFeatures& features);

}  // namespace ocisac
