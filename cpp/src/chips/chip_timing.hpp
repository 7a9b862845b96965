// Blind estimate of chip rate and phase from the edges of a signal.
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "chips/edges.hpp"
#include "ocisac/chips/row_warp.hpp"
#include "ocisac/rows/chip_clock.hpp"

namespace ocisac {

// A clock fitted to edges, which do not determine its exposure.
struct ChipLattice {
  ChipClock clock;
  double rows_per_chip_std = 0;  // standard error, from the edges' residual
  double duty_offset = 0;        // excess length of bright runs over whole chips, rows
};

struct ChipTiming {
  ChipLattice lattice;
  double residual = 0;   // root mean square of the edges about the lattice, rows
  double certainty = 0;  // log-odds against edges at random places
  double cost = 0;       // description length of the edges, nats; the lattice of lowest cost is selected
  double lead = 0;       // by which lattices of other rates cost more
  Edges edges;           // all edges, at the best threshold
};

struct FrequencyRange {
  double lowest, highest;  // chips per row
};

struct TimingSearch {
  std::optional<ChipTiming> timing;  // absent where no lattice fits the edges
  std::size_t edges = 0;             // smallest number of edges over all smoothings
};

// Lattice of minimal description length for the edges: their residual, the lattice places with an edge, and collisions
// of edges at one place. Several thresholds are tried, and smoothing for long chips. `noise`: standard deviation of the
// signal, NaN where unknown.
TimingSearch find_chip_timing(std::span<const double> signal, double noise, FrequencyRange range);

// The warp that makes the edges' clock even, of rows that a lens correction or a stabiliser displaces: chips agree
// within each of up to 16 parts of the rows that hold four edges, and their phase changes by less than half a chip to
// the next. Empty where there are fewer than three parts.
RowWarp warp_of_edges(std::span<const double> signal, double noise, FrequencyRange range);

// The lattice for edges at one threshold; absent if none is consistent. `rows`: length of the frame.
std::optional<ChipTiming> find_lattice(const Edges& edges, std::size_t rows, FrequencyRange range);

// True if the edges wander about the lattice along the rows: these were not read evenly, or chips are missing.
bool wanders(const Edges& edges, const ChipLattice& lattice);

// Least squares of rows = phase + rows_per_chip·chips + duty_offset·[falling]: to all edges but those that specks or
// wrong levels displace, and to all.
struct FittedLattice {
  ChipLattice lattice, of_all;
};

// `chips`: index of the chip that begins at each edge. Absent if the edges do not determine it.
std::optional<FittedLattice> fit_lattice(const Edges& edges, std::span<const double> chips);

}  // namespace ocisac
