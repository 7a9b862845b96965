// Mean light of many exposures; compiled once for each SIMD target.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "light/time_line.hpp"

namespace ocisac::kernels {

constexpr std::size_t kMaxReadAhead = 8;  // values

// Cycles x[i]·step = coarse[i] + fine[i], as fractions their distance from the nearest whole one; coarse is a multiple
// of `grid`.
void count_cycles(DoubleDouble step, double grid, bool fractions, std::span<const double> x, double* coarse,
                  double* fine);

// Cycles of exposures, of tones and square waves their fractions: coarse[i] + fine[i] + origin. `coarse` is a multiple
// of `grid`, a power of two, so that it adds up with another one without error; `fine`, within ±grid/2 but for
// rounding, is the rest. kMaxReadAhead more values of both may be read.
struct Cycles {
  const double* coarse = nullptr;
  const double* fine = nullptr;
  DoubleDouble origin{};
  double grid = 0;
};

struct MeansOutput {
  std::span<double> means;
  bool adds = true;  // to what is there, else to `steady`
  double steady = 0;

  void put(std::size_t i, double mean) const { means[i] = (adds ? means[i] : steady) + mean; }
};

// level·(1 + swing·cos(2π·cycles)), cycles in mid-exposure.
struct ToneMeans {
  double level, swing;
};

// level·(light of whole cycles + that of the remaining part of a cycle)/length. Pulses are centred on whole cycles, and
// `cycles` are at the middle of the part, d <= 1/2 from the nearest pulse. It overlaps that pulse by reach − d, where
// reach = (duty + part)/2, and by no more than `most` = min(duty, part); with the next pulse, which it reaches from
// d = 1 − reach on, never by less than `least` = duty + part − 1.
struct SquareMeans {
  double level;
  double length, whole_light;  // cycles
  DoubleDouble reach;
  double least, most;  // 0 or more
};

// Cells, in each of which the light is value + slope·(cells since its beginning). Those of one round, if they repeat;
// else no exposure begins before the second or ends after the last.
//
// The mean is scale·(light of whole rounds + that of the remaining part of a round), cycles counted in cells at the end
// of the exposure.
struct CellMeans {
  const double* chain;   // (2·count + 1,) light of all cells before each, in cells, and its value, in turns
  const double* slopes;  // (count,); null if all are 0
  // Value and slope of the last cell lie before the first one of either.
  const double* before_low;  // (count + 1,) what the doubles of `chain` leave over; null if all are 0
  std::int64_t count;
  std::int64_t origin_cell;   // of the table, before `cycles`
  bool even;                  // exposures follow each other in even steps
  double cells_per_exposure;  // such a step, 0 or more
  double scale;
  std::int64_t part_whole;  // cells of the remaining part
  double part_rest;         // below 1
  double whole_light;
};

// Mean light of exposure i goes to means[i], added to what is there or to steady light.
void write_means(const ToneMeans& light, const Cycles& cycles, const MeansOutput& to);
void write_means(const SquareMeans& light, const Cycles& cycles, const MeansOutput& to);
void write_means(const CellMeans& light, const Cycles& cycles, const MeansOutput& to);

}  // namespace ocisac::kernels
