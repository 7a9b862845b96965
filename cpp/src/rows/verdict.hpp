// What a fit leaves of a row signal: its noise, and whether it is noise.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

inline constexpr double kNearNull = 0.05;  // |sinc| of an exposure below which it hides a tone

// Variance of white noise of a row beside light that changes slowly, from second differences.
double noise_of_differences(std::span<const double> signal);

// The same beside tones: the median of the upper half of a periodogram over that of an exponential variate.
double noise_floor(std::span<const double> power);

// True if the correlations at lags 1 and 2 are those of noise.
bool is_white(std::span<const double> residual);

// Probability that tones of a given frequency, `tones` of them with free amplitudes and phases, explain more than
// `share` of the energy of white noise, in which they leave `spare` degrees of freedom: 1 − I_share(tones, spare/2).
double chance_of_share(double share, std::size_t tones, double spare);

// Threshold that a sum of `count` squared standard normal variables exceeds with a probability of about 10⁻⁶ (Wilson
// and Hilferty 1931): low enough for a search over a thousand bins.
double chance_energy(std::size_t count);

// Schwarz's criterion of a model with this residual energy, noise unknown; the smaller the better.
double schwarz_criterion(double residual_energy, std::size_t rows, std::size_t parameters);

double median(std::vector<double> values);  // the upper one of two; at least one value

}  // namespace ocisac
