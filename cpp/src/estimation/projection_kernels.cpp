#include "estimation/projection_kernels.hpp"

#include <algorithm>
#include <array>
#include <numeric>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "estimation/projection_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/aligned_allocator.h>
#include <hwy/cache_control.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// Rows that are worked on at a time: few enough streams for the prefetcher, enough to spare the sums' way to L1.
constexpr std::size_t kRowsPerBlock = 32;
[[maybe_unused]] constexpr std::size_t kRowsPerSampleBlock = 16;  // wider samples

#if HWY_TARGET == HWY_SCALAR

// Without vectors: the loops as they are meant.
void ProjectBytes(const ByteBlock& block, const ByteWeights& weights, const ProjectionSums& to) {
  const auto group = static_cast<std::size_t>(weights.row_group);
  const auto sum_of_group = [&](const std::uint8_t* pixels, std::size_t c) {
    std::int32_t sum = 0;
    for (std::size_t r = 0; r < group; ++r, pixels += block.row_stride) {
      to.moments.maximum[c] = std::max(to.moments.maximum[c], static_cast<double>(pixels[c]));
      sum += pixels[c];
    }
    return sum;
  };
  for (std::size_t g = 0; g < block.groups; ++g)
    for (std::size_t c = 0; c < block.columns; ++c) {
      const auto rows = static_cast<std::ptrdiff_t>(g * group) * block.row_stride;
      const std::int32_t near = sum_of_group(block.pixels + rows, c);
      const std::int32_t far = block.mirrored ? sum_of_group(block.mirrored - rows, c) : 0;
      for (std::size_t p = 0; p < weights.parts.size(); ++p) {
        const auto pair = static_cast<std::uint32_t>(weights.pairs[p * weights.stride + g / 2]);
        const auto weight = static_cast<std::int16_t>(g % 2 == 0 ? pair & 0xffffU : pair >> 16);
        to.sums[weights.parts[p] * block.columns + c] += weight * (p < weights.even ? near + far : near - far);
      }
      to.moments.totals[c] += near + far;
      to.moments.squares[c] += static_cast<double>(near) * near + static_cast<double>(far) * far;
    }
}

#else

const hn::ScalableTag<std::uint16_t> d16;
const hn::ScalableTag<std::int16_t> d16s;
const hn::ScalableTag<std::int32_t> d32;
using Sum16 = hn::Vec<decltype(d16)>;
using Pair16 = hn::Vec<decltype(d16s)>;
using Sum32 = hn::Vec<decltype(d32)>;

// sum + a₀·b₀ + a₁·b₁ in every 32-bit lane, whose halves are (a₀, a₁) and (b₀, b₁).
HWY_INLINE Sum32 multiply_pairs(Sum32 sum, Pair16 a, Pair16 b) {
#if HWY_ARCH_X86 && HWY_TARGET != HWY_EMU128
  Sum32 unused = hn::Zero(d32);
  return hn::ReorderWidenMulAccumulate(d32, a, b, sum, unused);  // vpmaddwd, which keeps this order
#else
  const Sum32 x = hn::BitCast(d32, a);
  const Sum32 y = hn::BitCast(d32, b);
  const auto low = [](Sum32 v) { return hn::ShiftRight<16>(hn::ShiftLeft<16>(v)); };
  const auto high = [](Sum32 v) { return hn::ShiftRight<16>(v); };
  return hn::Add(sum, hn::Add(hn::Mul(low(x), low(y)), hn::Mul(high(x), high(y))));
#endif
}

// A strip of columns is as wide as a vector of bytes. Its sums of rows are kept for even and odd columns apart, which
// costs a shift where widening would cost two shuffles.
constexpr std::size_t kVectors = 4;  // of 32-bit sums a strip
const hn::ScalableTag<std::uint8_t> d8;
using Bytes = hn::Vec<decltype(d8)>;

struct EvenOdd {
  Sum16 even, odd;
};

