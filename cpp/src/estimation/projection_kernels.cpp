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
constexpr std::size_t kRowsPerBlock = 16;

#if HWY_TARGET == HWY_SCALAR

// Without vectors: the loops as they are meant.
void ProjectBytes(const ByteBlock& block, int row_group, const std::int32_t* pairs, std::size_t pairs_stride,
                  std::size_t outputs, double* sums, double* squares, std::uint8_t* maximum) {
  const auto group = static_cast<std::size_t>(row_group);
  for (std::size_t g = 0; g * group < block.rows; ++g)
    for (std::size_t c = 0; c < block.columns; ++c) {
      std::int32_t sum = 0;
      for (std::size_t r = g * group; r < (g + 1) * group; ++r) {
        const std::uint8_t v =
            block.pixels[static_cast<std::ptrdiff_t>(r) * block.row_stride + static_cast<std::ptrdiff_t>(c)];
        maximum[c] = std::max(maximum[c], v);
        sum += v;
      }
      for (std::size_t o = 0; o < outputs; ++o) {
        const auto pair = static_cast<std::uint32_t>(pairs[o * pairs_stride + g / 2]);
        const auto weight = static_cast<std::int16_t>(g % 2 == 0 ? pair & 0xffffU : pair >> 16);
        sums[o * block.columns + c] += weight * sum;
      }
      squares[c] += static_cast<double>(sum) * sum;
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

// Sum of kGroup rows of a strip; raises the maximum and asks for the rows `ahead` bytes further on.
template <int kGroup>
HWY_INLINE EvenOdd sum_of_group(const std::uint8_t* HWY_RESTRICT pixels, std::ptrdiff_t stride, std::ptrdiff_t ahead,
                                Bytes& maximum) {
  Sum16 all = hn::Zero(d16);  // even + 256·odd, modulo 2^16
  Sum16 odd = all;
  for (int i = 0; i < kGroup; ++i, pixels += stride) {
    hwy::Prefetch(pixels + ahead);
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

// A block of rows as add_strip sees it: kPairs pairs of groups, and where the next block lies.
struct Rows {
  const std::uint8_t* pixels;
  std::ptrdiff_t stride;
  std::ptrdiff_t ahead;
};

struct Weights {
  const std::int32_t* pairs;  // of the block's first pair of groups
  std::size_t stride;         // from output to output
  std::size_t outputs;
};

// One block of rows of one strip: all outputs, then the squares. sums: kVectors vectors an output.
template <int kGroup, std::size_t kPairs>
HWY_INLINE void add_strip(const Rows& rows, const Weights& weights, std::int32_t* HWY_RESTRICT sums,
                          std::uint8_t* HWY_RESTRICT maximum) {
  Pair16 pairs[kPairs][kVectors];
  Bytes top = hn::LoadU(d8, maximum);
  for (std::size_t p = 0; p < kPairs; ++p) {
    const std::uint8_t* first = rows.pixels + static_cast<std::ptrdiff_t>(2 * kGroup * p) * rows.stride;
    const EvenOdd a = sum_of_group<kGroup>(first, rows.stride, rows.ahead, top);
    const EvenOdd b = sum_of_group<kGroup>(first + kGroup * rows.stride, rows.stride, rows.ahead, top);
    interleave(a, b, pairs[p]);
  }
  hn::StoreU(top, d8, maximum);
  const std::size_t lanes = hn::Lanes(d32);
  for (std::size_t o = 0; o < weights.outputs; ++o, sums += kVectors * lanes) {
    Sum32 out[kVectors];
    for (std::size_t v = 0; v < kVectors; ++v) out[v] = hn::Load(d32, sums + v * lanes);
    for (std::size_t p = 0; p < kPairs; ++p) {
      const auto weight = hn::BitCast(d16s, hn::Set(d32, weights.pairs[o * weights.stride + p]));
      for (std::size_t v = 0; v < kVectors; ++v) out[v] = multiply_pairs(out[v], pairs[p][v], weight);
    }
    for (std::size_t v = 0; v < kVectors; ++v) hn::Store(out[v], d32, sums + v * lanes);
  }
  for (std::size_t v = 0; v < kVectors; ++v) {
    Sum32 square = hn::Load(d32, sums + v * lanes);
    for (std::size_t p = 0; p < kPairs; ++p) square = multiply_pairs(square, pairs[p][v], pairs[p][v]);
    hn::Store(square, d32, sums + v * lanes);
  }
}

// The column, within a strip, whose sum ends up in each lane of the vectors of an output.
std::vector<std::size_t> lane_order() {
  const std::size_t half = hn::Lanes(d16);
  std::vector<std::uint16_t> lanes(kVectors * half);
  const auto even = hn::Add(hn::Iota(d16, 0), hn::Iota(d16, 0));
  const auto none = hn::Zero(d16);
  Pair16 pairs[kVectors];
  interleave({even, hn::Add(even, hn::Set(d16, 1))}, {none, none}, pairs);
  for (std::size_t v = 0; v < kVectors; ++v) hn::StoreU(hn::BitCast(d16, pairs[v]), d16, lanes.data() + v * half);
  std::vector<std::size_t> order;
  for (std::size_t lane = 0; lane < lanes.size(); lane += 2) order.push_back(lanes[lane]);
  return order;
}

// Runs add_strip over all strips of a block of rows; the last, narrower strip goes through a padded copy.
template <int kGroup, std::size_t kPairs>
void add_block(const ByteBlock& block, bool is_last, const Weights& weights, std::int32_t* sums,
               std::uint8_t* maximum) {
  constexpr std::size_t kRows = 2 * kGroup * kPairs;
  const std::size_t strip = hn::Lanes(d8);
  const std::ptrdiff_t ahead = is_last ? 0 : static_cast<std::ptrdiff_t>(kRows) * block.row_stride;
  std::size_t c = 0;
  for (; c + strip <= block.columns; c += strip, sums += (weights.outputs + 1) * strip)
    add_strip<kGroup, kPairs>({block.pixels + c, block.row_stride, ahead}, weights, sums, maximum + c);
  if (c == block.columns) return;
  std::array<std::uint8_t, kRows * HWY_MAX_BYTES> padded{};
  for (std::size_t r = 0; r < kRows; ++r)
    std::copy_n(block.pixels + static_cast<std::ptrdiff_t>(r) * block.row_stride + c, block.columns - c,
                padded.data() + r * strip);
  add_strip<kGroup, kPairs>({padded.data(), static_cast<std::ptrdiff_t>(strip), 0}, weights, sums, maximum + c);
}

// A last single group has no partner: it gets one of zeros.
template <int kGroup>
void add_last_group(const ByteBlock& block, const Weights& weights, std::int32_t* sums, std::uint8_t* maximum) {
  std::vector<std::uint8_t> padded(2 * kGroup * block.columns);
  for (std::size_t r = 0; r < kGroup; ++r)
    std::copy_n(block.pixels + static_cast<std::ptrdiff_t>(r) * block.row_stride, block.columns,
                padded.data() + r * block.columns);
  const ByteBlock pair{padded.data(), static_cast<std::ptrdiff_t>(block.columns), 2 * kGroup, block.columns};
  add_block<kGroup, 1>(pair, true, weights, sums, maximum);
}

template <int kGroup>
void project_groups(ByteBlock rest, Weights weights, std::int32_t* sums, std::uint8_t* maximum) {
  constexpr std::size_t kPairs = std::max<std::size_t>(kRowsPerBlock / (2 * kGroup), 1);
  constexpr std::size_t kRows = 2 * kGroup * kPairs;
  const auto advance = [&](std::size_t rows) {
    rest.pixels += static_cast<std::ptrdiff_t>(rows) * rest.row_stride;
    rest.rows -= rows;
    weights.pairs += rows / (2 * kGroup);
  };
  for (; rest.rows >= kRows; advance(kRows))
    add_block<kGroup, kPairs>(rest, rest.rows < 2 * kRows, weights, sums, maximum);
  for (; rest.rows >= 2 * kGroup; advance(2 * kGroup)) add_block<kGroup, 1>(rest, true, weights, sums, maximum);
  if (rest.rows > 0) add_last_group<kGroup>(rest, weights, sums, maximum);
}

// Adds the sums of all outputs and the squares to those of the chunks before, back in the order of the columns.
void add_in_order(const std::int32_t* HWY_RESTRICT from, std::size_t outputs, std::size_t columns, double* sums,
                  double* squares) {
  const auto order = lane_order();
  const std::size_t strip = order.size();
  for (std::size_t c = 0; c < columns; c += strip)
    for (std::size_t o = 0; o <= outputs; ++o, from += strip) {
      double* HWY_RESTRICT to = (o < outputs ? sums + o * columns : squares) + c;
      if (c + strip <= columns)
        for (std::size_t lane = 0; lane < strip; ++lane) to[order[lane]] += static_cast<double>(from[lane]);
      else
        for (std::size_t lane = 0; lane < strip; ++lane)
          if (c + order[lane] < columns) to[order[lane]] += static_cast<double>(from[lane]);
    }
}

void ProjectBytes(const ByteBlock& block, int row_group, const std::int32_t* pairs, std::size_t pairs_stride,
                  std::size_t outputs, double* sums, double* squares, std::uint8_t* maximum) {
  const std::size_t strip = hn::Lanes(d8);
  const std::size_t padded_columns = (block.columns + strip - 1) / strip * strip;
  const auto integers = hwy::AllocateAligned<std::int32_t>((outputs + 1) * padded_columns);
  std::fill_n(integers.get(), (outputs + 1) * padded_columns, 0);
  std::vector<std::uint8_t> top(padded_columns);
  const Weights weights{pairs, pairs_stride, outputs};
  if (row_group == 1) project_groups<1>(block, weights, integers.get(), top.data());
  if (row_group == 2) project_groups<2>(block, weights, integers.get(), top.data());
  if (row_group == 4) project_groups<4>(block, weights, integers.get(), top.data());
  if (row_group == 8) project_groups<8>(block, weights, integers.get(), top.data());
  for (std::size_t c = 0; c < block.columns; ++c) maximum[c] = std::max(maximum[c], top[c]);
  add_in_order(integers.get(), outputs, block.columns, sums, squares);
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
                                   double* HWY_RESTRICT sums, std::size_t per_output, double* HWY_RESTRICT squares,
                                   double* HWY_RESTRICT maximum) {
  Sum64 out[kOutputs];
  for (int o = 0; o < kOutputs; ++o) out[o] = hn::LoadU(d64, sums + static_cast<std::size_t>(o) * per_output);
  Sum64 square = hn::Zero(d64);
  Sum64 top = hn::Zero(d64);
  if (squares) square = hn::LoadU(d64, squares);
  if (squares) top = hn::LoadU(d64, maximum);
  for (std::size_t g = 0; g < groups; ++g) {
    Sum64 v = load_samples(pixels);
    if (squares) top = hn::Max(top, v);
    pixels += stride;
    for (int i = 1; i < row_group; ++i, pixels += stride) {
      const Sum64 next = load_samples(pixels);
      if (squares) top = hn::Max(top, next);
      v = hn::Add(v, next);
    }
    for (int o = 0; o < kOutputs; ++o)
      out[o] = hn::MulAdd(v, hn::Set(d64, weights[static_cast<std::size_t>(o) * weights_stride + g]), out[o]);
    if (squares) square = hn::MulAdd(v, v, square);
  }
  for (int o = 0; o < kOutputs; ++o) hn::StoreU(out[o], d64, sums + static_cast<std::size_t>(o) * per_output);
  if (squares) hn::StoreU(square, d64, squares);
  if (squares) hn::StoreU(top, d64, maximum);
}

template <class T>
void add_sample_strip(const T* pixels, std::ptrdiff_t stride, int row_group, std::size_t groups, const double* weights,
                      std::size_t weights_stride, std::size_t outputs, double* sums, std::size_t per_output,
                      double* squares, double* maximum) {
  for (std::size_t o = 0; o < outputs; o += 3) {
    const auto run = [&]<int kOutputs>() {
      add_sample_outputs<kOutputs>(pixels, stride, row_group, groups, weights + o * weights_stride, weights_stride,
                                   sums + o * per_output, per_output, o == 0 ? squares : nullptr, maximum);
    };
    if (outputs - o >= 3) run.template operator()<3>();
    if (outputs - o == 2) run.template operator()<2>();
    if (outputs - o == 1) run.template operator()<1>();
  }
}

template <class T>
void ProjectSamples(const SampleBlock<T>& block, int row_group, const double* weights, std::size_t weights_stride,
                    std::size_t outputs, double* sums, double* squares, double* maximum) {
  const std::size_t strip = hn::Lanes(d64);
  const std::size_t groups_per_block = std::max<std::size_t>(kRowsPerBlock / static_cast<std::size_t>(row_group), 1);
  const std::size_t whole = block.columns / strip * strip;
  const std::size_t rest = block.columns - whole;
  std::vector<T> padded(rest ? kRowsPerBlock * strip : 0);
  std::vector<double> padded_sums((outputs + 2) * strip);
  for (std::size_t g = 0; g < block.groups; g += groups_per_block) {
    const std::size_t groups = std::min(groups_per_block, block.groups - g);
    const T* pixels = block.pixels + static_cast<std::ptrdiff_t>(g) * row_group * block.row_stride;
    for (std::size_t c = 0; c < whole; c += strip)
      add_sample_strip(pixels + c, block.row_stride, row_group, groups, weights + g, weights_stride, outputs, sums + c,
                       block.columns, squares + c, maximum + c);
    if (rest == 0) continue;
    for (std::size_t r = 0; r < groups * static_cast<std::size_t>(row_group); ++r)
      std::copy_n(pixels + static_cast<std::ptrdiff_t>(r) * block.row_stride + whole, rest, padded.data() + r * strip);
    std::fill(padded_sums.begin(), padded_sums.end(), 0.0);
    const auto row_of = [&](std::size_t o) {
      return o < outputs ? sums + o * block.columns + whole : (o == outputs ? squares : maximum) + whole;
    };
    for (std::size_t o = 0; o < outputs + 2; ++o) std::copy_n(row_of(o), rest, padded_sums.data() + o * strip);
    add_sample_strip(padded.data(), static_cast<std::ptrdiff_t>(strip), row_group, groups, weights + g, weights_stride,
                     outputs, padded_sums.data(), strip, padded_sums.data() + outputs * strip,
                     padded_sums.data() + (outputs + 1) * strip);
    for (std::size_t o = 0; o < outputs + 2; ++o) std::copy_n(padded_sums.data() + o * strip, rest, row_of(o));
  }
}

void ProjectShorts(const SampleBlock<std::uint16_t>& block, int row_group, const double* weights, std::size_t stride,
                   std::size_t outputs, double* sums, double* squares, double* maximum) {
  ProjectSamples(block, row_group, weights, stride, outputs, sums, squares, maximum);
}
void ProjectFloats(const SampleBlock<float>& block, int row_group, const double* weights, std::size_t stride,
                   std::size_t outputs, double* sums, double* squares, double* maximum) {
  ProjectSamples(block, row_group, weights, stride, outputs, sums, squares, maximum);
}
void ProjectDoubles(const SampleBlock<double>& block, int row_group, const double* weights, std::size_t stride,
                    std::size_t outputs, double* sums, double* squares, double* maximum) {
  ProjectSamples(block, row_group, weights, stride, outputs, sums, squares, maximum);
}

std::uint64_t ReadBytes(const std::uint8_t* data, std::size_t size) {
#if HWY_TARGET == HWY_SCALAR
  return std::accumulate(data, data + size, std::uint64_t{0});
#else
  const hn::ScalableTag<std::uint8_t> d8;
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

void project_bytes(const ByteBlock& block, int row_group, const std::int32_t* pairs, std::size_t pairs_stride,
                   std::size_t outputs, double* sums, double* squares, std::uint8_t* maximum) {
  HWY_DYNAMIC_DISPATCH(ProjectBytes)(block, row_group, pairs, pairs_stride, outputs, sums, squares, maximum);
}

template <>
void project_samples(const SampleBlock<std::uint16_t>& block, int row_group, const double* weights, std::size_t stride,
                     std::size_t outputs, double* sums, double* squares, double* maximum) {
  HWY_DYNAMIC_DISPATCH(ProjectShorts)(block, row_group, weights, stride, outputs, sums, squares, maximum);
}
template <>
void project_samples(const SampleBlock<float>& block, int row_group, const double* weights, std::size_t stride,
                     std::size_t outputs, double* sums, double* squares, double* maximum) {
  HWY_DYNAMIC_DISPATCH(ProjectFloats)(block, row_group, weights, stride, outputs, sums, squares, maximum);
}
template <>
void project_samples(const SampleBlock<double>& block, int row_group, const double* weights, std::size_t stride,
                     std::size_t outputs, double* sums, double* squares, double* maximum) {
  HWY_DYNAMIC_DISPATCH(ProjectDoubles)(block, row_group, weights, stride, outputs, sums, squares, maximum);
}

std::uint64_t read_bytes(const std::uint8_t* data, std::size_t size) {
  return HWY_DYNAMIC_DISPATCH(ReadBytes)(data, size);
}

const char* target_name() { return HWY_DYNAMIC_DISPATCH(TargetName)(); }

}  // namespace ocisac::kernels
#endif
