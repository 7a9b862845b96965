#include <algorithm>
#include <array>
#include <bit>
#include <memory>
#include <numeric>
#include <span>
#include <vector>

#include "core/aligned_memory.hpp"
#include "core/recently_used.hpp"
#include "tones/projection_kernels.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tones/byte_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include "tones/projection_kernels-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// Rows per block: few enough for the second-level cache to hold them and the next ones, enough to amortise the transfer
// of the sums to the first-level cache; larger where there are more sums than those of one tone.
constexpr std::size_t kRowsPerBlock = kWide ? 64 : 48;

#if HWY_TARGET == HWY_SCALAR

// Targets without vectors take bytes as other samples.
void ProjectBytes(const ByteBlock&, const ByteWeights&, const ProjectionSums&) {}
void ProjectAcross(const ByteBlock&, const ByteWeights&, const ProjectionSums&) {}

#else

const hn::ScalableTag<std::uint16_t> d16;
const hn::ScalableTag<std::int16_t> d16s;
const hn::ScalableTag<std::int32_t> d32;
using Sum16 = hn::Vec<decltype(d16)>;
using Pair16 = hn::Vec<decltype(d16s)>;
using Sum32 = hn::Vec<decltype(d32)>;

// sum + a₀·b₀ + a₁·b₁ in every 32-bit lane, whose halves are (a₀, a₁) and (b₀, b₁).
HWY_INLINE Sum32 multiply_pairs(Sum32 sum, Pair16 a, Pair16 b) {
#if (HWY_ARCH_X86 && HWY_TARGET != HWY_EMU128) || HWY_TARGET == HWY_WASM
  Sum32 unused = hn::Zero(d32);
  return hn::ReorderWidenMulAccumulate(d32, a, b, sum, unused);  // vpmaddwd and i32x4.dot_i16x8_s keep this order
#else
  const Sum32 x = hn::BitCast(d32, a);
  const Sum32 y = hn::BitCast(d32, b);
  const auto low = [](Sum32 v) { return hn::ShiftRight<16>(hn::ShiftLeft<16>(v)); };
  const auto high = [](Sum32 v) { return hn::ShiftRight<16>(v); };
  return hn::Add(sum, hn::Add(hn::Mul(low(x), low(y)), hn::Mul(high(x), high(y))));
#endif
}

// The weights of a pair of groups. Narrow vectors multiply by them from memory, where all lanes have them, which saves
// an instruction and a register for each.
constexpr std::size_t kWeightLanes = kWide ? 1 : hn::MaxLanes(d32);
struct alignas(kWeightLanes * sizeof(std::int32_t)) PairWeights {
  std::array<std::int32_t, kWeightLanes> lanes;
};
constexpr PairWeights kOnes = [] {
  PairWeights ones{};
  ones.lanes.fill(0x10001);
  return ones;
}();

// By assembly with AVX2: GCC loads weights of several uses into a register, and spills sums (a pass takes 12 % longer).
HWY_INLINE Sum32 multiply_pairs(Sum32 sum, Pair16 a, const PairWeights& b) {
#if HWY_TARGET == HWY_AVX2 && (HWY_COMPILER_GCC || HWY_COMPILER_CLANG)
  Sum32 product;
  asm("vpmaddwd %2, %1, %0" : "=x"(product.raw) : "x"(a.raw), "m"(b));
  return hn::Add(sum, product);
#else
  const Sum32 weights = kWide ? hn::Set(d32, b.lanes[0]) : hn::Load(d32, b.lanes.data());
  return multiply_pairs(sum, a, hn::BitCast(d16s, weights));
#endif
}

// A strip of columns is as wide as a vector of bytes.
constexpr std::size_t kVectors = 4;  // 32-bit sums per strip
const hn::ScalableTag<std::uint8_t> d8;
using Bytes = hn::Vec<decltype(d8)>;
constexpr auto kWidth = static_cast<std::ptrdiff_t>(hn::MaxLanes(d8));

// a₀ + a₁ and a₀ − a₁ in every 16-bit lane, whose bytes are (a₀, a₁).
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_SSSE3

const hn::ScalableTag<std::int8_t> d8s;

// vpmaddubsw
HWY_INLINE Pair16 multiply_neighbours(Bytes a, hn::Vec<decltype(d8s)> b) {
#if HWY_TARGET <= HWY_AVX3
  return Pair16{_mm512_maddubs_epi16(a.raw, b.raw)};
#elif HWY_TARGET == HWY_AVX2
  return Pair16{_mm256_maddubs_epi16(a.raw, b.raw)};
#else
  return Pair16{_mm_maddubs_epi16(a.raw, b.raw)};
#endif
}

HWY_INLINE Pair16 sum_of_neighbours(Bytes a) { return multiply_neighbours(a, hn::Set(d8s, 1)); }
HWY_INLINE Pair16 difference_of_neighbours(Bytes a) {
  return multiply_neighbours(a, hn::BitCast(d8s, hn::Set(d16, 0xff01)));  // 1 and -1
}

#else

HWY_INLINE Sum16 first_of_neighbours(Bytes a) { return hn::And(hn::BitCast(d16, a), hn::Set(d16, 255)); }
HWY_INLINE Sum16 second_of_neighbours(Bytes a) { return hn::ShiftRight<8>(hn::BitCast(d16, a)); }
HWY_INLINE Pair16 sum_of_neighbours(Bytes a) {
  return hn::BitCast(d16s, hn::Add(first_of_neighbours(a), second_of_neighbours(a)));
}
HWY_INLINE Pair16 difference_of_neighbours(Bytes a) {
  return hn::BitCast(d16s, hn::Sub(first_of_neighbours(a), second_of_neighbours(a)));
}

#endif

// Rows are prefetched in one of two ways (figures: bench/README.md):
//
// * In runs of lines, in memory order, one or two blocks ahead: the hardware prefetchers of Zen 3 and 4 do not follow
//   strip by strip. Wide vectors: into the second-level cache. On these processors each row then prefetches its own
//   lines of strips ahead again, because they drop prefetches while too many lines are pending.
// * Wide vectors, on other processors: every row prefetches its own lines of strips ahead, each line four times.
//
// Numbers of strips ahead. Narrow vectors: a strip of single rows takes longer than one of groups, so five are as far
// ahead as six.
template <int kGroup>
constexpr std::size_t kAheadAfterRuns[] = {kWide ? 2 : (kGroup == 1 ? 5 : 6), 4};
constexpr std::size_t kAheadAlone[] = {2, 1, 5, 3};
constexpr std::size_t kLinesAfterRuns = kWide ? 2 : 1, kLinesAlone = std::size(kAheadAlone);