// Asks for rows before they are worked on, in the order of memory: strip by strip, as they are worked on, none of the
// hardware's own prefetchers would follow (bench/README.md has the figures).
class RowsAhead {
 public:
  RowsAhead(const std::uint8_t* first, std::ptrdiff_t stride, std::size_t columns, std::size_t rows)
      : row_(first), line_(first), stride_(stride), columns_(static_cast<std::ptrdiff_t>(columns)), rows_(rows) {}

  HWY_INLINE void ask_for(std::size_t bytes) {
    for (std::size_t asked = 0; asked < bytes && rows_ > 0; asked += kLine) {
      hwy::Prefetch(line_);
      line_ += kLine;
      if (line_ - row_ < columns_) continue;
      line_ = row_ += stride_;
      --rows_;
    }
  }

  void ask_for_all() {
    while (rows_ > 0) ask_for(kLine);
  }

 private:
  static constexpr std::size_t kLine = 64;
  const std::uint8_t *row_, *line_;
  std::ptrdiff_t stride_, columns_;
  std::size_t rows_;
};

// Rows of a block and their mirror images.
struct BlockAhead {
  RowsAhead near, far;
};

// Those after the first `done`, at most `most` of each. Mirror images follow one another backwards.
template <int kGroup, bool kFold>
BlockAhead rows_after(const ByteBlock& block, std::size_t done, std::size_t most) {
  const std::size_t rows = std::min(block.groups * kGroup - done, most);
  const auto offset = [&](std::size_t count) { return static_cast<std::ptrdiff_t>(count) * block.row_stride; };
  const std::uint8_t* far = kFold ? block.mirrored + offset(kGroup) - offset(done + rows) : nullptr;
  return {{block.pixels + offset(done), block.row_stride, block.columns, rows},
          {far, block.row_stride, block.columns, kFold ? rows : 0}};
}

// Sum of kGroup rows of a strip; raises the maximum.
template <int kGroup>
HWY_INLINE EvenOdd sum_of_group(const std::uint8_t* HWY_RESTRICT pixels, std::ptrdiff_t stride, Bytes& maximum) {
  Sum16 all = hn::Zero(d16);  // even + 256·odd, modulo 2^16
  Sum16 odd = all;
  for (int i = 0; i < kGroup; ++i, pixels += stride) {
    const Bytes row = hn::LoadU(d8, pixels);
    maximum = hn::Max(maximum, row);
    all = hn::Add(all, hn::BitCast(d16, row));
    odd = hn::Add(odd, hn::ShiftRight<8>(hn::BitCast(d16, row)));
  }
  return {kGroup == 1 ? hn::And(all, hn::Set(d16, 255)) : hn::Sub(all, hn::ShiftLeft<8>(odd)), odd};
}

// The sums of two groups side by side in 32-bit lanes. lane_order() tells which column a lane is of.
HWY_INLINE void interleave(const EvenOdd& a, const EvenOdd& b, Pair16* HWY_RESTRICT pairs) {
  pairs[0] = hn::BitCast(d16s, hn::InterleaveLower(d16, a.even, b.even));
  pairs[1] = hn::BitCast(d16s, hn::InterleaveUpper(d16, a.even, b.even));
  pairs[2] = hn::BitCast(d16s, hn::InterleaveLower(d16, a.odd, b.odd));
  pairs[3] = hn::BitCast(d16s, hn::InterleaveUpper(d16, a.odd, b.odd));
}

HWY_INLINE EvenOdd operator+(const EvenOdd& a, const EvenOdd& b) {
  return {hn::Add(a.even, b.even), hn::Add(a.odd, b.odd)};
}
HWY_INLINE EvenOdd operator-(const EvenOdd& a, const EvenOdd& b) {
  return {hn::Sub(a.even, b.even), hn::Sub(a.odd, b.odd)};
}

// Where a strip's rows are, from the block's first on, and, mirrored, from its last group on backwards (or null).
struct Rows {
  const std::uint8_t* near;
  const std::uint8_t* far;
  std::ptrdiff_t stride;
  BlockAhead* ahead;  // to ask for meanwhile
};

