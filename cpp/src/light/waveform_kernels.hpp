// Mean light of many exposures; compiled once for each SIMD target.
#pragma once

#include <cstddef>

#include "light/time_line.hpp"

namespace ocisac::kernels {

// level·(1 + swing·cos(2π·cycles))
struct ToneMeans {
  CycleCounter counter;  // in mid-exposure
  double level, swing;
};

// level·(light of whole cycles + that of the remaining part of a cycle)/length; pulses are centred on whole cycles.
struct SquareMeans {
  CycleCounter counter;  // at the end of the exposure
  double level, half_duty;
  double length, part, whole_light;  // cycles
};

// Cells, in each of which the light is value + slope·(cells since its beginning). Those of one round, if they repeat;
// else no exposure begins before the first or ends after the last.
struct CellTables {
  // (2·count + 1,) light of all cells before each, in cells, and its value, in turns: what the end of an exposure needs
  // lies side by side, and so does what its beginning needs, the value and the light before the next cell.
  const double* chain;
  const double* slopes;      // (count,); null if all are 0
  const double* before_low;  // (count + 1,) what the doubles of `chain` leave over; null if all are 0
  double count;
};

// level·(light of whole rounds + that of the remaining part of a round)/length
struct CellMeans {
  CycleCounter counter;  // of cells, at the end of the exposure
  CellTables cells;
  double level;
  double length, part, whole_light;  // cells
};

// out[i] += mean light of the exposure at x[i].
void add_means(const ToneMeans& light, const double* x, std::size_t count, double* out);
void add_means(const SquareMeans& light, const double* x, std::size_t count, double* out);
void add_means(const CellMeans& light, const double* x, std::size_t count, double* out);

}  // namespace ocisac::kernels