bool asks_for_runs(const ByteBlock& block) { return !block.cached && (!kWide || strips_come_late()); }

// Lines of a run prefetched with every pair of groups, on either side.
template <int kGroup>
constexpr std::size_t kLinesPerPair = std::max<std::size_t>(2 * kGroup * hn::MaxLanes(d8) / kLine, 1);

// Runs of `bytes` that cover a block of rows.
struct RunsOfBlock {
  std::size_t bytes, rows;
  std::ptrdiff_t row_stride;
  std::size_t columns, count;
  bool operator==(const RunsOfBlock&) const = default;
};

using Offsets = std::vector<std::ptrdiff_t>;

// Their offsets from the block's lowest row, the lowest first, the last repeated.
std::shared_ptr<const Offsets> offsets_of(const RunsOfBlock& of) {
  static RecentlyUsed<RunsOfBlock, Offsets, 8> kept;  // frames of one camera need the same
  return kept.get(of, [&of] {
    const auto apart = static_cast<std::size_t>(std::abs(of.row_stride));
    const bool dense = apart == of.columns;
    const std::size_t rows = dense ? 1 : of.rows, columns = dense ? of.columns * of.rows : of.columns;
    auto runs = std::make_shared<Offsets>();
    runs->reserve(of.count);
    for (std::size_t row = 0; row < rows; ++row)
      for (std::size_t c = 0; c < columns && runs->size() < of.count; c += of.bytes)
        runs->push_back(static_cast<std::ptrdiff_t>(row * apart + std::min(c, columns - std::min(columns, of.bytes))));
    runs->resize(of.count, runs->back());
    return runs;
  });
}

// The lowest run of the rows to prefetch and the highest of their mirror images, and the next run's distance from both,
// or kNoRun: with narrow vectors the first line over and over, which costs less than a comparison for each pair.
struct RowsAhead {
  const std::uint8_t *near, *far;
  const std::ptrdiff_t* run;
};

constexpr std::array<std::ptrdiff_t, kRowsPerBlock> kFirstLine{};
constexpr const std::ptrdiff_t* kNoRun = kWide ? nullptr : kFirstLine.data();

template <int kGroup, bool kNear, bool kFar>
HWY_INLINE void ask_for_run(const RowsAhead& ahead, std::size_t pair) {
  if (kWide && ahead.run == kNoRun) return;
  if (kNear) ask_for<kLinesPerPair<kGroup>, kWide>(ahead.near + ahead.run[pair]);
  if (kFar) ask_for<kLinesPerPair<kGroup>, kWide>(ahead.far - ahead.run[pair]);
}

// Offsets from a row of a strip to the lines it prefetches.
template <std::size_t kLines>
using LinesAhead = std::array<std::ptrdiff_t, kLines>;

// A strip is processed in slices; a slice is as large as registers allow for all sums of one tone.
constexpr std::size_t kSlices = kWide ? 1 : 2, kPerSlice = kVectors / kSlices;
constexpr std::size_t kUpperHalf = kPerSlice - 2;  // of a slice, its first vector

// Two groups of rows of a slice of a strip side by side in 32-bit lanes: as they are, or the sums with their mirror
// images and the differences. Lane i of block b (of 128 bits) of vector v is column 16·b + 4·v + i of the strip, v
// counted through all slices.
struct Pairs {
  HWY_INLINE Pairs() {}  // the implicit one is not for the target: GCC for Arm refuses to inline the vectors' own
  Pair16 sums[kPerSlice];
  Pair16 differences[kPerSlice];
};

// Positions of a strip's rows: from the block's first on and, mirrored, from its last group on backwards (unused if not
// folded).
template <std::size_t kLines>
struct Rows {
  const std::uint8_t* near;
  const std::uint8_t* far;
  std::ptrdiff_t stride;
  LinesAhead<kLines> near_ahead{}, far_ahead{};

  template <bool kFold>
  HWY_INLINE void advance(std::ptrdiff_t count) {
    near += count * stride;
    if (kFold) far -= count * stride;
  }
};

template <class Ahead>
HWY_INLINE void ask_for_lines(const std::uint8_t* pixels, const Ahead& ahead) {
  for (const std::ptrdiff_t line : ahead) hwy::Prefetch(pixels + line);
}

// Loads a row of a strip and updates the maximum.
HWY_INLINE Bytes load_row(const std::uint8_t* HWY_RESTRICT pixels, Bytes& maximum) {
  Bytes row = hn::LoadU(d8, pixels);
#if HWY_TARGET <= HWY_AVX3 && (HWY_COMPILER_GCC || HWY_COMPILER_CLANG)
  asm("" : "+v"(row.raw));  // keeps the row in a register instead of a load per use (four tones: 105 instead of 95 µs)
#endif
  maximum = hn::Max(maximum, row);
  return row;
}

// The lower or the upper halves of the blocks, side by side.
template <bool kUpper, class D, class V>
HWY_INLINE V interleave(D d, V a, V b) {
  return kUpper ? hn::InterleaveUpper(d, a, b) : hn::InterleaveLower(d, a, b);
}

// Half of a strip's pairs of single rows, of the lower or the upper halves of the blocks: a row and its mirror image as
// neighbouring bytes, for sums and differences.
template <bool kFold, bool kUpper>
HWY_INLINE void pair_rows(const Bytes (&near)[2], const Bytes (&far)[2], Pair16* sums, Pair16* differences) {
  const Pair16 a = hn::BitCast(d16s, interleave<kUpper>(d8, near[0], far[0]));
  const Pair16 b = hn::BitCast(d16s, interleave<kUpper>(d8, near[1], far[1]));
  const Pair16 pairs[] = {hn::InterleaveLower(d16s, a, b), hn::InterleaveUpper(d16s, a, b)};
  for_each_constant<2>([&](auto i) OCISAC_INLINE_LAMBDA {
    sums[i] = kFold ? sum_of_neighbours(hn::BitCast(d8, pairs[i])) : pairs[i];
    if (kFold) differences[i] = difference_of_neighbours(hn::BitCast(d8, pairs[i]));
  });
}

