// Bits from frames.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/chips/slicer.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

struct ReceiveOptions {
  std::optional<double> chip_rate;  // Hz; searched within 3 % of it. Absent: blind search, 2 to 64 rows per chip
};

// One source in one frame. If decoding fails, `bits` is empty, times are NaN and `flags` give the reason.
struct Received {
  std::size_t frame = 0;
  std::size_t source = 0;
  std::size_t colour = 0;           // index of the received colour
  std::string bits{};               // '0' and '1' in time order, 1 = bright; without the chips cut by the frame's edges
  double rows_per_chip = kNaN;      // rows
  double rows_per_chip_std = kNaN;  // rows, standard error
  double phase = kNaN;              // row at which the first whole chip begins: the middle of its edge's ramp
  double snr = kNaN;                // (swing/2)² / variance of the chips about their levels; at most 1e12
  SlicedChips detection{};          // levels and relative levels
  std::vector<double> weights{};    // (columns), sum 1; 0: not used
  Flags flags = 0;
  std::vector<double> colour_weights{};  // (colours) of the signal in the colours' light
};

// The sources in each frame, at least one result per frame, the strongest source first. `colours`: one view per colour,
// all of one shape. Several sources are separated by their columns (light_groups) or by dark rows between them, and the
// colour of best quality is received of each. A single source may send a stream in each colour (colour_streams):
// streams that differ are sources, each from the sum of colours that follows it alone; colours that agree are added
// where that betters the signal-to-noise ratio by half. Further sources are returned only if decoded without another
// warning flag, or periodic. Frames are decoded independently; bits of rows that another frame shows as well, that two
// halves of the columns do not share, or beside which many others have the same clock, as in a printed code, are
// flagged (flag::ambiguous_kind).
std::vector<Received> receive(std::span<const AnyFramesView> colours, const Camera& camera,
                              const ReceiveOptions& options = {});

// Estimate of the chip length in rows, as in `receive`; absent where decoding fails.
std::optional<double> blind_rows_per_chip(const CombinedColumn& column, const Camera& camera);

}  // namespace ocisac
