// Chip rate and phase, found blind from the edges of a signal.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/edges.hpp"

namespace ocisac {

// Chip k lies between rows phase + k·rows_per_chip and phase + (k + 1)·rows_per_chip: the middles of the ramps that the
// exposure makes of the light's edges, half an exposure after them.
struct ChipLattice {
  double rows_per_chip = 0;
  double rows_per_chip_std = 0;  // standard error, from the edges' residual
  double phase = 0;              // rows
  double duty_offset = 0;        // rows by which bright runs are longer than whole chips
};

struct ChipTiming {
  ChipLattice lattice;
  double residual = 0;   // root mean square of the edges about the lattice, rows
  double certainty = 0;  // ln of the odds against edges at random places
  double cost = 0;       // length of the description of the edges, nats; of two lattices the lower one is right
  Edges edges;           // all edges, read at the threshold that fits best
};

struct FrequencyRange {
  double lowest, highest;  // chips per row
};

struct TimingSearch {
  std::optional<ChipTiming> timing;  // absent where no lattice explains the edges
  std::size_t edges = 0;             // fewest edges seen at any smoothing
};

// The lattice that describes the edges in the fewest words: their residual, which lattice places hold an edge, and
// collisions of edges at one place. Several thresholds are tried, and smoothing for long chips. `noise`: standard
// deviation of the signal, NaN where unknown.
TimingSearch find_chip_timing(std::span<const double> signal, double noise, FrequencyRange range);

// The lattice for edges seen at one threshold; absent where none is consistent. `rows`: length of the frame.
std::optional<ChipTiming> find_lattice(const Edges& edges, std::size_t rows, FrequencyRange range);

// Least squares of rows = phase + rows_per_chip·chips + duty_offset·[falling] with outliers left out. `chips`: index of
// the chip that begins at each edge. Absent where the edges do not determine it.
std::optional<ChipLattice> fit_lattice(const Edges& edges, std::span<const double> chips);

}  // namespace ocisac
