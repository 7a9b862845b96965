// Steps of find_frequency, for signals that are at hand.
#pragma once

#include "ocisac/tones/find_frequency.hpp"
#include "ocisac/tones/periodic_fit.hpp"

namespace ocisac {

// The frequency in the range that explains most with its first harmonics. NaN without signals.
double coarse_frequency(const PeriodicSignals& signals, const FrequencySearch& range);

// RMS error of the frequency by harmonics above half the row rate that fold beside own ones: a tone of level r within
// 1.5 cycles pulls by up to r/2 cycles, at a phase that is not known. Levels fall from the upper half of the own ones
// with this power of the order: 1 of edges, 2 as an exposure makes them.
double fold_error(const PeriodicFit& fit, double rows, int power);

}  // namespace ocisac
