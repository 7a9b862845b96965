// Inner loops of project(), compiled once for each SIMD target: over bytes in integers, and in float64 over other
// samples and the light of bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <variant>

namespace ocisac::kernels {

// Accumulators of the blocks (the maximum: running maximum): sums (parts or outputs × columns, `stride` apart), moments
// (columns,) each. The first block of bytes of a pass overwrites them; the last one multiplies the sums, integers so
// far, by their units.
struct ProjectionSums {
  double* sums;
  std::size_t stride;
  double *totals, *squares, *maximum;
  bool first = false, last = false;
};

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

// As ByteBlock; folded for two outputs if one applies to sums and one to differences, and for more.
template <class T>
struct SampleBlock {
  const T* pixels;
  const T* mirrored;
  std::ptrdiff_t row_stride;
  std::size_t groups;  // at most kSampleRows rows, the mirrored ones included
  std::size_t columns;
  std::ptrdiff_t to_next;         // from the block to the one that will be read next; 0: samples are in the cache
  const double* light = nullptr;  // of bytes: that of each value
};

using AnySampleBlock =
    std::variant<SampleBlock<std::uint8_t>, SampleBlock<std::uint16_t>, SampleBlock<float>, SampleBlock<double>>;

inline constexpr std::size_t kSampleRows = 32;

// Weights of output o begin at values + o·stride. order: all outputs; folded, the first `even` apply to sums, the
// others to differences.
struct SampleWeights {
  int row_group;
  const double* values;
  std::size_t stride;
  std::span<const std::size_t> order;
  std::size_t even;
};

// As project_bytes().
void project_samples(const AnySampleBlock& block, const SampleWeights& weights, const ProjectionSums& to);

// True if the target whose code runs is faster with the light of bytes than with a copy of it.
bool takes_light_of_bytes();

}  // namespace ocisac::kernels
