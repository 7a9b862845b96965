// Which columns of a picture show a periodic light, free of text, edges, darkness and saturation.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "ocisac/columns/column_blocks.hpp"
#include "ocisac/tones/periodic_fit.hpp"

namespace ocisac {

struct ToneColumns {
  std::vector<std::uint8_t> used;  // (columns): 1 where the column serves
  std::vector<double> strength;    // (columns): share of the variation that is periodic, 0 to 1
  bool saturated = false;          // more than a tenth of the used pixels are saturated: no better ones were found
};

// Which blocks serve, (blocks) of 0 and 1: those whose ratio of periodic to other energy is at least an eighth of the
// best, among the blocks with at most a tenth of saturated pixels where these hold a tone of that strength.
std::vector<std::uint8_t> tone_blocks(const ColumnBlocks& blocks, const PeriodicFit& fit);

// The same for columns; neighbours share the verdict of their block. `frequency`: cycles per row, above 0; folded into
// [0, 1/2]. Too few rows for a verdict: strength 0 and every column used.
ToneColumns tone_columns(const AnyFramesView& frames, double frequency, double saturation);

// From blocks to columns.
ToneColumns spread_over_columns(const ColumnBlocks& blocks, const std::vector<std::uint8_t>& used_blocks,
                                const PeriodicFit& fit);

}  // namespace ocisac