// Two single rows and, folded, their mirror images. The maximum is updated with the first slice only, and each of two
// slices prefetches the lines of half of the rows: all with the first are more at once than memory serves.
template <bool kFold, std::size_t kSlice, std::size_t kLines>
HWY_INLINE void load_rows(const Rows<kLines>& rows, Bytes& top, Pairs& to) {
  const auto load = [&top](const std::uint8_t* row) { return kSlice == 0 ? load_row(row, top) : hn::LoadU(d8, row); };
  const auto near = [&](std::ptrdiff_t row) {
    if (kSlice == 0) ask_for_lines(rows.near + row, rows.near_ahead);
    return load(rows.near + row);
  };
  const auto far = [&](std::ptrdiff_t row) {
    if (kSlice + 1 == kSlices) ask_for_lines(rows.far - row, rows.far_ahead);
    return load(rows.far - row);
  };
  const Bytes none = hn::Zero(d8);
  const Bytes two[] = {near(0), near(rows.stride)};
  const Bytes mirrored[] = {kFold ? far(0) : none, kFold ? far(rows.stride) : none};
  if (kSlice == 0) pair_rows<kFold, false>(two, mirrored, to.sums, to.differences);
  if (kSlice + 1 == kSlices) pair_rows<kFold, true>(two, mirrored, to.sums + kUpperHalf, to.differences + kUpperHalf);
}

// Sums of a group of rows, for the columns in the lower and in the upper halves of a vector's blocks.
struct GroupSum {
  Pair16 lower, upper;
};

template <int kGroup, class Ahead>
HWY_INLINE GroupSum sum_of_group(const std::uint8_t* HWY_RESTRICT pixels, std::ptrdiff_t stride, const Ahead& ahead,
                                 Bytes& maximum) {
  GroupSum sum{hn::Zero(d16s), hn::Zero(d16s)};
  for (int i = 0; i < kGroup; i += 2, pixels += 2 * stride) {
    ask_for_lines(pixels, ahead);
    const Bytes a = load_row(pixels, maximum);
    ask_for_lines(pixels + stride, ahead);
    const Bytes b = load_row(pixels + stride, maximum);
    sum.lower = hn::Add(sum.lower, sum_of_neighbours(hn::InterleaveLower(d8, a, b)));
    sum.upper = hn::Add(sum.upper, sum_of_neighbours(hn::InterleaveUpper(d8, a, b)));
  }
  return sum;
}

HWY_INLINE void interleave_groups(const GroupSum& a, const GroupSum& b, Pair16* lower, Pair16* upper) {
  lower[0] = hn::InterleaveLower(d16s, a.lower, b.lower);
  lower[1] = hn::InterleaveUpper(d16s, a.lower, b.lower);
  upper[0] = hn::InterleaveLower(d16s, a.upper, b.upper);
  upper[1] = hn::InterleaveUpper(d16s, a.upper, b.upper);
}

// Two groups of rows and, folded, their mirror images, for a whole strip, whose last slice may be its first.
template <int kGroup, bool kFold, std::size_t kLines>
HWY_INLINE void load_groups(const Rows<kLines>& rows, Bytes& top, Pairs& first, Pairs& last) {
  const std::ptrdiff_t second = kGroup * rows.stride;
  const GroupSum none{hn::Zero(d16s), hn::Zero(d16s)};
  const auto near = [&](const std::uint8_t* at) { return sum_of_group<kGroup>(at, rows.stride, rows.near_ahead, top); };
  const auto far = [&](const std::uint8_t* at) { return sum_of_group<kGroup>(at, rows.stride, rows.far_ahead, top); };
  const GroupSum a = near(rows.near);
  const GroupSum c = kFold ? far(rows.far) : none;
  const GroupSum b = near(rows.near + second);
  const GroupSum d = kFold ? far(rows.far - second) : none;
  interleave_groups({hn::Add(a.lower, c.lower), hn::Add(a.upper, c.upper)},
                    {hn::Add(b.lower, d.lower), hn::Add(b.upper, d.upper)}, first.sums, last.sums + kUpperHalf);
  if constexpr (!kFold) return;
  interleave_groups({hn::Sub(a.lower, c.lower), hn::Sub(a.upper, c.upper)},
                    {hn::Sub(b.lower, d.lower), hn::Sub(b.upper, d.upper)}, first.differences,
                    last.differences + kUpperHalf);
}

// Strips of a vector's width that cover the columns; neighbours overlap instead of being cut. Where rows are a whole
// number of vectors apart, all but the first lie on vectors' boundaries: loads across two lines of a cache take up to
// 8 % of the time. With less arithmetic, where four rows or more are added, narrow ones lie half a vector beside them
// instead: what the loads touch of the next line brings it near in time (frames from memory: 10 %).
class StripGrid {
 public:
  StripGrid(const ByteBlock& block, int row_group) : columns_(static_cast<std::ptrdiff_t>(block.columns)) {
    if (columns_ < kWidth) return;
    const std::intptr_t beside = kWide || row_group < 4 ? 0 : kWidth / 2;
    if (block.row_stride % kWidth == 0) before_ = (reinterpret_cast<std::intptr_t>(block.pixels) + beside) % kWidth;
    count_ = static_cast<std::size_t>((columns_ + before_ + kWidth - 1) / kWidth);
  }

  [[nodiscard]] std::size_t count() const { return count_; }
  // First column of strip i.
  [[nodiscard]] HWY_INLINE std::ptrdiff_t first(std::size_t i) const {
    const std::ptrdiff_t wanted = static_cast<std::ptrdiff_t>(i) * kWidth - before_;
    return std::max<std::ptrdiff_t>(std::min(wanted, columns_ - kWidth), 0);
  }
  // Offset from strip i, in near and in mirrored rows, to the one `ahead` of it; after the last strip, to those of the
  // rows `next_rows` further on.
  struct Step {
    std::ptrdiff_t near, far;
  };
  [[nodiscard]] HWY_INLINE Step step(std::size_t i, std::size_t ahead, std::ptrdiff_t next_rows) const {
    const bool is_next = i + ahead >= count_;
    const std::size_t to = is_next ? std::min(i + ahead - count_, count_ - 1) : i + ahead;
    const std::ptrdiff_t columns = first(to) - first(i), rows = is_next ? next_rows : 0;
    return {columns + rows, columns - rows};
  }
  // Columns before the next strip.
  [[nodiscard]] std::size_t own_columns(std::size_t i) const {
    return static_cast<std::size_t>((i + 1 < count_ ? first(i + 1) : columns_) - first(i));
  }

 private:
  std::ptrdiff_t columns_;
  std::ptrdiff_t before_ = 0;  // columns of the first strip that would lie before the block
  std::size_t count_ = 1;
};

// Accumulators of a strip: kVectors vectors per part, one part after the other, of the squares and of the totals.
struct Strip {
  std::int32_t *sums, *squares, *totals;
  std::uint8_t* maximum;
};

