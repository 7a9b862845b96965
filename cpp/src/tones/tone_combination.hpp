// Combines columns of one light into one or two signals per frame that preserve its fundamental.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/tones/periodic_fit.hpp"

namespace ocisac {

struct CombinedTone {
  std::vector<double> signals;  // (frames · 1 or, where columns differ in phase, 2 × rows)
  double coherence;             // |Σ a| / Σ |a| over the amplitudes a of a frame's signals: 1 if all have one phase
};

// Weighted sums of the `group` neighbouring signals of each frame. The weights are the signals' amplitudes (of the
// cosine and the sine of the fundamental, from `fit`), shrunk towards their mean according to the noise (James and
// Stein 1961), and orthonormal, so that white noise keeps its power.
CombinedTone combine_by_tone(std::span<const double> signals, std::size_t rows, std::size_t group,
                             const PeriodicFit& fit);

}  // namespace ocisac