// Where a strip is added up. sums: kVectors vectors of a part, one part after the other, then the squares, then
// the totals. The totals of the last rows are kept in 16 bits, even and odd columns apart, until they might overflow.
struct Strip {
  std::int32_t* sums;
  std::uint16_t* totals;
  std::uint8_t* maximum;
};

constexpr std::size_t kOwnSums = 2;         // squares and totals, beside the parts
constexpr std::size_t kRowsPerTotal = 256;  // 255·kRowsPerTotal < 2^16

// Strips side by side.
struct Strips {
  hwy::AlignedFreeUniquePtr<std::int32_t[]> sums;
  hwy::AlignedFreeUniquePtr<std::uint16_t[]> totals;
  std::vector<std::uint8_t> maximum;
  std::size_t parts;

  Strips(std::size_t count, std::size_t of_parts)
      : sums(hwy::AllocateAligned<std::int32_t>(count * (of_parts + kOwnSums) * hn::Lanes(d8))),
        totals(hwy::AllocateAligned<std::uint16_t>(count * hn::Lanes(d8))),
        maximum(count * hn::Lanes(d8)),
        parts(of_parts) {
    std::fill_n(sums.get(), count * (parts + kOwnSums) * hn::Lanes(d8), 0);
    std::fill_n(totals.get(), maximum.size(), std::uint16_t{0});
  }
  [[nodiscard]] Strip at(std::size_t column) {
    return {sums.get() + column * (parts + kOwnSums), totals.get() + column, maximum.data() + column};
  }
};

HWY_INLINE void load_sums(const std::int32_t* HWY_RESTRICT from, Sum32* HWY_RESTRICT sums) {
  for (std::size_t v = 0; v < kVectors; ++v) sums[v] = hn::Load(d32, from + v * hn::Lanes(d32));
}

HWY_INLINE void store_sums(const Sum32* HWY_RESTRICT sums, std::int32_t* HWY_RESTRICT to) {
  for (std::size_t v = 0; v < kVectors; ++v) hn::Store(sums[v], d32, to + v * hn::Lanes(d32));
}

// kOutputs at a time: as many as the registers hold.
template <std::size_t kOutputs, std::size_t kPairs>
HWY_INLINE void add_outputs(const Pair16 (&pairs)[kPairs][kVectors], const std::int32_t* HWY_RESTRICT weights,
                            std::size_t weights_stride, std::int32_t* HWY_RESTRICT sums) {
  const std::size_t per_output = kVectors * hn::Lanes(d32);
  Sum32 out[kOutputs][kVectors];
  for (std::size_t o = 0; o < kOutputs; ++o) load_sums(sums + o * per_output, out[o]);
#pragma GCC unroll 1  // else the compiler reorders the additions and spills
  for (std::size_t p = 0; p < kPairs; ++p) {
    Pair16 weight[kOutputs];
    for (std::size_t o = 0; o < kOutputs; ++o)
      weight[o] = hn::BitCast(d16s, hn::Set(d32, weights[o * weights_stride + p]));
    for (std::size_t v = 0; v < kVectors; ++v)
      for (std::size_t o = 0; o < kOutputs; ++o) out[o][v] = multiply_pairs(out[o][v], pairs[p][v], weight[o]);
  }
  for (std::size_t o = 0; o < kOutputs; ++o) store_sums(out[o], sums + o * per_output);
}