constexpr std::size_t kPerSum = kVectors * hn::MaxLanes(d32);

// Memory of a thread for this many numbers, reused from call to call.
std::int32_t* kept_memory(std::size_t size) {
  thread_local AlignedMemory<std::int32_t> memory;
  return memory.at_least(size);
}

// Accumulators of all strips, contiguous, because every block moves them to the first-level cache and back.
class Strips {
 public:
  Strips(const ByteBlock& block, const ByteWeights& weights)
      : grid(block, weights.row_group), parts_(weights.parts.size()), memory_(kept_memory(size())) {
    std::fill_n(memory_, size(), 0);
  }

  const StripGrid grid;
  double square_share = 1;  // that a sum of squares in a strip has in the column's

  [[nodiscard]] HWY_INLINE Strip at(std::size_t i) {
    std::int32_t* sums = memory_ + i * per_strip();
    std::int32_t *squares = sums + parts_ * kPerSum, *totals = squares + kPerSum;
    return {sums, squares, totals, reinterpret_cast<std::uint8_t*>(totals + kPerSum)};
  }
  [[nodiscard]] std::int32_t* spare() { return memory_ + grid.count() * per_strip(); }

 private:
  [[nodiscard]] std::size_t size() const { return grid.count() * per_strip() + kPerSum; }
  [[nodiscard]] std::size_t per_strip() const { return (parts_ + 2) * kPerSum + kPerSum / kVectors; }

  std::size_t parts_;
  std::int32_t* memory_;
};

// Accumulators of a slice's pairs: squares, totals and the outputs of one tone, the first of either kind (unfolded: the
// first two), which fit into the registers. For further outputs, the pairs are stored.
struct SliceOutputs {
  const std::array<PairWeights, 2>* weights;  // of the first output of either kind
  std::int32_t *first, *second, *squares, *totals;
  std::uint8_t* maximum;
  Pairs* keep;
};

// load(p, top, pairs) computes the p-th of `count` pairs of groups and updates the maximum.
template <bool kFold, bool kTone, bool kKeep, class Load>
HWY_INLINE void add_slice(std::size_t count, const SliceOutputs& to, Load load) {
  Sum32 a[kPerSlice], b[kPerSlice], square[kPerSlice], total[kPerSlice];
  for_each_constant<kPerSlice>([&](auto v) OCISAC_INLINE_LAMBDA {
    if (kTone) a[v] = hn::Load(d32, to.first + v * hn::Lanes(d32));
    if (kTone) b[v] = hn::Load(d32, to.second + v * hn::Lanes(d32));
    square[v] = hn::Load(d32, to.squares + v * hn::Lanes(d32));
    total[v] = hn::Load(d32, to.totals + v * hn::Lanes(d32));
  });
  Bytes top = hn::LoadU(d8, to.maximum);
#pragma GCC unroll 1  // otherwise the compiler reorders the additions and spills
  for (std::size_t p = 0; p < count; ++p) {
    Pairs pairs;
    load(p, top, pairs);
    for_each_constant<kPerSlice>([&](auto v) OCISAC_INLINE_LAMBDA {
      const Pair16 sum = pairs.sums[v], other = kFold ? pairs.differences[v] : sum;
      total[v] = multiply_pairs(total[v], sum, kOnes);
      if (kTone) a[v] = multiply_pairs(a[v], sum, to.weights[p][0]);
      if (kTone) b[v] = multiply_pairs(b[v], other, to.weights[p][1]);
      square[v] = multiply_pairs(square[v], sum, sum);
      if (kFold) square[v] = multiply_pairs(square[v], other, other);
      if (kKeep) to.keep[p].sums[v] = sum;
      if (kKeep && kFold) to.keep[p].differences[v] = other;
    });
  }
  hn::StoreU(top, d8, to.maximum);
  for_each_constant<kPerSlice>([&](auto v) OCISAC_INLINE_LAMBDA {
    if (kTone) hn::Store(a[v], d32, to.first + v * hn::Lanes(d32));
    if (kTone) hn::Store(b[v], d32, to.second + v * hn::Lanes(d32));
    hn::Store(square[v], d32, to.squares + v * hn::Lanes(d32));
    hn::Store(total[v], d32, to.totals + v * hn::Lanes(d32));
  });
}

// kOutputs outputs of one kind, for a slice.
template <std::size_t kOutputs, bool kDifferences>
HWY_INLINE void add_outputs(std::span<const Pairs> pairs, const std::int32_t* HWY_RESTRICT weights,
                            std::size_t weights_stride, std::int32_t* HWY_RESTRICT sums) {
  const std::size_t count = pairs.size();
  Sum32 out[kOutputs][kPerSlice];
  for (std::size_t o = 0; o < kOutputs; ++o)
    for (std::size_t v = 0; v < kPerSlice; ++v) out[o][v] = hn::Load(d32, sums + o * kPerSum + v * hn::Lanes(d32));
#pragma GCC unroll 1
  for (std::size_t p = 0; p < count; ++p)
    for (std::size_t o = 0; o < kOutputs; ++o) {
      const Pair16 weight = hn::BitCast(d16s, hn::Set(d32, weights[o * weights_stride + p]));
      for (std::size_t v = 0; v < kPerSlice; ++v)
        out[o][v] = multiply_pairs(out[o][v], kDifferences ? pairs[p].differences[v] : pairs[p].sums[v], weight);
    }
  for (std::size_t o = 0; o < kOutputs; ++o)
    for (std::size_t v = 0; v < kPerSlice; ++v) hn::Store(out[o][v], d32, sums + o * kPerSum + v * hn::Lanes(d32));
}

// All outputs of one kind, from part `first` up to `end`.
template <bool kDifferences>
HWY_INLINE void add_outputs_of_kind(std::span<const Pairs> pairs, const ByteWeights& weights, std::size_t first,
                                    std::size_t end, std::int32_t* sums) {
  const auto add = [&]<std::size_t kOutputs>() {
    add_outputs<kOutputs, kDifferences>(pairs, weights.pairs + first * weights.stride, weights.stride,
                                        sums + first * kPerSum);
  };
  for (; first + 4 <= end; first += 4) add.template operator()<4>();
  if (first + 3 == end) add.template operator()<3>();
  if (first + 2 == end) add.template operator()<2>();
  if (first + 1 == end) add.template operator()<1>();
}

