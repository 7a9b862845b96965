#include "columns/row_kernels.hpp"

#include <algorithm>
#include <bit>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "columns/row_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/cache_control.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

#if HWY_TARGET != HWY_SCALAR

const hn::ScalableTag<std::uint8_t> d8;
using Bytes = hn::Vec<decltype(d8)>;

// The whole vectors of a row; returns how many bytes. The last sample read belongs to the row.
template <class Load>
HWY_INLINE std::size_t take_vectors(const std::uint8_t* from, std::size_t step, std::size_t count, std::uint8_t* to,
                                    Load load) {
  const std::size_t lanes = hn::Lanes(d8);
  std::size_t c = 0;
  for (; c + lanes < count; c += lanes) {
    Bytes first, second, third, fourth;
    load(from + c * step, first, second, third, fourth);
    hn::StoreU(first, d8, to + c);
  }
  return c;
}

HWY_INLINE std::size_t take_vectors(const std::uint8_t* from, std::size_t step, std::size_t count, std::uint8_t* to) {
  switch (step) {
    case 2:
      return take_vectors(from, step, count, to, [](const std::uint8_t* p, Bytes& a, Bytes& b, Bytes&, Bytes&) {
        hn::LoadInterleaved2(d8, p, a, b);
      });
    case 3:
      return take_vectors(from, step, count, to, [](const std::uint8_t* p, Bytes& a, Bytes& b, Bytes& c, Bytes&) {
        hn::LoadInterleaved3(d8, p, a, b, c);
      });
    case 4:
      return take_vectors(from, step, count, to, [](const std::uint8_t* p, Bytes& a, Bytes& b, Bytes& c, Bytes& d) {
        hn::LoadInterleaved4(d8, p, a, b, c, d);
      });
    default: return 0;
  }
}

constexpr std::ptrdiff_t kAhead = 128;  // bytes that are asked for
constexpr std::size_t kTile = 16;       // bytes of a block of a vector: columns of a tile

// Sixteen columns of as many rows as a vector has bytes: four rounds of interleaving transpose each block.
HWY_INLINE void transpose_tile(const std::uint8_t* from, std::ptrdiff_t stride, std::uint8_t* to, std::size_t columns) {
  Bytes a[kTile], b[kTile];
  for (std::size_t c = 0; c < kTile; ++c) a[c] = hn::LoadU(d8, from + static_cast<std::ptrdiff_t>(c) * stride);
  for (int round = 0; round < 2; ++round) {
    for (std::size_t i = 0; i < kTile / 2; ++i) {
      b[2 * i] = hn::InterleaveLower(d8, a[i], a[i + kTile / 2]);
      b[2 * i + 1] = hn::InterleaveUpper(d8, a[i], a[i + kTile / 2]);
    }
    for (std::size_t i = 0; i < kTile / 2; ++i) {
      a[2 * i] = hn::InterleaveLower(d8, b[i], b[i + kTile / 2]);
      a[2 * i + 1] = hn::InterleaveUpper(d8, b[i], b[i + kTile / 2]);
    }
  }
  alignas(64) std::uint8_t row[hn::MaxLanes(d8)];
  const hn::Full128<std::uint8_t> d_block;
  for (std::size_t r = 0; r < kTile; ++r) {
    hn::Store(a[r], d8, row);
    for (std::size_t block = 0; block < hn::Lanes(d8) / kTile; ++block)
      hn::StoreU(hn::Load(d_block, row + block * kTile), d_block, to + (block * kTile + r) * columns);
  }
}

#endif

void TakeEvery(const std::uint8_t* from, std::size_t step, std::size_t count, std::uint8_t* to) {
  std::size_t c = 0;
#if HWY_TARGET != HWY_SCALAR
  c = take_vectors(from, step, count, to);
#endif
  for (; c < count; ++c) to[c] = from[c * step];
}

void TransposeBytes(const std::uint8_t* from, std::ptrdiff_t stride, std::size_t rows, std::size_t columns,
                    std::uint8_t* to) {
#if HWY_TARGET != HWY_SCALAR
  const std::size_t lanes = hn::Lanes(d8);
  if (rows >= lanes && columns >= kTile) {  // the last tiles overlap others instead of being cut
    for (std::size_t r = 0; r < rows; r += lanes)
      for (std::size_t c = 0; c < columns; c += kTile) {
        const std::size_t row = std::min(r, rows - lanes), column = std::min(c, columns - kTile);
        const std::uint8_t* tile = from + static_cast<std::ptrdiff_t>(column) * stride + row;
        for (std::size_t i = 0; i < kTile; ++i) hwy::Prefetch(tile + static_cast<std::ptrdiff_t>(i) * stride + kAhead);
        transpose_tile(tile, stride, to + row * columns + column, columns);
      }
    return;
  }
#endif
  for (std::size_t r = 0; r < rows; ++r)
    for (std::size_t c = 0; c < columns; ++c)
      to[r * columns + c] = from[static_cast<std::ptrdiff_t>(c) * stride + static_cast<std::ptrdiff_t>(r)];
}

