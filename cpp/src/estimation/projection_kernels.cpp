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

template <int kGroup>
HWY_INLINE Sum16 sum_of_group(const std::uint8_t* HWY_RESTRICT pixels, std::ptrdiff_t stride) {
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  Sum16 sum = hn::PromoteTo(d16, hn::LoadU(d8, pixels));
  for (int i = 1; i < kGroup; ++i) sum = hn::Add(sum, hn::PromoteTo(d16, hn::LoadU(d8, pixels + i * stride)));
  return sum;
}

// Sums of a strip's columns, one 32-bit lane each. Interleaving permutes them in a way that lane_order() tells.
struct StripSums {
  std::int32_t* first;  // of output 0; two vectors an output
  std::ptrdiff_t per_output;
};

template <int kOutputs, std::size_t kPairs>
HWY_INLINE void add_outputs(const Pair16* HWY_RESTRICT lower, const Pair16* HWY_RESTRICT upper,
                            const std::int32_t* HWY_RESTRICT weights, std::size_t weights_stride, StripSums sums) {
  for (int o = 0; o < kOutputs; ++o) {
    std::int32_t* HWY_RESTRICT out = sums.first + o * sums.per_output;
    Sum32 low = hn::Load(d32, out);
    Sum32 high = hn::Load(d32, out + hn::Lanes(d32));
    for (std::size_t p = 0; p < kPairs; ++p) {
      const auto weight = hn::BitCast(d16s, hn::Set(d32, weights[static_cast<std::size_t>(o) * weights_stride + p]));
      low = multiply_pairs(low, lower[p], weight);
      high = multiply_pairs(high, upper[p], weight);
    }
    hn::Store(low, d32, out);
    hn::Store(high, d32, out + hn::Lanes(d32));
  }
}

// One block of rows of one strip of columns: all outputs, then the squares.
template <int kGroup, std::size_t kPairs>
HWY_INLINE void add_strip(const std::uint8_t* HWY_RESTRICT pixels, std::ptrdiff_t stride,
                          const std::int32_t* HWY_RESTRICT weights, std::size_t weights_stride, std::size_t outputs,
                          StripSums sums) {
  Pair16 lower[kPairs];
  Pair16 upper[kPairs];
  for (std::size_t p = 0; p < kPairs; ++p) {
    const std::uint8_t* rows = pixels + static_cast<std::ptrdiff_t>(2 * kGroup * p) * stride;
    const Sum16 even = sum_of_group<kGroup>(rows, stride);
    const Sum16 odd = sum_of_group<kGroup>(rows + kGroup * stride, stride);
    lower[p] = hn::BitCast(d16s, hn::InterleaveLower(d16, even, odd));
    upper[p] = hn::BitCast(d16s, hn::InterleaveUpper(d16, even, odd));
  }
  std::size_t o = 0;
  const auto rest = [&] {
    return StripSums{sums.first + static_cast<std::ptrdiff_t>(o) * sums.per_output, sums.per_output};
  };
  for (; o + 3 <= outputs; o += 3)
    add_outputs<3, kPairs>(lower, upper, weights + o * weights_stride, weights_stride, rest());
  for (; o < outputs; ++o) add_outputs<1, kPairs>(lower, upper, weights + o * weights_stride, weights_stride, rest());
  std::int32_t* HWY_RESTRICT out = rest().first;
  Sum32 low = hn::Load(d32, out);
  Sum32 high = hn::Load(d32, out + hn::Lanes(d32));
  for (std::size_t p = 0; p < kPairs; ++p) {
    low = multiply_pairs(low, lower[p], lower[p]);
    high = multiply_pairs(high, upper[p], upper[p]);
  }
  hn::Store(low, d32, out);
  hn::Store(high, d32, out + hn::Lanes(d32));
}

// Also brings the block to the caches: along rows, as memory is read best.
HWY_INLINE void raise_maximum(const ByteBlock& block, std::uint8_t* HWY_RESTRICT maximum) {
  const hn::ScalableTag<std::uint8_t> d8;
  const std::size_t lanes = hn::Lanes(d8);
  for (std::size_t r = 0; r < block.rows; ++r) {
    const std::uint8_t* HWY_RESTRICT row = block.pixels + static_cast<std::ptrdiff_t>(r) * block.row_stride;
    std::size_t c = 0;
    for (; c + lanes <= block.columns; c += lanes) {
#ifdef OCISAC_PREFETCH
      hwy::Prefetch(row + OCISAC_PREFETCH + c);
#endif
      hn::StoreU(hn::Max(hn::LoadU(d8, maximum + c), hn::LoadU(d8, row + c)), d8, maximum + c);
    }
    for (; c < block.columns; ++c) maximum[c] = std::max(maximum[c], row[c]);
  }
}

// The column, within a strip, whose sum ends up in each lane of the two vectors of an output.
std::vector<std::size_t> lane_order() {
  const std::size_t lanes = hn::Lanes(d16);
  std::vector<std::uint16_t> index(lanes);
  const auto iota = hn::Iota(d16, 0);
  const hn::ScalableTag<std::uint32_t> d32u;
  std::vector<std::uint32_t> out(lanes);
  hn::StoreU(hn::BitCast(d32u, hn::InterleaveLower(d16, iota, hn::Zero(d16))), d32u, out.data());
  hn::StoreU(hn::BitCast(d32u, hn::InterleaveUpper(d16, iota, hn::Zero(d16))), d32u, out.data() + lanes / 2);
  return {out.begin(), out.end()};
}

