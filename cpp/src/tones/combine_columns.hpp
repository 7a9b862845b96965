// Columns of one light as one or two signals a frame that keep all its fundamental.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/tones/periodic_fit.hpp"

namespace ocisac {

struct CombinedColumns {
  std::vector<double> signals;  // (frames · per_frame × rows)
  std::size_t per_frame;        // 1, or 2 where the columns differ in phase
};

// Weighted sums of the `group` neighbouring signals of each frame. The weights are the signals' own amplitudes (of the
// cosine and the sine of the fundamental, from `fit`), drawn towards their mean as far as noise explains that they
// differ (James and Stein 1961); orthonormal, so that white noise keeps its power.
CombinedColumns combine_columns(std::span<const double> signals, std::size_t rows, std::size_t group,
                                const PeriodicModel& model, const PeriodicFit& fit);

// What `count` squared normal deviates of variance 1 stay below with odds of about a million to one (Wilson and
// Hilferty 1931): above it, a peak is no accident of noise, even where a thousand bins were looked at.
double chance_energy(std::size_t count);

}  // namespace ocisac