// Two groups of rows of a strip side by side: as they are, or the sums with their mirror images and the differences.
// A lone group has no second.
template <int kGroup, bool kFold, bool kLone>
HWY_INLINE void load_pair(const Rows& rows, std::size_t pair, EvenOdd& total, Bytes& top, Pair16* HWY_RESTRICT sums,
                          Pair16* HWY_RESTRICT differences) {
  const std::ptrdiff_t second = kGroup * rows.stride;
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(2 * pair) * second;
  const EvenOdd none{hn::Zero(d16), hn::Zero(d16)};
  constexpr std::size_t kBytes = 2 * kGroup * hn::MaxLanes(d8);
  rows.ahead->near.ask_for(kBytes);
  const EvenOdd a = sum_of_group<kGroup>(rows.near + first, rows.stride, top);
  const EvenOdd b = kLone ? none : sum_of_group<kGroup>(rows.near + first + second, rows.stride, top);
  if constexpr (!kFold) {
    total = total + (a + b);
    interleave(a, b, sums);
  } else {
    rows.ahead->far.ask_for(kBytes);
    const EvenOdd c = sum_of_group<kGroup>(rows.far - first, rows.stride, top);
    const EvenOdd d = kLone ? none : sum_of_group<kGroup>(rows.far - first - second, rows.stride, top);
    const EvenOdd ac = a + c, bd = b + d;
    total = total + (ac + bd);
    interleave(ac, bd, sums);
    interleave(a - c, b - d, differences);
  }
}

template <std::size_t kPairs>
HWY_INLINE void add_all_outputs(const Pair16 (&pairs)[kPairs][kVectors], const std::int32_t* weights,
                                std::size_t weights_stride, std::size_t outputs, std::int32_t* sums) {
  const std::size_t per_output = kVectors * hn::Lanes(d32);
  std::size_t o = 0;
  for (; o + 2 <= outputs; o += 2)
    add_outputs<2>(pairs, weights + o * weights_stride, weights_stride, sums + o * per_output);
  if (o < outputs) add_outputs<1>(pairs, weights + o * weights_stride, weights_stride, sums + o * per_output);
}

// One block of rows of one strip: the squares (twice, if folded), then all outputs.
template <int kGroup, std::size_t kPairs, bool kFold, bool kLone>
HWY_INLINE void add_strip(const Rows& rows, const ByteWeights& weights, const Strip& strip) {
  const std::size_t per_output = kVectors * hn::Lanes(d32);
  std::int32_t* squares = strip.sums + weights.parts.size() * per_output;
  Pair16 near[kPairs][kVectors];
  Pair16 differences[kFold ? kPairs : 1][kVectors];
  Sum32 square[kVectors];
  load_sums(squares, square);
  Bytes top = hn::LoadU(d8, strip.maximum);
  EvenOdd total{hn::Load(d16, strip.totals), hn::Load(d16, strip.totals + hn::Lanes(d16))};
#pragma GCC unroll 1
  for (std::size_t p = 0; p < kPairs; ++p) {
    load_pair<kGroup, kFold, kLone>(rows, p, total, top, near[p], differences[kFold ? p : 0]);
    for (std::size_t v = 0; v < kVectors; ++v) square[v] = multiply_pairs(square[v], near[p][v], near[p][v]);
    for (std::size_t v = 0; kFold && v < kVectors; ++v)
      square[v] = multiply_pairs(square[v], differences[p][v], differences[p][v]);
  }
  hn::StoreU(top, d8, strip.maximum);
  hn::Store(total.even, d16, strip.totals);
  hn::Store(total.odd, d16, strip.totals + hn::Lanes(d16));
  store_sums(square, squares);
  add_all_outputs(near, weights.pairs, weights.stride, kFold ? weights.even : weights.parts.size(), strip.sums);
  if constexpr (kFold)
    add_all_outputs(differences, weights.pairs + weights.even * weights.stride, weights.stride,
                    weights.parts.size() - weights.even, strip.sums + weights.even * per_output);
}

// Copies `rows` rows of the last, narrower strip, which leaves the rest of a vector 0.
HWY_INLINE void pad_strip(const std::uint8_t* from, std::ptrdiff_t stride, std::size_t rows, std::size_t columns,
                          std::uint8_t* to) {
  for (std::size_t r = 0; r < rows; ++r)
    std::copy_n(from + static_cast<std::ptrdiff_t>(r) * stride, columns, to + r * hn::Lanes(d8));
}

