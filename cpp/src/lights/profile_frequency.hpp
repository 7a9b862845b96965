// Frequency of a light's profile along the rows.
#pragma once

#include <cstddef>
#include <span>

namespace ocisac {

// Frequency between two bounds that maximises the energy of f, 2f and 3f (below half a cycle per row) in `profile`:
// starts at the peak of the fundamental on a grid of 1/8 cycle over the profile, then ascends.
double strongest_frequency(std::span<const double> profile, double lower, double upper);

// Phase at row 0 of the picture, rad, of the tone in `profile`, whose first row is the picture's `first_row`.
double phase_at_start(std::span<const double> profile, double frequency, std::size_t first_row);

// Standard error of the frequency by a delete-a-group jackknife (Efron and Stein 1981): at most 16 groups, each of
// whole cycles of the nonzero part.
double jackknife_std(std::span<const double> profile, double frequency, double cycles, double lower, double upper);

}  // namespace ocisac
