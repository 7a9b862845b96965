// Sums to which the inner loops of project() add.
#pragma once

#include <cstddef>

namespace ocisac::kernels {

struct Moments {
  double *totals, *squares, *maximum;
};

// Accumulators of the blocks (the maximum: running maximum): sums (parts or outputs × columns, `stride` apart), moments
// (columns,). The first block of bytes of a pass overwrites them; the last one multiplies the sums, integers so far, by
// their units.
struct ProjectionSums {
  double* sums;
  std::size_t stride;
  Moments moments;
  bool first = false, last = false;
};

}  // namespace ocisac::kernels
