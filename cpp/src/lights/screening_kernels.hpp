// Inner loops of the screening of light sources, compiled once for each SIMD target.
#pragma once

#include <cstddef>
#include <cstdint>

namespace ocisac::kernels {

constexpr std::size_t kChunkRows = 16;
constexpr std::size_t kChunkPadding = 72;  // floats that may be read beyond a row

// A chunk of rows: kChunkRows rows of groups of columns, `stride` apart, with padding after each. Of each group, first
// row subtracted: Σx, Σx·row, Σx², and products Σx·y, Σx·z with the next group and the one after it. common: the same
// rows, each value the sum over neighbouring ones, first row subtracted.
struct Chunk {
  const float* first;
  float *sum, *slope, *square, *next, *second, *common;
};

// Fills in all but the rows; `tile`: neighbours in a sum, 1 to 3.
void chunk_moments(std::size_t stride, std::size_t groups, std::size_t tile, const Chunk& chunk);

// Conditions for a candidate tile of `groups` neighbouring groups: energy above `min_energy`, and a common share of at
// least `min_share`.
struct TileBound {
  std::size_t groups;
  float min_energy, min_share, slope_energy;
};

// Scratch memory for a window: `groups` values and padding each.
struct WindowScratch {
  float *step, *sum, *slope, *own, *near, *far;
};

// Energies of tiles 0 … tiles − 1 of a window of two chunks, mean and slope of each group removed: energy[g] = Σ energy
// of its groups, 0 where the tile is no candidate. Sums of log light as of WindowScratch::sum, relative to the earlier
// first row. The energy common to the groups bounds that of any tone. Returns true if there is a candidate.
bool tile_energies(const Chunk& earlier, const Chunk& later, std::size_t tiles, const TileBound& bound,
                   const WindowScratch& scratch, float* energy);

// Sums of a tile's common log light c over a window, folded about its middle: even[k] = Σ_n cosine(n, k)·(c(31 − n) +
// c(n)), odd[k] = Σ_n sine(n, k)·(c(31 − n) − c(n)), n = 0 … 15. cosine, sine: (16 × waves), waves: a multiple of 8;
// step: of c, from the earlier chunk's first row to the later one's; rows are `stride` apart.
void wave_sums(const float* earlier, const float* later, float step, std::size_t stride, const float* cosine,
               const float* sine, std::size_t waves, float* even, float* odd);

// out[g] = scale·(sum of bytes 8g … 8g + 7) − dark.
void sum_eight_bytes(const std::uint8_t* row, std::size_t groups, float scale, float dark, float* out);

}  // namespace ocisac::kernels