// Runs add_strip over all strips of a block of rows.
template <int kGroup, std::size_t kPairs, bool kFold, bool kLone>
void add_block(const ByteBlock& block, BlockAhead ahead, const ByteWeights& weights, Strips& strips) {
  constexpr std::size_t kRows = (kLone ? 1 : 2) * kGroup * kPairs;
  const std::size_t width = hn::Lanes(d8);
  std::size_t c = 0;
  for (; c + width <= block.columns; c += width)
    add_strip<kGroup, kPairs, kFold, kLone>(
        {block.pixels + c, kFold ? block.mirrored + c : nullptr, block.row_stride, &ahead}, weights, strips.at(c));
  if (c == block.columns) return;
  std::array<std::uint8_t, kRows * HWY_MAX_BYTES> near{};
  std::array<std::uint8_t, kFold ? kRows * HWY_MAX_BYTES : 1> far{};
  const std::ptrdiff_t back = static_cast<std::ptrdiff_t>(kRows - kGroup);  // from the last group to the first
  pad_strip(block.pixels + c, block.row_stride, kRows, block.columns - c, near.data());
  if (kFold)
    pad_strip(block.mirrored - back * block.row_stride + c, block.row_stride, kRows, block.columns - c, far.data());
  const auto stride = static_cast<std::ptrdiff_t>(width);
  add_strip<kGroup, kPairs, kFold, kLone>({near.data(), far.data() + (kFold ? back * stride : 0), stride, &ahead},
                                          weights, strips.at(c));
}

// Moves the totals from 16 to 32 bits.
void widen_totals(std::size_t columns, Strips& strips) {
  for (std::size_t c = 0; c < columns; c += hn::Lanes(d8)) {
    const Strip strip = strips.at(c);
    const EvenOdd none{hn::Zero(d16), hn::Zero(d16)};
    Pair16 wide[kVectors];
    interleave({hn::Load(d16, strip.totals), hn::Load(d16, strip.totals + hn::Lanes(d16))}, none, wide);
    std::int32_t* to = strip.sums + (strips.parts + 1) * kVectors * hn::Lanes(d32);
    Sum32 sums[kVectors];
    load_sums(to, sums);
    for (std::size_t v = 0; v < kVectors; ++v) sums[v] = hn::Add(sums[v], hn::BitCast(d32, wide[v]));
    store_sums(sums, to);
    hn::Store(none.even, d16, strip.totals);
    hn::Store(none.odd, d16, strip.totals + hn::Lanes(d16));
  }
}

template <int kGroup, bool kFold>
void project_groups(ByteBlock rest, ByteWeights weights, Strips& strips) {
  constexpr std::size_t kRowsPerPair = (kFold ? 4 : 2) * kGroup;
  constexpr std::size_t kPairs = std::max<std::size_t>(kRowsPerBlock / kRowsPerPair, 1);
  constexpr std::size_t kRows = 2 * kGroup * kPairs;  // of a whole block, mirror images not counted
  BlockAhead first = rows_after<kGroup, kFold>(rest, 0, kRows);
  first.near.ask_for_all();
  first.far.ask_for_all();
  std::size_t rows_in_totals = 0;
  const auto make_room = [&](std::size_t pairs) {
    if (rows_in_totals + pairs * kRowsPerPair > kRowsPerTotal) {
      widen_totals(rest.columns, strips);
      rows_in_totals = 0;
    }
    rows_in_totals += pairs * kRowsPerPair;
  };
  const auto advance = [&](std::size_t pairs) {
    const auto rows = static_cast<std::ptrdiff_t>(2 * kGroup * pairs) * rest.row_stride;
    rest.pixels += rows;
    if (kFold) rest.mirrored -= rows;
    rest.groups -= 2 * pairs;
    weights.pairs += pairs;
  };
  for (; rest.groups >= 2 * kPairs; advance(kPairs)) {
    make_room(kPairs);
    add_block<kGroup, kPairs, kFold, false>(rest, rows_after<kGroup, kFold>(rest, kRows, kRows), weights, strips);
  }
  const BlockAhead none = rows_after<kGroup, kFold>(rest, 0, 0);
  for (; rest.groups >= 2; advance(1)) {
    make_room(1);
    add_block<kGroup, 1, kFold, false>(rest, none, weights, strips);
  }
  if (rest.groups > 0) {
    make_room(1);
    add_block<kGroup, 1, kFold, true>(rest, none, weights, strips);
  }
  widen_totals(rest.columns, strips);
}

