// The instants of many exposures on a time line, and their counts of cycles.
#pragma once

#include <cstddef>
#include <list>
#include <span>

#include "core/aligned_memory.hpp"
#include "light/time_line.hpp"
#include "light/waveform_kernels.hpp"

namespace ocisac {

// The numbers x on a time line: of rows, or times. Counts of cycles are made once for all origins of the line.
class Instants {
 public:
  // x: one value or more; it must outlive this.
  explicit Instants(std::span<const double> x);

  std::span<const double> x() const { return x_; }
  double first() const { return first_; }
  double last() const { return last_; }
  // True if each x lies one step, 0 or more, after the previous one.
  bool is_even() const { return even_; }

  // Counts the cycles of x[first] … x[first + count - 1], |x·step| < 2^50; the next call may overwrite them. Fractions
  // have a fine grid at any x; that of cycles grows with the largest count.
  kernels::Cycles counted(bool fractions, DoubleDouble step, std::size_t first, std::size_t count);

 private:
  struct Table {
    bool fractions = false;
    DoubleDouble step;
    kernels::Cycles cycles;
    AlignedMemory<double> memory;

    kernels::Cycles from(std::size_t first) const {
      return {cycles.coarse + first, cycles.fine + first, {}, cycles.grid};
    }
  };
  void count_all(std::span<const double> x, Table& table) const;

  std::span<const double> x_;
  double first_, last_;
  bool even_;
  std::list<Table> tables_;  // of all x
  Table block_;              // where these would take too much memory
};

}  // namespace ocisac