// Pairs of groups of rows per block.
template <int kGroup, bool kFold>
constexpr std::size_t kPairsPerBlock = std::max<std::size_t>(kRowsPerBlock / ((kFold ? 4 : 2) * kGroup), 1);
// Data common to all strips of a block. A missing first output of a kind has weight 0 and is written to the spare.
struct BlockPlan {
  const ByteWeights& weights;
  std::size_t count;   // pairs of groups
  std::size_t second;  // the part where the second kind begins
  std::int32_t* spare;
  bool has_first, has_second;
  std::array<std::array<PairWeights, 2>, kRowsPerBlock / 2> first_weights;  // of the first output of either kind

  BlockPlan(const ByteWeights& of, std::size_t pairs, bool fold, std::int32_t* spare_sums)
      : weights(of),
        count(pairs),
        second(fold ? of.even : std::min<std::size_t>(of.parts.size(), 1)),
        spare(spare_sums),
        has_first(second > 0),
        has_second(second < of.parts.size()) {
    for (std::size_t p = 0; p < count; ++p) {
      first_weights[p][0].lanes.fill(has_first ? of.pairs[p] : 0);
      first_weights[p][1].lanes.fill(has_second ? of.pairs[second * of.stride + p] : 0);
    }
  }
};

// True if there are outputs beside those of one tone.
bool has_more(const ByteWeights& weights, bool fold) { return weights.parts.size() > 2 || (fold && weights.even != 1); }

// A slice of a strip. `load` computes its pairs as for add_slice() and stores them in `kept` if kKeep; otherwise they
// are already there. Folded, squares of pairs count twice.
template <bool kFold, bool kMore, bool kKeep, std::size_t kSlice, class Load>
HWY_INLINE void add_slice_of_strip(const BlockPlan& plan, const Strip& strip, Pairs* kept, Load load) {
  const std::size_t parts = plan.weights.parts.size();
  std::int32_t* sums = strip.sums + kSlice * kPerSlice * hn::Lanes(d32);
  add_slice<kFold, !kMore, kKeep>(
      plan.count,
      {plan.first_weights.data(), plan.has_first ? sums : plan.spare,
       plan.has_second ? sums + plan.second * kPerSum : plan.spare, strip.squares + kSlice * kPerSlice * hn::Lanes(d32),
       strip.totals + kSlice * kPerSlice * hn::Lanes(d32), strip.maximum, kept},
      load);
  if constexpr (!kMore) return;
  const std::span<const Pairs> pairs(kept, plan.count);
  add_outputs_of_kind<false>(pairs, plan.weights, 0, kFold ? plan.second : parts, sums);
  if (kFold) add_outputs_of_kind<true>(pairs, plan.weights, plan.second, parts, sums);
}

// Calls add<slice>() for every slice.
template <class Add>
HWY_INLINE void for_each_slice(Add add) {
  add.template operator()<0>();
  if constexpr (kSlices == 2) add.template operator()<1>();
}

// The pairs of one strip, straight from the pixels.
template <int kGroup, bool kFold, bool kMore, std::size_t kLines>
HWY_INLINE void add_strip(const Rows<kLines>& rows, const BlockPlan& plan, const RowsAhead& ahead, const Strip& strip) {
  Pairs kept[kMore ? kPairsPerBlock<kGroup, kFold> : 1];
  for_each_slice([&]<std::size_t kSlice>() OCISAC_INLINE_LAMBDA {
    add_slice_of_strip<kFold, kMore, kMore, kSlice>(
        plan, strip, kept, [&, at = rows](std::size_t p, Bytes& top, Pairs& pairs) mutable {
          ask_for_run<kGroup, kSlice == 0, kFold && kSlice + 1 == kSlices>(ahead, p);
          if constexpr (kGroup == 1)
            load_rows<kFold, kSlice>(at, top, pairs);
          else
            load_groups<kGroup, kFold>(at, top, pairs, pairs);
          at.template advance<kFold>(2 * kGroup);
        });
  });
}

// Groups of rows with intermediate storage, so that the rows are read once for all slices.
template <int kGroup, bool kFold, bool kMore, std::size_t kLines>
HWY_INLINE void add_strip_by_memory(const Rows<kLines>& rows, const BlockPlan& plan, const RowsAhead& ahead,
                                    const Strip& strip) {
  Pairs slices[kSlices][kPairsPerBlock<kGroup, kFold>];
  Bytes top = hn::LoadU(d8, strip.maximum);
  Rows<kLines> at = rows;
#pragma GCC unroll 1
  for (std::size_t p = 0; p < plan.count; ++p) {
    ask_for_run<kGroup, true, kFold>(ahead, p);
    load_groups<kGroup, kFold>(at, top, slices[0][p], slices[kSlices - 1][p]);
    at.template advance<kFold>(2 * kGroup);
  }
  hn::StoreU(top, d8, strip.maximum);
  for_each_slice([&]<std::size_t kSlice>() {
    const Pairs* made = slices[kSlice];
    add_slice_of_strip<kFold, kMore, false, kSlice>(plan, strip, slices[kSlice],
                                                    [made](std::size_t p, Bytes&, Pairs& pairs) {
                                                      for (std::size_t v = 0; v < kPerSlice; ++v) {
                                                        pairs.sums[v] = made[p].sums[v];
                                                        if (kFold) pairs.differences[v] = made[p].differences[v];
                                                      }
                                                    });
  });
}

// Dense copies of a block: a vector wide or more, and an even number of groups; what is beyond the block is 0.
class PaddedBlock {
 public:
  PaddedBlock(const ByteBlock& of, int row_group)
      : group_(static_cast<std::size_t>(row_group)),
        groups_(of.groups + of.groups % 2),
        columns_(of.columns),
        width_(std::max(of.columns, hn::Lanes(d8))),
        near_(rows() * width_),
        far_(of.mirrored ? near_.size() : 0) {
    for (std::size_t g = 0; g < of.groups; ++g) {
      copy(of.pixels + first_row(g) * of.row_stride, of.row_stride, &near_[g * group_ * width_]);
      if (of.mirrored) copy(of.mirrored - first_row(g) * of.row_stride, of.row_stride, mirrored(g));
    }
  }
  PaddedBlock(const PaddedBlock&) = delete;
  PaddedBlock& operator=(const PaddedBlock&) = delete;

  [[nodiscard]] ByteBlock block() {
    return {near_.data(), far_.empty() ? nullptr : mirrored(0), static_cast<std::ptrdiff_t>(width_), groups_, columns_,
            true};
  }

