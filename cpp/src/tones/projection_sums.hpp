// Sums to which the inner loops of project() add.
#pragma once

#include <cstddef>

namespace ocisac::kernels {

// Accumulators of the blocks (the maximum: running maximum): sums (parts or outputs × columns, `stride` apart), moments
// (columns,) each. The first block of bytes of a pass overwrites them; the last one multiplies the sums, integers so
// far, by their units.
struct ProjectionSums {
  double* sums;
  std::size_t stride;
  double *totals, *squares, *maximum;
  bool first = false, last = false;
};

}  // namespace ocisac::kernels
