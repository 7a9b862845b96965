// The loops of the screening of light sources, for the instructions that the processor has.
#pragma once

#include <cstddef>
#include <cstdint>

namespace ocisac::kernels {

constexpr std::size_t chunk_rows = 16;
constexpr std::size_t chunk_padding = 72;  // floats after a row that may be read

// Of every group of columns over a chunk of rows, less its first row: Σx, Σx·row, Σx², and products Σx·y, Σx·z with
// the next group and the one after it.
struct ChunkMoments {
  float *sum, *slope, *square, *next, *second;
};

// `rows`: chunk_rows rows of `groups` values, `stride` apart, with padding after each.
void chunk_moments(const float* rows, std::size_t stride, std::size_t groups, const ChunkMoments& out);

// out[g] = scale·(sum of bytes 8g … 8g + 7) − dark.
void sum_eight_bytes(const std::uint8_t* row, std::size_t groups, float scale, float dark, float* out);

// out[g] = ln(max(light[g], 0) + floor), to 1e-5.
void logarithms(const float* light, std::size_t groups, float floor, float* out);

}  // namespace ocisac::kernels
