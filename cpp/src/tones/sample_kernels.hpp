// Inner loops of project() in float64, over other samples and over the light of bytes, compiled once for each SIMD
// target.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <variant>

#include "tones/projection_sums.hpp"

namespace ocisac::kernels {

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
