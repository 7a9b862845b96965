// Frequency of a light's profile over the rows.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

// The largest energy of f, 2f and 3f (below half a cycle per row) in `profile` between two frequencies: the peak of the
// fundamental on a grid of an eighth of a cycle over the profile, then uphill.
double strongest_frequency(std::span<const double> profile, double lower, double upper);

// Of the tone in `profile`, whose first row is the picture's `first_row`, at row 0 of the picture, rad.
double phase_at_start(std::span<const double> profile, double frequency, std::size_t first_row);

// Its delete-a-group jackknife (Efron and Stein 1981), each of at most 16 groups whole cycles of what is not 0.
double jackknife_std(std::span<const double> profile, double frequency, double cycles, double lower, double upper);

}  // namespace ocisac