template <int kGroup>
void project_any(const ByteBlock& block, const ByteWeights& weights, Strips& strips) {
  if (block.mirrored)
    project_groups<kGroup, true>(block, weights, strips);
  else
    project_groups<kGroup, false>(block, weights, strips);
}

// Adds unit·sums of one output of a strip, put back into the order of its columns, to `columns` numbers.
HWY_INLINE void add_in_order(const std::int32_t* HWY_RESTRICT from, double unit, double* HWY_RESTRICT to,
                             std::size_t columns) {
  constexpr std::size_t kInBlock = 16 / sizeof(std::int32_t);  // lanes that interleaving keeps together
  const hn::CappedTag<std::int32_t, kInBlock> d_quad;
  const hn::CappedTag<double, kInBlock> d_double;
  const hn::Rebind<std::int32_t, decltype(d_double)> d_int;
  HWY_ALIGN std::array<std::int32_t, kVectors * hn::MaxLanes(d32)> in_order;
  for (std::size_t half = 0; half < 2; ++half) {  // of the columns that share a block
    const Sum32 even = hn::Load(d32, from + half * hn::Lanes(d32));
    const Sum32 odd = hn::Load(d32, from + (2 + half) * hn::Lanes(d32));
    HWY_ALIGN std::array<std::int32_t, 2 * hn::MaxLanes(d32)> quads;
    hn::Store(hn::InterleaveLower(d32, even, odd), d32, quads.data());
    hn::Store(hn::InterleaveUpper(d32, even, odd), d32, quads.data() + hn::Lanes(d32));
    for (std::size_t block = 0; block < hn::Lanes(d32) / kInBlock; ++block)
      for (std::size_t quad = 0; quad < 2; ++quad)
        hn::Store(hn::Load(d_quad, quads.data() + quad * hn::Lanes(d32) + block * kInBlock), d_quad,
                  in_order.data() + (4 * block + 2 * half + quad) * kInBlock);
  }
  if (columns < in_order.size()) {
    for (std::size_t c = 0; c < columns; ++c) to[c] += unit * in_order[c];
    return;
  }
  for (std::size_t c = 0; c < columns; c += hn::Lanes(d_double)) {
    const auto sums = hn::PromoteTo(d_double, hn::Load(d_int, in_order.data() + c));
    hn::StoreU(hn::Add(hn::LoadU(d_double, to + c), hn::Mul(hn::Set(d_double, unit), sums)), d_double, to + c);
  }
}

void ProjectBytes(const ByteBlock& block, const ByteWeights& weights, const ProjectionSums& to) {
  const std::size_t width = hn::Lanes(d8);
  Strips strips((block.columns + width - 1) / width, weights.parts.size());
  if (weights.row_group == 1) project_any<1>(block, weights, strips);
  if (weights.row_group == 2) project_any<2>(block, weights, strips);
  if (weights.row_group == 4) project_any<4>(block, weights, strips);
  if (weights.row_group == 8) project_any<8>(block, weights, strips);
  for (std::size_t c = 0; c < block.columns; ++c)
    to.moments.maximum[c] = std::max(to.moments.maximum[c], static_cast<double>(strips.maximum[c]));
  for (std::size_t c = 0; c < block.columns; c += width) {
    const std::size_t here = std::min(width, block.columns - c);
    const std::int32_t* from = strips.at(c).sums;
    for (const std::size_t part : weights.parts) {
      add_in_order(from, 1, to.sums + part * block.columns + c, here);
      from += width;
    }
    add_in_order(from, block.mirrored ? 0.5 : 1, to.moments.squares + c, here);
    add_in_order(from + width, 1, to.moments.totals + c, here);
  }
}

#endif  // HWY_TARGET == HWY_SCALAR

