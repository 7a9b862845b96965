// Chips of one combination of columns of a single frame, by slicing at local levels on a lattice of edges.
#pragma once

#include <cstddef>
#include <optional>

#include "chips/chip_timing.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/receiver/receive.hpp"
#include "ocisac/rows/chip_clock.hpp"

namespace ocisac {

inline constexpr double kBetter = 1.5;  // times the signal-to-noise ratio

// Prior knowledge about a frame.
struct ColumnSearch {
  FrequencyRange range;
  std::optional<double> exposure_rows;  // rows
  double sure_lead;                     // of the lattice over those of other rates, nats, for a reliable rate
  bool among_lamps = false;             // above or below others: it ends between them
};

// Throws for a chip rate above half the row rate.
ColumnSearch column_search(const ReceiveOptions& options, const Camera& camera, std::size_t rows);

// Without chips, or with weak ones, other light is removed from the rows and detection repeated. Steady rows beside a
// lamp show no other light. False without chips: the flags of `received` give the reason.
bool decode_column(const CombinedColumn& column, const ColumnSearch& what, double row_time, Received& received);

// Signal-to-noise ratio of the chips, and whether some are weak.
void rate_chips(Received& received);

inline ChipGrid grid_of(const Received& received) {
  return {{received.rows_per_chip, received.phase}, 0, received.bits.size()};
}

}  // namespace ocisac