 private:
  [[nodiscard]] std::size_t rows() const { return groups_ * group_; }
  [[nodiscard]] std::ptrdiff_t first_row(std::size_t g) const { return static_cast<std::ptrdiff_t>(g * group_); }
  [[nodiscard]] std::uint8_t* mirrored(std::size_t g) { return &far_[(groups_ - 1 - g) * group_ * width_]; }
  void copy(const std::uint8_t* from, std::ptrdiff_t stride, std::uint8_t* to) const {
    for (std::size_t r = 0; r < group_; ++r, from += stride, to += width_) std::copy_n(from, columns_, to);
  }

  std::size_t group_, groups_, columns_, width_;
  std::vector<std::uint8_t> near_, far_;
};

// All strips of a block.
template <int kGroup, bool kFold, bool kMore, std::size_t kLines>
void add_block(const ByteBlock& block, const BlockPlan& plan, RowsAhead ahead, Strips& strips) {
  const std::uint8_t* const far = kFold ? block.mirrored : block.pixels;
  const std::ptrdiff_t next_rows = static_cast<std::ptrdiff_t>(2 * kGroup * plan.count) * block.row_stride;
  for (std::size_t i = 0; i < strips.grid.count(); ++i, ahead.run += ahead.run == kNoRun ? 0 : plan.count) {
    const std::ptrdiff_t first = strips.grid.first(i);
    Rows<kLines> here{block.pixels + first, far + first, block.row_stride};
    for (std::size_t n = 0; n < kLines; ++n) {
      const std::size_t strips_ahead = kLines <= kLinesAfterRuns ? kAheadAfterRuns<kGroup>[n] : kAheadAlone[n];
      const auto step = strips.grid.step(i, strips_ahead, next_rows);
      here.near_ahead[n] = step.near;
      here.far_ahead[n] = step.far;
    }
    if constexpr (kGroup == 1 || kSlices == 1)
      add_strip<kGroup, kFold, kMore, kLines>(here, plan, ahead, strips.at(i));
    else
      add_strip_by_memory<kGroup, kFold, kMore, kLines>(here, plan, ahead, strips.at(i));
  }
}

template <int kGroup, bool kFold, bool kMore, std::size_t kLines>
class BlockProjector {
 public:
  BlockProjector(const ByteBlock& block, const ByteWeights& weights, Strips& strips)
      : whole_(block),
        rest_(block),
        weights_(weights),
        strips_(strips),
        rows_ahead_(std::min(kPairs * 2 * kGroup, block.groups * kGroup)),
        runs_(kLines <= kLinesAfterRuns && asks_for_runs(block)
                  ? offsets_of({kRun, rows_ahead_, block.row_stride, block.columns, strips.grid.count() * kPairs})
                  : nullptr) {
    strips.square_share = kFold ? 0.5 : 1;
  }

  void run() {
    for (int block = 0; block < kBlocksAhead; ++block) fetch(next_rows());
    while (rest_.groups >= 2) {
      const std::size_t pairs = std::min(rest_.groups / 2, kPairs);
      add(rest_, pairs);
      advance(pairs);
    }
    if (rest_.groups > 0) add(PaddedBlock(rest_, kGroup).block(), 1);
  }

 private:
  // Fewer with wide vectors and runs, since rows of two blocks share the second-level cache.
  static constexpr std::size_t kPairs =
      kWide && kLines == kLinesAfterRuns ? std::max<std::size_t>(kPairsPerBlock<kGroup, kFold> * (kMore ? 3 : 2) / 4, 1)
                                         : kPairsPerBlock<kGroup, kFold>;
  static constexpr std::size_t kRun = kLinesPerPair<kGroup> * kLine;
  static constexpr int kBlocksAhead = kWide && !kMore ? 2 : 1;

  // Rows before which nothing is computed are read: most of so many prefetches at once would be dropped. A run may end
  // beyond narrow rows.
  void fetch(const RowsAhead& rows) const {
    if (!runs_ || rows.run == kNoRun) return;
    const auto fetch_run = whole_.columns < kRun ? ask_for<kRun / kLine, kWide> : read_lines<kRun / kLine>;
    for (const std::ptrdiff_t run : *runs_) {
      fetch_run(rows.near + run);
      if (kFold) fetch_run(rows.far - run);
    }
  }

  [[nodiscard]] std::ptrdiff_t offset(std::ptrdiff_t rows) const { return rows * rest_.row_stride; }

  // The rows of the next block to prefetch, as many in the last one; then those of the next frame. Mirror images are in
  // reverse order, and so are their runs: memory is read from either end towards the middle.
  [[nodiscard]] RowsAhead next_rows() {
    const auto rows = static_cast<std::ptrdiff_t>(rows_ahead_);
    const auto total = static_cast<std::ptrdiff_t>(whole_.groups * kGroup);
    const bool is_next_frame = row_ahead_ >= total;
    if (!runs_ || (is_next_frame && whole_.to_next == 0)) return {whole_.pixels, whole_.pixels, kNoRun};
    const std::ptrdiff_t first = std::min(is_next_frame ? row_ahead_ % total / rows * rows : row_ahead_, total - rows);
    row_ahead_ += rows;
    const std::ptrdiff_t to_lowest =
        (is_next_frame ? whole_.to_next : 0) + std::min<std::ptrdiff_t>(offset(rows - 1), 0);
    const std::uint8_t* near = whole_.pixels + offset(first) + to_lowest;
    const std::uint8_t* far = kFold ? whole_.mirrored + offset(kGroup - first - rows) + to_lowest : near;
    return {near, far + runs_->back(), runs_->data()};
  }

  void add(const ByteBlock& block, std::size_t pairs) {
    add_block<kGroup, kFold, kMore, kLines>(block, {weights_, pairs, kFold, strips_.spare()}, next_rows(), strips_);
  }

  void advance(std::size_t pairs) {
    rest_.groups -= 2 * pairs;
    if (rest_.groups == 0) return;
    const std::ptrdiff_t done = offset(static_cast<std::ptrdiff_t>(2 * pairs * kGroup));
    rest_.pixels += done;
    if (kFold) rest_.mirrored -= done;
    weights_.pairs += pairs;
  }

  const ByteBlock whole_;
  ByteBlock rest_;
  ByteWeights weights_;
  Strips& strips_;
  std::size_t rows_ahead_;
  std::ptrdiff_t row_ahead_ = 0;  // the first one of the next block to prefetch
  std::shared_ptr<const Offsets> runs_;
};

template <int kGroup, bool kFold, bool kMore>
void project_blocks(const ByteBlock& block, const ByteWeights& weights, Strips& strips) {
  const auto project = [&]<std::size_t kLines>() {
    BlockProjector<kGroup, kFold, kMore, kLines>(block, weights, strips).run();
  };
  if constexpr (HWY_TARGET == HWY_AVX2 || kWide)
    if (asks_for_runs(block) && strips_come_late()) return project.template operator()<kLinesAfterRuns>();
  project.template operator()<kWide ? kLinesAlone : 0>();
}

