// Inner loops of project(), compiled once for each SIMD target.
#pragma once

#include <cstddef>
#include <cstdint>

namespace ocisac::kernels {

// A block of rows of bytes, each row dense.
struct ByteBlock {
  const std::uint8_t* pixels;
  std::ptrdiff_t row_stride;
  std::size_t rows;     // a multiple of row_group, at most kRowsPerChunk
  std::size_t columns;  // any
};

// 32-bit sums may grow over this many rows: 255·kRowsPerChunk·kLargestWeight < 2^31.
inline constexpr std::size_t kRowsPerChunk = 2048;
inline constexpr std::int32_t kLargestWeight = 4095;

// sums (outputs × columns), squares and maximum (columns) are added to (maximum: raised).
// pairs: of the block's first pair of groups; output o's pairs begin at pairs + o·pairs_stride.
void project_bytes(const ByteBlock& block, int row_group, const std::int32_t* pairs, std::size_t pairs_stride,
                   std::size_t outputs, double* sums, double* squares, std::uint8_t* maximum);

template <class T>
struct SampleBlock {
  const T* pixels;
  std::ptrdiff_t row_stride;
  std::size_t groups;
  std::size_t columns;
};

// The same in float64 for other samples; weights of output o begin at weights + o·weights_stride.
template <class T>
void project_samples(const SampleBlock<T>& block, int row_group, const double* weights, std::size_t weights_stride,
                     std::size_t outputs, double* sums, double* squares, double* maximum);

// Adds up a block of bytes: the time of merely reading a frame.
std::uint64_t read_bytes(const std::uint8_t* data, std::size_t size);

// The target whose code really runs.
const char* target_name();

}  // namespace ocisac::kernels
