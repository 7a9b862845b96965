// Dense rows of samples from what is stored otherwise, compiled once for each SIMD target.
#pragma once

#include <hwy/cache_control.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <variant>

namespace ocisac::kernels {

inline constexpr std::size_t kLine = 64;  // bytes of a cache line

// Every `step`-th byte, `count` of them, the first at `from`: one colour of interleaved ones, the luma of YUYV.
void take_every(const std::uint8_t* from, std::size_t step, std::size_t count, std::uint8_t* to);

// Rows of bytes whose columns are contiguous, `stride` apart: to[r·columns + c] = from[c·stride + r].
void transpose_bytes(const std::uint8_t* from, std::ptrdiff_t stride, std::size_t rows, std::size_t columns,
                     std::uint8_t* to);

// Runs of `width` contiguous bytes that cover a row, the last one cut: their sums, and how many reach `level` (256:
// none).
void sum_runs(const std::uint8_t* row, std::size_t columns, std::size_t width, unsigned level, std::uint32_t* sums,
              std::uint32_t* reaching);

// A table of the light of bytes; beside it the same by planes, byte i of each float, for look-up in registers.
class ByteTable {
 public:
  explicit ByteTable(std::span<const float> light);
  [[nodiscard]] const float* light() const { return light_; }
  [[nodiscard]] const std::uint8_t* plane(std::size_t i) const { return planes_.data() + i * kValues; }

 private:
  static constexpr std::size_t kValues = 256;
  const float* light_;
  alignas(64) std::array<std::uint8_t, sizeof(float) * kValues> planes_;
};

// Rows of samples, `stride` apart, and the offset from each to those that are asked for meanwhile.
template <class T>
struct StoredRows {
  const T* samples;
  std::ptrdiff_t stride;
  std::ptrdiff_t to_next;
  std::size_t rows, columns;
};

// The light of samples by a table of all values, dense.
void look_up(const StoredRows<std::uint8_t>& from, const ByteTable& table, float* to);
void look_up(const StoredRows<std::uint16_t>& from, const float* table, float* to);

using AnyStoredRows =
    std::variant<StoredRows<std::uint8_t>, StoredRows<std::uint16_t>, StoredRows<float>, StoredRows<double>>;

// (rows) Σ weight·sample over the columns, in float64 with the same rounding on every target: eight sums of every
// eighth column, then these in order, then the columns that are left.
void pool_rows(const AnyStoredRows& from, const double* weights, double* to);

// Prefetches a line of what is read much later, when the first-level cache holds other lines, into the second-level
// one.
#if HWY_COMPILER_GCC || HWY_COMPILER_CLANG
HWY_INLINE void ask_early_for(const void* line) { __builtin_prefetch(line, 0, 2); }
#else
HWY_INLINE void ask_early_for(const void* line) { hwy::Prefetch(static_cast<const std::uint8_t*>(line)); }
#endif

// True if the vectors of the target whose code runs are as wide as a cache line.
bool has_wide_vectors();

// True on Zen 3 and 4, of which Zen 4 has wide vectors: lines of rows far apart arrive later than lines in a row,
// however early they are asked for (bench/README.md).
bool strips_come_late();

}  // namespace ocisac::kernels