template <int kGroup>
void project_groups(const ByteBlock& block, const ByteWeights& weights, Strips& strips) {
  const auto project =
      has_more(weights, block.mirrored != nullptr)
          ? (block.mirrored ? project_blocks<kGroup, true, true> : project_blocks<kGroup, false, true>)
          : (block.mirrored ? project_blocks<kGroup, true, false> : project_blocks<kGroup, false, false>);
  project(block, weights, strips);
}

void project_any(const ByteBlock& block, const ByteWeights& weights, Strips& strips) {
  if (weights.row_group == 1) project_groups<1>(block, weights, strips);
  if (weights.row_group == 2) project_groups<2>(block, weights, strips);
  if (weights.row_group == 4) project_groups<4>(block, weights, strips);
  if (weights.row_group == 8) project_groups<8>(block, weights, strips);
}

constexpr std::size_t kInBlock = 16 / sizeof(std::int32_t);  // lanes kept together by the interleaving

// A number becomes unit·(number + share·sum), where it is overwritten unit·share·sum; the sums are integers. For the
// numbers of a block's lanes.
template <bool kWrite>
HWY_INLINE void add_lanes(const std::int32_t* HWY_RESTRICT from, double share, double unit, double* HWY_RESTRICT to) {
#if HWY_HAVE_FLOAT64
  const hn::CappedTag<double, kInBlock> d_double;
  const hn::Rebind<std::int32_t, decltype(d_double)> d_int;
  for (std::size_t i = 0; i < kInBlock; i += hn::Lanes(d_double)) {
    const auto sums = hn::PromoteTo(d_double, hn::Load(d_int, from + i));
    const auto before = kWrite ? hn::Zero(d_double) : hn::LoadU(d_double, to + i);
    const auto sum = hn::Add(before, hn::Mul(hn::Set(d_double, share), sums));
    hn::StoreU(hn::Mul(hn::Set(d_double, unit), sum), d_double, to + i);
  }
#else
  for (std::size_t i = 0; i < kInBlock; ++i) to[i] = unit * ((kWrite ? 0 : to[i]) + share * from[i]);
#endif
}

// The same for one output of a strip, whose lanes are in the order of Pairs, and `columns` numbers.
template <bool kWrite>
HWY_INLINE void add_in_order(const std::int32_t* HWY_RESTRICT from, double share, double unit, double* HWY_RESTRICT to,
                             std::size_t columns) {
  if (columns == kPerSum) {
    for (std::size_t b = 0; b < kPerSum / kVectors; b += kInBlock)
      for (std::size_t v = 0; v < kVectors; ++v, to += kInBlock)
        add_lanes<kWrite>(from + v * hn::Lanes(d32) + b, share, unit, to);
    return;
  }
  for (std::size_t c = 0; c < columns; ++c) {
    const std::size_t block = c / kInBlock;
    const std::size_t lane = block % kVectors * hn::Lanes(d32) + block / kVectors * kInBlock + c % kInBlock;
    to[c] = unit * ((kWrite ? 0 : to[c]) + share * from[lane]);
  }
}

// The same for the maxima of `columns` columns.
template <bool kWrite>
HWY_INLINE void raise_in_order(const std::uint8_t* HWY_RESTRICT from, double* HWY_RESTRICT to, std::size_t columns) {
  std::size_t c = 0;
#if HWY_HAVE_FLOAT64
  const hn::ScalableTag<double> d_double;
  const hn::Rebind<std::int32_t, decltype(d_double)> d_int;
  const hn::Rebind<std::uint8_t, decltype(d_double)> d_byte;
  for (; c + hn::Lanes(d_double) <= columns; c += hn::Lanes(d_double)) {
    const auto bytes = hn::PromoteTo(d_double, hn::PromoteTo(d_int, hn::LoadU(d_byte, from + c)));
    hn::StoreU(kWrite ? bytes : hn::Max(bytes, hn::LoadU(d_double, to + c)), d_double, to + c);
  }
#endif
  for (; c < columns; ++c) to[c] = std::max(kWrite ? 0 : to[c], static_cast<double>(from[c]));
}

// Writes all outputs of strip i for its own columns.
template <bool kWrite>
void add_strip_in_order(Strips& strips, std::size_t i, const ByteWeights& weights, const ProjectionSums& to) {
  const Strip strip = strips.at(i);
  const auto first = static_cast<std::size_t>(strips.grid.first(i));
  const std::size_t count = strips.grid.own_columns(i);
  const std::int32_t* from = strip.sums;
  for (const std::size_t part : weights.parts) {
    add_in_order<kWrite>(from, 1, weights.unit(part, to.last), to.sums + part * to.stride + first, count);
    from += kPerSum;
  }
  add_in_order<kWrite>(strip.squares, strips.square_share, 1, to.squares + first, count);
  add_in_order<kWrite>(strip.totals, 1, 1, to.totals + first, count);
  raise_in_order<kWrite>(strip.maximum, to.maximum + first, count);
}

void project_wide(const ByteBlock& block, const ByteWeights& weights, const ProjectionSums& to) {
  Strips strips(block, weights);
  project_any(block, weights, strips);
  const auto add = to.first ? add_strip_in_order<true> : add_strip_in_order<false>;
  for (std::size_t i = 0; i < strips.grid.count(); ++i) add(strips, i, weights, to);
}

void ProjectBytes(const ByteBlock& block, const ByteWeights& weights, const ProjectionSums& to) {
  if (block.columns >= hn::Lanes(d8)) return project_wide(block, weights, to);
  project_wide(PaddedBlock(block, weights.row_group).block(), weights, to);
}

// Sum of 16-bit lanes that hold sums of bytes.
HWY_INLINE std::int32_t sum_of_shorts(Pair16 v) {
  const Sum32 both = hn::BitCast(d32, v);
  const Sum32 low = hn::And(both, hn::Set(d32, 0xffff));
  const Sum32 high = hn::And(hn::ShiftRight<16>(both), hn::Set(d32, 0xffff));
  return hn::GetLane(hn::SumOfLanes(d32, hn::Add(low, high)));
}

// Rows of one column, in memory order: weighted sums of kParts parts and, if kMoments, moments. Lanes are added up in
// the end, so that their order does not matter.
template <std::size_t kParts, bool kMoments>
struct ColumnSums {
  static constexpr std::size_t kSums = kParts + kMoments;  // the last ones: squares
  static constexpr hn::Rebind<std::uint8_t, decltype(d16s)> d_row{};

