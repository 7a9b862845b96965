// Selection of the columns with a periodic light, without text, edges, dark and saturated columns.
#pragma once

#include <cstdint>
#include <vector>

#include "ocisac/columns/column_blocks.hpp"
#include "ocisac/tones/periodic_fit.hpp"

namespace ocisac {

struct ToneColumns {
  std::vector<std::uint8_t> used;  // (columns): 1 for selected columns
  std::vector<double> strength;    // (columns): fraction of the variation that is periodic, 0 to 1
  bool saturated = false;          // more than a tenth of the pixels in use are saturated, for lack of better columns
};

// Selected blocks, (blocks) of 0 and 1: those whose ratio of periodic to other energy is at least a tenth of the best.
// Blocks with more than a tenth of saturated pixels are excluded if the others contain a tone of that strength.
std::vector<std::uint8_t> tone_blocks(const ColumnBlocks& blocks, const PeriodicFit& fit);

// The same for columns; neighbours share the decision of their block. `frequency`: cycles per row, above 0; folded into
// [0, 1/2]. With too few rows for a decision: strength 0 and every column selected.
ToneColumns tone_columns(const AnyFramesView& frames, double frequency, double saturation);

// Expands block decisions to columns.
ToneColumns spread_over_columns(const ColumnBlocks& blocks, const std::vector<std::uint8_t>& used_blocks,
                                const PeriodicFit& fit);

}  // namespace ocisac