struct RunSum {
  std::uint32_t sum = 0, reaching = 0;
};

HWY_INLINE RunSum sum_singly(const std::uint8_t* run, std::size_t count, unsigned level) {
  RunSum of{};
  for (std::size_t i = 0; i < count; ++i) {
    of.sum += run[i];
    of.reaching += run[i] >= level;
  }
  return of;
}

#if HWY_TARGET != HWY_SCALAR

// Short vectors: runs of a frame's 64th part are.
const hn::CappedTag<std::uint8_t, 32> d_run;

// The same by vectors, of which the last may be read beyond the run. `kCount`: how many reach the level is asked for.
template <bool kCount>
HWY_INLINE RunSum sum_vectors(const std::uint8_t* run, std::size_t count, unsigned level) {
  const hn::Repartition<std::uint64_t, decltype(d_run)> d_sum;
  const std::size_t lanes = hn::Lanes(d_run);
  const auto least = hn::Set(d_run, static_cast<std::uint8_t>(level));
  auto sum = hn::Zero(d_sum);
  std::size_t reaching = 0;
  for (std::size_t i = 0; i < count; i += lanes) {
    const auto own = hn::FirstN(d_run, std::min(count - i, lanes));
    const auto bytes = hn::IfThenElseZero(own, hn::LoadU(d_run, run + i));
    sum = hn::Add(sum, hn::SumsOf8(bytes));
    if (kCount) reaching += hn::CountTrue(d_run, hn::And(own, hn::Eq(hn::Max(bytes, least), bytes)));
  }
  return {static_cast<std::uint32_t>(hn::GetLane(hn::SumOfLanes(d_sum, sum))), static_cast<std::uint32_t>(reaching)};
}

#endif

template <bool kCount>
void sum_all_runs(const std::uint8_t* row, std::size_t columns, std::size_t width, unsigned level, std::uint32_t* sums,
                  std::uint32_t* reaching) {
  const auto put = [&](const RunSum& of) {
    *sums++ = of.sum;
    *reaching++ = of.reaching;
  };
  std::size_t first = 0;
#if HWY_TARGET != HWY_SCALAR
  for (; first + width + hn::Lanes(d_run) <= columns; first += width)
    put(sum_vectors<kCount>(row + first, width, level));
#endif
  for (; first < columns; first += width) put(sum_singly(row + first, std::min(width, columns - first), level));
}

void SumRuns(const std::uint8_t* row, std::size_t columns, std::size_t width, unsigned level, std::uint32_t* sums,
             std::uint32_t* reaching) {
  const auto sum = level > 255 ? sum_all_runs<false> : sum_all_runs<true>;
  sum(row, columns, width, level, sums, reaching);
}

bool HasWideVectors() { return HWY_TARGET <= HWY_AVX3; }

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

#if HWY_ARCH_X86_64 && (HWY_COMPILER_GCC || HWY_COMPILER_CLANG)
#include <immintrin.h>
#define OCISAC_HAS_VBMI 1
#define OCISAC_PROCESSOR_HAS(feature) static_cast<bool>(__builtin_cpu_supports(feature))
#else
#define OCISAC_PROCESSOR_HAS(feature) false
#endif