const hn::ScalableTag<double> d64;
using Sum64 = hn::Vec<decltype(d64)>;

HWY_INLINE Sum64 load_samples(const double* p) { return hn::LoadU(d64, p); }
HWY_INLINE Sum64 load_samples(const float* p) {
  return hn::PromoteTo(d64, hn::LoadU(hn::Rebind<float, decltype(d64)>(), p));
}
HWY_INLINE Sum64 load_samples(const std::uint16_t* p) {
  const hn::Rebind<std::int32_t, decltype(d64)> d_int;
  const hn::Rebind<std::uint16_t, decltype(d64)> d_short;
  return hn::PromoteTo(d64, hn::PromoteTo(d_int, hn::LoadU(d_short, p)));
}

// Adds kGroups groups of rows of one strip to up to three outputs.
template <int kOutputs, class T>
HWY_INLINE void add_sample_outputs(const T* HWY_RESTRICT pixels, std::ptrdiff_t stride, int row_group,
                                   std::size_t groups, const double* HWY_RESTRICT weights, std::size_t weights_stride,
                                   double* HWY_RESTRICT sums, std::size_t per_output, const Moments* moments) {
  Sum64 out[std::max(kOutputs, 1)];
  for (int o = 0; o < kOutputs; ++o) out[o] = hn::LoadU(d64, sums + static_cast<std::size_t>(o) * per_output);
  Sum64 total = hn::Zero(d64), square = total, top = total;
  if (moments) {
    total = hn::LoadU(d64, moments->totals);
    square = hn::LoadU(d64, moments->squares);
    top = hn::LoadU(d64, moments->maximum);
  }
  for (std::size_t g = 0; g < groups; ++g) {
    Sum64 v = load_samples(pixels);
    if (moments) top = hn::Max(top, v);
    pixels += stride;
    for (int i = 1; i < row_group; ++i, pixels += stride) {
      const Sum64 next = load_samples(pixels);
      if (moments) top = hn::Max(top, next);
      v = hn::Add(v, next);
    }
    for (int o = 0; o < kOutputs; ++o)
      out[o] = hn::MulAdd(v, hn::Set(d64, weights[static_cast<std::size_t>(o) * weights_stride + g]), out[o]);
    if (moments) total = hn::Add(total, v);
    if (moments) square = hn::MulAdd(v, v, square);
  }
  for (int o = 0; o < kOutputs; ++o) hn::StoreU(out[o], d64, sums + static_cast<std::size_t>(o) * per_output);
  if (!moments) return;
  hn::StoreU(total, d64, moments->totals);
  hn::StoreU(square, d64, moments->squares);
  hn::StoreU(top, d64, moments->maximum);
}

template <class T>
void add_sample_strip(const T* pixels, std::ptrdiff_t stride, int row_group, std::size_t groups, const double* weights,
                      std::size_t weights_stride, std::size_t outputs, double* sums, std::size_t per_output,
                      const Moments& moments) {
  for (std::size_t o = 0; o == 0 || o < outputs; o += 3) {
    const auto run = [&]<int kOutputs>() {
      add_sample_outputs<kOutputs>(pixels, stride, row_group, groups, weights + o * weights_stride, weights_stride,
                                   sums + o * per_output, per_output, o == 0 ? &moments : nullptr);
    };
    if (outputs - o >= 3) run.template operator()<3>();
    if (outputs - o == 2) run.template operator()<2>();
    if (outputs - o == 1) run.template operator()<1>();
    if (outputs == 0) run.template operator()<0>();
  }
}

