// Inner loops of project() over bytes, in integers, compiled once for each SIMD target.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "tones/projection_sums.hpp"

namespace ocisac::kernels {

// Groups of rows of bytes, each row dense: `groups` of them from `pixels` on and, if folded, their mirror images from
// `mirrored`, the first row of the last group, on backwards.
struct ByteBlock {
  const std::uint8_t* pixels;
  const std::uint8_t* mirrored;  // null: not folded
  std::ptrdiff_t row_stride;
  std::size_t groups;          // at most kRowsPerChunk rows, the mirrored ones included
  std::size_t columns;         // any number
  bool cached = false;         // copies, of which no line needs to be asked for
  std::ptrdiff_t to_next = 0;  // bytes to the same block of the frame that will be read next; 0: none
};

// Integer weights of the groups of a block, two groups per word: those of part parts[p] begin at pairs + p·stride, in
// units of units[parts[p]]. Folded, the first `even` apply to the sums of groups and their mirror images, the others to
// the differences.
struct ByteWeights {
  int row_group;
  const std::int32_t* pairs;
  std::size_t stride;
  std::span<const std::size_t> parts;
  std::size_t even;
  std::span<const double> units;

  // Factor of the sums of part p: its unit in the last block of a pass, else 1.
  [[nodiscard]] double unit(std::size_t p, bool last) const { return last ? units[p] : 1; }
};

// Max rows per 32-bit sum: 255·kRowsPerChunk·kMaxWeight < 2^31. Fewer rows allow larger weights:
// 255·row_group·Σ|weight| <= kMaxSum.
inline constexpr std::size_t kRowsPerChunk = 2048;
inline constexpr std::int32_t kMaxWeight = 4095, kMaxOfFewRows = 32767, kMaxSum = 2147483647;

void project_bytes(const ByteBlock& block, const ByteWeights& weights, const ProjectionSums& to);

// The same where rows are contiguous and columns `row_stride` apart: not folded, each row a group of its own. A block
// of fewer rows than kFewestAcross has as many before it.
inline constexpr std::size_t kFewestAcross = 64;
void project_across(const ByteBlock& block, const ByteWeights& weights, const ProjectionSums& to);

// Sums a block of bytes: reference for the time of reading a frame.
std::uint64_t read_bytes(const std::uint8_t* data, std::size_t size);

// The target of Highway whose code runs.
std::int64_t target();

}  // namespace ocisac::kernels