namespace ocisac::kernels {

HWY_EXPORT(TakeEvery);
HWY_EXPORT(TransposeBytes);
HWY_EXPORT(SumRuns);
HWY_EXPORT(HasWideVectors);

bool has_wide_vectors() { return HWY_DYNAMIC_DISPATCH(HasWideVectors)(); }

bool strips_come_late() {
#if HWY_ARCH_X86_64 && (HWY_COMPILER_GCC || HWY_COMPILER_CLANG)
  static const bool late = __builtin_cpu_is("amdfam19h");
  return late;
#else
  return false;
#endif
}

void take_every(const std::uint8_t* from, std::size_t step, std::size_t count, std::uint8_t* to) {
  HWY_DYNAMIC_DISPATCH(TakeEvery)(from, step, count, to);
}

void transpose_bytes(const std::uint8_t* from, std::ptrdiff_t stride, std::size_t rows, std::size_t columns,
                     std::uint8_t* to) {
  HWY_DYNAMIC_DISPATCH(TransposeBytes)(from, stride, rows, columns, to);
}

void sum_runs(const std::uint8_t* row, std::size_t columns, std::size_t width, unsigned level, std::uint32_t* sums,
              std::uint32_t* reaching) {
  HWY_DYNAMIC_DISPATCH(SumRuns)(row, columns, width, level, sums, reaching);
}

ByteTable::ByteTable(std::span<const float> light) : light_(light.data()) {
  for (std::size_t value = 0; value < kValues; ++value) {
    const auto bytes = std::bit_cast<std::array<std::uint8_t, sizeof(float)> >(light[value]);
    for (std::size_t i = 0; i < sizeof(float); ++i) planes_[i * kValues + value] = bytes[i];
  }
}

namespace {

// Columns from `first` on.
template <class T>
void look_up_singly(const StoredRows<T>& from, std::size_t first, const float* HWY_RESTRICT light,
                    float* HWY_RESTRICT to) {
  constexpr std::size_t kInLine = kLine / sizeof(T);
  for (std::size_t r = 0; r < from.rows; ++r, to += from.columns) {
    const T* HWY_RESTRICT row = from.samples + static_cast<std::ptrdiff_t>(r) * from.stride;
    std::size_t c = first;
    for (; c + kInLine <= from.columns; c += kInLine) {
      ask_early_for(row + static_cast<std::ptrdiff_t>(c) + from.to_next);
      for (std::size_t i = 0; i < kInLine; ++i) to[c + i] = light[row[c + i]];
    }
    for (; c < from.columns; ++c) to[c] = light[row[c]];
  }
}

#if OCISAC_HAS_VBMI

// The whole vectors of rows by AVX-512 VBMI, whose shuffles look up 128 bytes; returns how many columns.
__attribute__((target("avx512f,avx512bw,avx512vbmi"))) std::size_t look_up_vectors(const StoredRows<std::uint8_t>& from,
                                                                                   const ByteTable& table, float* to) {
  constexpr std::size_t kPlanes = sizeof(float);
  __m512i quarters[kPlanes][4];
  for (std::size_t i = 0; i < kPlanes; ++i)
    for (std::size_t q = 0; q < 4; ++q) quarters[i][q] = _mm512_load_si512(table.plane(i) + q * kLine);
  // Interleaving keeps blocks of 16 bytes apart: dwords in this order come out in that of the columns.
  const __m512i order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
  const std::size_t whole = from.columns / kLine * kLine;
  for (std::size_t r = 0; r < from.rows; ++r, to += from.columns) {
    const std::uint8_t* row = from.samples + static_cast<std::ptrdiff_t>(r) * from.stride;
    for (std::size_t c = 0; c < whole; c += kLine) {
      ask_early_for(row + static_cast<std::ptrdiff_t>(c) + from.to_next);
      const __m512i values = _mm512_permutexvar_epi32(order, _mm512_loadu_si512(row + c));
      const __mmask64 upper = _mm512_movepi8_mask(values);
      __m512i plane[kPlanes];
      for (std::size_t i = 0; i < kPlanes; ++i)
        plane[i] = _mm512_mask_blend_epi8(upper, _mm512_permutex2var_epi8(quarters[i][0], values, quarters[i][1]),
                                          _mm512_permutex2var_epi8(quarters[i][2], values, quarters[i][3]));
      const __m512i low[] = {_mm512_unpacklo_epi8(plane[0], plane[1]), _mm512_unpackhi_epi8(plane[0], plane[1])};
      const __m512i high[] = {_mm512_unpacklo_epi8(plane[2], plane[3]), _mm512_unpackhi_epi8(plane[2], plane[3])};
      for (std::size_t half = 0; half < 2; ++half) {
        _mm512_storeu_si512(to + c + 32 * half, _mm512_unpacklo_epi16(low[half], high[half]));
        _mm512_storeu_si512(to + c + 32 * half + 16, _mm512_unpackhi_epi16(low[half], high[half]));
      }
    }
  }
  return whole;
}

bool has_vbmi() {
  static const bool processor_has = OCISAC_PROCESSOR_HAS("avx512vbmi") && OCISAC_PROCESSOR_HAS("avx512bw");
  return processor_has && has_wide_vectors();
}

#else

std::size_t look_up_vectors(const StoredRows<std::uint8_t>&, const ByteTable&, float*) { return 0; }
bool has_vbmi() { return false; }

#endif

}  // namespace

void look_up(const StoredRows<std::uint8_t>& from, const ByteTable& table, float* to) {
  look_up_singly(from, has_vbmi() ? look_up_vectors(from, table, to) : 0, table.light(), to);
}

void look_up(const StoredRows<std::uint16_t>& from, const float* table, float* to) {
  look_up_singly(from, 0, table, to);
}

}  // namespace ocisac::kernels
#endif