template <class T>
void ProjectSamples(const SampleBlock<T>& block, const SampleWeights& weights, const ProjectionSums& to) {
  const std::size_t outputs = weights.outputs;
  const std::size_t strip = hn::Lanes(d64);
  const auto row_group = static_cast<std::size_t>(weights.row_group);
  const std::size_t groups_per_block = std::max<std::size_t>(kRowsPerSampleBlock / row_group, 1);
  const std::size_t whole = block.columns / strip * strip;
  const std::size_t rest = block.columns - whole;
  std::vector<T> padded(rest ? kRowsPerSampleBlock * strip : 0);
  std::vector<double> padded_sums((outputs + 3) * strip);
  double* moments = padded_sums.data() + outputs * strip;
  for (std::size_t g = 0; g < block.groups; g += groups_per_block) {
    const std::size_t groups = std::min(groups_per_block, block.groups - g);
    const T* pixels = block.pixels + static_cast<std::ptrdiff_t>(g * row_group) * block.row_stride;
    for (std::size_t c = 0; c < whole; c += strip)
      add_sample_strip(pixels + c, block.row_stride, weights.row_group, groups, weights.values + g, weights.stride,
                       outputs, to.sums + c, block.columns,
                       {to.moments.totals + c, to.moments.squares + c, to.moments.maximum + c});
    if (rest == 0) continue;
    for (std::size_t r = 0; r < groups * row_group; ++r)
      std::copy_n(pixels + static_cast<std::ptrdiff_t>(r) * block.row_stride + whole, rest, padded.data() + r * strip);
    std::fill(padded_sums.begin(), padded_sums.end(), 0.0);
    const auto row_of = [&](std::size_t o) {
      if (o < outputs) return to.sums + o * block.columns + whole;
      return std::array{to.moments.totals, to.moments.squares, to.moments.maximum}[o - outputs] + whole;
    };
    for (std::size_t o = 0; o < outputs + 3; ++o) std::copy_n(row_of(o), rest, padded_sums.data() + o * strip);
    add_sample_strip(padded.data(), static_cast<std::ptrdiff_t>(strip), weights.row_group, groups, weights.values + g,
                     weights.stride, outputs, padded_sums.data(), strip,
                     {moments, moments + strip, moments + 2 * strip});
    for (std::size_t o = 0; o < outputs + 3; ++o) std::copy_n(padded_sums.data() + o * strip, rest, row_of(o));
  }
}

void ProjectShorts(const SampleBlock<std::uint16_t>& block, const SampleWeights& weights, const ProjectionSums& to) {
  ProjectSamples(block, weights, to);
}
void ProjectFloats(const SampleBlock<float>& block, const SampleWeights& weights, const ProjectionSums& to) {
  ProjectSamples(block, weights, to);
}
void ProjectDoubles(const SampleBlock<double>& block, const SampleWeights& weights, const ProjectionSums& to) {
  ProjectSamples(block, weights, to);
}

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

const char* TargetName() { return hwy::TargetName(HWY_TARGET); }

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(ProjectBytes);
HWY_EXPORT(ProjectShorts);
HWY_EXPORT(ProjectFloats);
HWY_EXPORT(ProjectDoubles);
HWY_EXPORT(ReadBytes);
HWY_EXPORT(TargetName);

void project_bytes(const ByteBlock& block, const ByteWeights& weights, const ProjectionSums& to) {
  HWY_DYNAMIC_DISPATCH(ProjectBytes)(block, weights, to);
}

template <>
void project_samples(const SampleBlock<std::uint16_t>& block, const SampleWeights& weights, const ProjectionSums& to) {
  HWY_DYNAMIC_DISPATCH(ProjectShorts)(block, weights, to);
}
template <>
void project_samples(const SampleBlock<float>& block, const SampleWeights& weights, const ProjectionSums& to) {
  HWY_DYNAMIC_DISPATCH(ProjectFloats)(block, weights, to);
}
template <>
void project_samples(const SampleBlock<double>& block, const SampleWeights& weights, const ProjectionSums& to) {
  HWY_DYNAMIC_DISPATCH(ProjectDoubles)(block, weights, to);
}

std::uint64_t read_bytes(const std::uint8_t* data, std::size_t size) {
  return HWY_DYNAMIC_DISPATCH(ReadBytes)(data, size);
}

const char* target_name() { return HWY_DYNAMIC_DISPATCH(TargetName)(); }

}  // namespace ocisac::kernels
#endif