// Runs add_strip over all strips of a block of rows; the last, narrower strip goes through a padded copy.
template <int kGroup, std::size_t kPairs>
void add_block(const ByteBlock& block, const std::int32_t* weights, std::size_t weights_stride, std::size_t outputs,
               std::int32_t* sums, std::size_t padded_columns) {
  const std::size_t strip = hn::Lanes(d16);
  const auto per_output = static_cast<std::ptrdiff_t>(padded_columns);
  std::size_t c = 0;
  for (; c + strip <= block.columns; c += strip)
    add_strip<kGroup, kPairs>(block.pixels + c, block.row_stride, weights, weights_stride, outputs,
                              {sums + c, per_output});
  if (c == block.columns) return;
  std::array<std::uint8_t, 2 * kGroup * kPairs * HWY_MAX_BYTES> padded{};
  for (std::size_t r = 0; r < 2 * kGroup * kPairs; ++r)
    std::copy_n(block.pixels + static_cast<std::ptrdiff_t>(r) * block.row_stride + c, block.columns - c,
                padded.data() + r * strip);
  add_strip<kGroup, kPairs>(padded.data(), static_cast<std::ptrdiff_t>(strip), weights, weights_stride, outputs,
                            {sums + c, per_output});
}

// A last single group has no partner: it gets one of zeros.
template <int kGroup>
void add_last_group(const ByteBlock& block, const std::int32_t* weights, std::size_t weights_stride,
                    std::size_t outputs, std::int32_t* sums, std::size_t padded_columns) {
  std::vector<std::uint8_t> padded(2 * kGroup * block.columns);
  for (std::size_t r = 0; r < kGroup; ++r)
    std::copy_n(block.pixels + static_cast<std::ptrdiff_t>(r) * block.row_stride, block.columns,
                padded.data() + r * block.columns);
  const ByteBlock pair{padded.data(), static_cast<std::ptrdiff_t>(block.columns), 2 * kGroup, block.columns};
  add_block<kGroup, 1>(pair, weights, weights_stride, outputs, sums, padded_columns);
}

template <int kGroup>
void project_groups(const ByteBlock& block, const std::int32_t* pairs, std::size_t pairs_stride, std::size_t outputs,
                    std::int32_t* sums, std::size_t padded_columns, std::uint8_t* maximum) {
  constexpr std::size_t kPairs = std::max<std::size_t>(kRowsPerBlock / (2 * kGroup), 1);
  constexpr std::size_t kRows = 2 * kGroup * kPairs;
  ByteBlock rest = block;
  const auto advance = [&](std::size_t rows) {
    rest.pixels += static_cast<std::ptrdiff_t>(rows) * rest.row_stride;
    rest.rows -= rows;
    pairs += rows / (2 * kGroup);
  };
  while (rest.rows >= kRows) {
    raise_maximum({rest.pixels, rest.row_stride, kRows, rest.columns}, maximum);
    add_block<kGroup, kPairs>(rest, pairs, pairs_stride, outputs, sums, padded_columns);
    advance(kRows);
  }
  while (rest.rows >= 2 * kGroup) {
    raise_maximum({rest.pixels, rest.row_stride, 2 * kGroup, rest.columns}, maximum);
    add_block<kGroup, 1>(rest, pairs, pairs_stride, outputs, sums, padded_columns);
    advance(2 * kGroup);
  }
  if (rest.rows > 0) {
    raise_maximum({rest.pixels, rest.row_stride, kGroup, rest.columns}, maximum);
    add_last_group<kGroup>(rest, pairs, pairs_stride, outputs, sums, padded_columns);
    advance(kGroup);
  }
}

// Adds the sums of one output to those of the chunks before, back in the order of the columns.
void add_in_order(const std::int32_t* HWY_RESTRICT from, const std::vector<std::size_t>& order, double* HWY_RESTRICT to,
                  std::size_t columns) {
  const std::size_t strip = order.size();
  std::size_t c = 0;
  for (; c + strip <= columns; c += strip)
    for (std::size_t lane = 0; lane < strip; ++lane) to[c + order[lane]] += static_cast<double>(from[c + lane]);
  for (std::size_t lane = 0; lane < strip; ++lane)
    if (c + order[lane] < columns) to[c + order[lane]] += static_cast<double>(from[c + lane]);
}

void ProjectBytes(const ByteBlock& block, int row_group, const std::int32_t* pairs, std::size_t pairs_stride,
                  std::size_t outputs, double* sums, double* squares, std::uint8_t* maximum) {
  const std::size_t strip = hn::Lanes(d16);
  const std::size_t padded_columns = (block.columns + strip - 1) / strip * strip;
  const auto integers = hwy::AllocateAligned<std::int32_t>((outputs + 1) * padded_columns);
  std::fill_n(integers.get(), (outputs + 1) * padded_columns, 0);
  const auto run = [&]<int kGroup>() {
    project_groups<kGroup>(block, pairs, pairs_stride, outputs, integers.get(), padded_columns, maximum);
  };
  if (row_group == 1) run.template operator()<1>();
  if (row_group == 2) run.template operator()<2>();
  if (row_group == 4) run.template operator()<4>();
  if (row_group == 8) run.template operator()<8>();
  const auto order = lane_order();
  for (std::size_t o = 0; o <= outputs; ++o)
    add_in_order(integers.get() + o * padded_columns, order, o < outputs ? sums + o * block.columns : squares,
                 block.columns);
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
