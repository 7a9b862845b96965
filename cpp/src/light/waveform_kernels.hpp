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

// out[i] += mean light of the exposure at x[i].
void add_means(const ToneMeans& light, const double* x, std::size_t count, double* out);
void add_means(const SquareMeans& light, const double* x, std::size_t count, double* out);

}  // namespace ocisac::kernels