  Sum32 sums[std::max<std::size_t>(kSums, 1)], others[std::max<std::size_t>(kSums, 1)];
  Pair16 total = hn::Zero(d16s), top = hn::Zero(d16s);  // at most kRowsPerChunk rows: below 2^16 in each lane

  HWY_INLINE ColumnSums() {
    for_each_constant<kSums>([&](auto i) OCISAC_INLINE_LAMBDA { sums[i] = others[i] = hn::Zero(d32); });
  }

  // A vector of rows; weights of the parts are `stride` apart.
  HWY_INLINE void add(Pair16 row, const std::int16_t* HWY_RESTRICT weights, std::size_t stride) {
    for_each_constant<kParts>([&](auto i) OCISAC_INLINE_LAMBDA {
      sums[i] = hn::ReorderWidenMulAccumulate(d32, row, hn::LoadU(d16s, weights + i * stride), sums[i], others[i]);
    });
    if constexpr (!kMoments) return;
    sums[kParts] = hn::ReorderWidenMulAccumulate(d32, row, row, sums[kParts], others[kParts]);
    total = hn::Add(total, row);
    top = hn::Max(top, row);
  }

  // Fewer rows than a vector has lanes begin at `from`; the vector that ends with them begins `back` rows before.
  HWY_INLINE void add_last(const std::uint8_t* pixels, const std::int16_t* weights, std::size_t stride,
                           std::size_t from, std::size_t back) {
    const Pair16 row = hn::PromoteTo(d16s, hn::LoadU(d_row, pixels + from - back));
    add(hn::IfThenZeroElse(hn::FirstN(d16s, back), row), weights + from - back, stride);
  }

  [[nodiscard]] HWY_INLINE double sum(std::size_t i) const {
    return hn::GetLane(hn::SumOfLanes(d32, hn::Add(sums[i], others[i])));
  }
};

template <std::size_t kParts, bool kMoments>
HWY_INLINE void add_column(const std::uint8_t* HWY_RESTRICT pixels, std::size_t rows, const ByteWeights& weights,
                           std::size_t part, std::size_t column, const ProjectionSums& to) {
  const std::size_t lanes = hn::Lanes(d16s), stride = 2 * weights.stride;
  static_assert(std::endian::native == std::endian::little);  // a pair's words are in order
  const auto* of_rows = reinterpret_cast<const std::int16_t*>(weights.pairs + part * weights.stride);
  ColumnSums<kParts, kMoments> of;
  std::size_t r = 0;
  for (; r + lanes <= rows; r += lanes)
    of.add(hn::PromoteTo(d16s, hn::LoadU(of.d_row, pixels + r)), of_rows + r, stride);
  if (r < rows) of.add_last(pixels, of_rows, stride, r, r + lanes - rows);
  const auto put = [&](double* out, double value, double unit = 1)
                       OCISAC_INLINE_LAMBDA { out[column] = unit * (value + (to.first ? 0 : out[column])); };
  for_each_constant<kParts>([&](auto i) OCISAC_INLINE_LAMBDA {
    const std::size_t p = weights.parts[part + i];
    put(to.sums + p * to.stride, of.sum(i), weights.unit(p, to.last));
  });
  if constexpr (!kMoments) return;
  put(to.squares, of.sum(kParts));
  put(to.totals, sum_of_shorts(of.total));
  to.maximum[column] = std::max<double>(hn::GetLane(hn::MaxOfLanes(d16s, of.top)), to.first ? 0 : to.maximum[column]);
}

void ProjectAcross(const ByteBlock& block, const ByteWeights& weights, const ProjectionSums& to) {
  const std::size_t parts = weights.parts.size(), first = parts % 4;
  for (std::size_t c = 0; c < block.columns; ++c) {
    const std::uint8_t* pixels = block.pixels + static_cast<std::ptrdiff_t>(c) * block.row_stride;
    if (first == 0) add_column<0, true>(pixels, block.groups, weights, 0, c, to);
    if (first == 1) add_column<1, true>(pixels, block.groups, weights, 0, c, to);
    if (first == 2) add_column<2, true>(pixels, block.groups, weights, 0, c, to);
    if (first == 3) add_column<3, true>(pixels, block.groups, weights, 0, c, to);
    for (std::size_t part = first; part < parts; part += 4)
      add_column<4, false>(pixels, block.groups, weights, part, c, to);
  }
}

#endif  // HWY_TARGET == HWY_SCALAR

std::uint64_t ReadBytes(const std::uint8_t* data, std::size_t size) {
#if HWY_TARGET == HWY_SCALAR
  return std::accumulate(data, data + size, std::uint64_t{0});
#else
  const hn::ScalableTag<std::uint64_t> d_sum;
  const std::size_t lanes = hn::Lanes(d8);
  auto a = hn::Zero(d_sum), b = a, c = a, d = a;
  std::size_t i = 0;
  for (; i + 4 * lanes <= size; i += 4 * lanes) {
    a = hn::Add(a, hn::SumsOf8(hn::LoadU(d8, data + i)));
    b = hn::Add(b, hn::SumsOf8(hn::LoadU(d8, data + i + lanes)));
    c = hn::Add(c, hn::SumsOf8(hn::LoadU(d8, data + i + 2 * lanes)));
    d = hn::Add(d, hn::SumsOf8(hn::LoadU(d8, data + i + 3 * lanes)));
  }
  std::uint64_t sum = hn::GetLane(hn::SumOfLanes(d_sum, hn::Add(hn::Add(a, b), hn::Add(c, d))));
  for (; i < size; ++i) sum += data[i];
  return sum;
#endif
}

std::int64_t Target() { return HWY_TARGET; }

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(ProjectBytes);
HWY_EXPORT(ProjectAcross);
HWY_EXPORT(ReadBytes);
HWY_EXPORT(Target);

void project_bytes(const ByteBlock& block, const ByteWeights& weights, const ProjectionSums& to) {
  HWY_DYNAMIC_DISPATCH(ProjectBytes)(block, weights, to);
}

void project_across(const ByteBlock& block, const ByteWeights& weights, const ProjectionSums& to) {
  HWY_DYNAMIC_DISPATCH(ProjectAcross)(block, weights, to);
}

std::uint64_t read_bytes(const std::uint8_t* data, std::size_t size) {
  return HWY_DYNAMIC_DISPATCH(ReadBytes)(data, size);
}

std::int64_t target() { return HWY_DYNAMIC_DISPATCH(Target)(); }

}  // namespace ocisac::kernels
#endif
