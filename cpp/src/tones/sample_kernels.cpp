#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "tones/projection_kernels.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tones/sample_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include "tones/projection_kernels-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

const hn::ScalableTag<double> d64;
using Sum64 = hn::Vec<decltype(d64)>;

// The light of a vector of bytes: with AVX2 straight to registers, since stores, one in a cycle, would be the limit.
HWY_INLINE Sum64 light_of(const std::uint8_t* p, const double* light) {
#if HWY_TARGET == HWY_AVX2
  std::uint32_t four = 0;
  std::memcpy(&four, p, sizeof(four));
  const auto two = [&](std::uint32_t bytes) OCISAC_INLINE_LAMBDA {
    return _mm_loadh_pd(_mm_load_sd(light + (bytes & 255)), light + ((bytes >> 8) & 255));
  };
  return Sum64{_mm256_set_m128d(two(four >> 16), two(four))};
#else
  alignas(64) double values[hn::MaxLanes(d64)];
  for (std::size_t i = 0; i < hn::Lanes(d64); ++i) values[i] = light[p[i]];
  return hn::Load(d64, values);
#endif
}

HWY_INLINE Sum64 to_double(Sum64 v) { return v; }
template <class V>
HWY_INLINE Sum64 to_double(V v) {
  return hn::PromoteTo(d64, v);
}

// Samples as they are loaded, whose maximum is taken, and as their rows are added up. In double vectors twice as wide
// are two operations with AVX-512 on some processors; integers are added up without rounding in narrower ones.
template <class V>
HWY_INLINE auto as_loaded(V samples) {
  if constexpr (kWide)
    return samples;
  else
    return to_double(samples);
}
HWY_INLINE auto load_samples(const std::uint8_t* p, const double* light) { return light_of(p, light); }
HWY_INLINE auto load_samples(const double* p, const double* /*light*/) { return hn::LoadU(d64, p); }
HWY_INLINE auto load_samples(const float* p, const double* /*light*/) {
  return as_loaded(hn::LoadU(hn::Rebind<float, decltype(d64)>(), p));
}
HWY_INLINE auto load_samples(const std::uint16_t* p, const double* /*light*/) {
  const hn::Rebind<std::int32_t, decltype(d64)> d_int;
  return as_loaded(hn::PromoteTo(d_int, hn::LoadU(hn::Rebind<std::uint16_t, decltype(d64)>(), p)));
}

template <class V>
HWY_INLINE auto to_sum(V v) {
  if constexpr (std::is_integral_v<hn::TFromV<V> >)
    return v;
  else
    return to_double(v);
}

template <class T>
using Loaded = decltype(load_samples(static_cast<const T*>(nullptr), nullptr));
template <class T>
using RowSum = decltype(to_sum(std::declval<Loaded<T> >()));

// A strip of columns of other samples: sums of four vectors and all of a tone stay in registers.
constexpr std::size_t kSampleVectors = kWide ? 4 : HWY_TARGET == HWY_SCALAR ? 1 : 2, kOutputsAtOnce = 6;

// Offsets from the rows of a strip to those of strips ahead, whose lines they ask for; none in the cache.
template <class T>
constexpr std::array<std::size_t, 2> kSampleStripsAhead{5, 3};
template <>
constexpr std::array<std::size_t, 1> kSampleStripsAhead<std::uint8_t>{kLine / (kSampleVectors * hn::MaxLanes(d64))};
template <class T, bool kAsk>
using SamplesAhead = std::array<std::ptrdiff_t, kAsk ? kSampleStripsAhead<T>.size() : 0>;

constexpr std::array<std::ptrdiff_t, 0> kNothingAhead{};

template <class T, std::size_t kCount>
HWY_INLINE void ask_for_samples(const T* pixels, const std::array<std::ptrdiff_t, kCount>& ahead) {
  for (const std::ptrdiff_t offset : ahead)
    for (std::size_t i = 0; i < kSampleVectors * hn::MaxLanes(d64); i += kLine / sizeof(T))
      hwy::Prefetch(pixels + offset + i);
}

// Sum of a group of rows of a vector's columns; raises the maximum. The rows ask for the lines `ahead`.
template <bool kSingle, class T, class Ahead>
HWY_INLINE RowSum<T> sum_of_samples(const T* HWY_RESTRICT pixels, const double* light, std::ptrdiff_t stride,
                                    int row_group, const Ahead& ahead, Loaded<T>& top) {
  ask_for_samples(pixels, ahead);
  const Loaded<T> first = load_samples(pixels, light);
  top = hn::Max(top, first);
  RowSum<T> sum = to_sum(first);
  for (int i = 1; !kSingle && i < row_group; ++i) {
    pixels += stride;
    ask_for_samples(pixels, ahead);
    const Loaded<T> next = load_samples(pixels, light);
    top = hn::Max(top, next);
    sum = hn::Add(sum, to_sum(next));
  }
  return sum;
}

// Memory for the sums of groups of a strip; folded, those with the mirror images and, from the middle on, differences.
template <std::size_t kVectors>
constexpr std::size_t kKeptSums = kSampleRows* kVectors* hn::MaxLanes(d64);

// Lines that a strip's rows and, folded, their mirror images ask for.
template <class T, bool kAsk>
struct StripAhead {
  SamplesAhead<T, kAsk> near{}, far{};
};

// Groups of rows of one strip: moments and the first kOutputs outputs, folded one of each kind, or with kKeep the sums
// of groups, for all. Folded, an output takes one multiply-add for two rows, and so do the squares of both: those of
// sum and difference are twice as large.
template <std::size_t kOutputs, std::size_t kVectors, bool kKeep, bool kFold, bool kSingle, class T, class Ahead>
HWY_INLINE void add_groups(const SampleBlock<T>& strip, const Ahead& ahead, const SampleWeights& weights,
                           const ProjectionSums& to, double* HWY_RESTRICT kept) {
  static_assert(!kFold || kOutputs == 0 || kOutputs == 2);
  constexpr std::size_t kRoom = std::max<std::size_t>(kOutputs, 1);
  const std::size_t lanes = hn::Lanes(d64);
  Sum64 out[kRoom][kVectors], total[kVectors], square[kVectors];
  Loaded<T> top[kVectors];
  const double* row[kRoom];
  double* sums[kRoom];
  for_each_constant<kOutputs>([&](auto o) OCISAC_INLINE_LAMBDA {
    row[o] = weights.values + weights.order[o] * weights.stride;
    sums[o] = to.sums + weights.order[o] * to.stride;
  });
  for_each_constant<kVectors>([&](auto v) OCISAC_INLINE_LAMBDA {
    for_each_constant<kOutputs>([&](auto o) OCISAC_INLINE_LAMBDA { out[o][v] = hn::LoadU(d64, sums[o] + v * lanes); });
    total[v] = hn::LoadU(d64, to.totals + v * lanes);
    square[v] = kFold ? hn::Zero(d64) : hn::LoadU(d64, to.squares + v * lanes);
    const hn::DFromV<Loaded<T> > d;
    top[v] = hn::Set(d, -std::numeric_limits<hn::TFromD<decltype(d)> >::infinity());  // integers: 0
  });
  const std::ptrdiff_t step = weights.row_group * strip.row_stride;
  const T *near = strip.pixels, *far = strip.mirrored;
  for (std::size_t g = 0; g < strip.groups; ++g, near += step) {
    for_each_constant<kVectors>([&](auto v) OCISAC_INLINE_LAMBDA {
      const auto rows = [&](const T* at, const auto& lines) OCISAC_INLINE_LAMBDA {
        if constexpr (v == 0)
          return sum_of_samples<kSingle>(at, strip.light, strip.row_stride, weights.row_group, lines, top[v]);
        else
          return sum_of_samples<kSingle>(at + v * lanes, strip.light, strip.row_stride, weights.row_group,
                                         kNothingAhead, top[v]);
      };
      const RowSum<T> here = rows(near, ahead.near);
      Sum64 sum, difference;
      if constexpr (kFold) {
        const RowSum<T> there = rows(far, ahead.far);
        sum = to_double(hn::Add(here, there));
        difference = to_double(hn::Sub(here, there));
        square[v] = hn::MulAdd(difference, difference, square[v]);
      } else {
        sum = difference = to_double(here);
      }
      square[v] = hn::MulAdd(sum, sum, square[v]);
      total[v] = hn::Add(total[v], sum);
      for_each_constant<kOutputs>([&](auto o) OCISAC_INLINE_LAMBDA {
        out[o][v] = hn::MulAdd(o == 0 ? sum : difference, hn::Set(d64, row[o][g]), out[o][v]);
      });
      if (kKeep) hn::StoreU(sum, d64, kept + (g * kVectors + v) * lanes);
      if (kKeep && kFold) hn::StoreU(difference, d64, kept + kKeptSums<kVectors> / 2 + (g * kVectors + v) * lanes);
    });
    if (kFold) far -= step;
  }
  for_each_constant<kVectors>([&](auto v) OCISAC_INLINE_LAMBDA {
    for_each_constant<kOutputs>([&](auto o) OCISAC_INLINE_LAMBDA { hn::StoreU(out[o][v], d64, sums[o] + v * lanes); });
    hn::StoreU(total[v], d64, to.totals + v * lanes);
    double* const squares = to.squares + v * lanes;
    if (kFold) square[v] = hn::MulAdd(square[v], hn::Set(d64, 0.5), hn::LoadU(d64, squares));
    hn::StoreU(square[v], d64, squares);
    double* const maximum = to.maximum + v * lanes;
    hn::StoreU(hn::Max(hn::LoadU(d64, maximum), to_double(top[v])), d64, maximum);
  });
}

// The outputs `which`, from kept sums of groups.
template <std::size_t kOutputs, std::size_t kVectors>
HWY_INLINE void add_kept_outputs(const double* HWY_RESTRICT kept, std::size_t groups, const SampleWeights& weights,
                                 const std::size_t* which, const ProjectionSums& to) {
  const std::size_t lanes = hn::Lanes(d64);
  Sum64 out[kOutputs][kVectors];
  const double* row[kOutputs];
  for_each_constant<kOutputs>([&](auto o) OCISAC_INLINE_LAMBDA {
    row[o] = weights.values + which[o] * weights.stride;
    const double* sums = to.sums + which[o] * to.stride;
    for_each_constant<kVectors>([&](auto v) OCISAC_INLINE_LAMBDA { out[o][v] = hn::LoadU(d64, sums + v * lanes); });
  });
  for (std::size_t g = 0; g < groups; ++g) {
    Sum64 sum[kVectors];
    for_each_constant<kVectors>(
        [&](auto v) OCISAC_INLINE_LAMBDA { sum[v] = hn::LoadU(d64, kept + (g * kVectors + v) * lanes); });
    for_each_constant<kOutputs>([&](auto o) OCISAC_INLINE_LAMBDA {
      const Sum64 weight = hn::Set(d64, row[o][g]);
      for_each_constant<kVectors>([&](auto v)
                                      OCISAC_INLINE_LAMBDA { out[o][v] = hn::MulAdd(sum[v], weight, out[o][v]); });
    });
  }
  for_each_constant<kOutputs>([&](auto o) OCISAC_INLINE_LAMBDA {
    double* sums = to.sums + which[o] * to.stride;
    for_each_constant<kVectors>([&](auto v) OCISAC_INLINE_LAMBDA { hn::StoreU(out[o][v], d64, sums + v * lanes); });
  });
}

template <std::size_t kVectors>
HWY_INLINE void add_kept_outputs(const double* kept, std::size_t groups, const SampleWeights& weights,
                                 std::span<const std::size_t> which, const ProjectionSums& to) {
  std::size_t done = 0;
  const auto add = [&]<std::size_t kOutputs>() {
    for (; done + kOutputs <= which.size(); done += kOutputs)
      add_kept_outputs<kOutputs, kVectors>(kept, groups, weights, which.data() + done, to);
  };
  add.template operator()<kOutputsAtOnce>();
  add.template operator()<2>();
  add.template operator()<1>();
}

// All outputs of one strip.
template <std::size_t kVectors, bool kSingle, class T, class Ahead>
void add_sample_strip(const SampleBlock<T>& strip, const Ahead& ahead, const SampleWeights& weights,
                      const ProjectionSums& to) {
  const auto add = [&]<std::size_t kOutputs, bool kKeep, bool kFold>(double* kept) {
    add_groups<kOutputs, kVectors, kKeep, kFold, kSingle>(strip, ahead, weights, to, kept);
  };
  const std::size_t outputs = weights.order.size();
  if (outputs == 0) return add.template operator()<0, false, false>(nullptr);
  if (outputs == 2 && strip.mirrored) return add.template operator()<2, false, true>(nullptr);
  if (outputs == 2) return add.template operator()<2, false, false>(nullptr);
  alignas(64) double kept[kKeptSums<kVectors>];
  if (!strip.mirrored) {
    add.template operator()<0, true, false>(kept);
    return add_kept_outputs<kVectors>(kept, strip.groups, weights, weights.order, to);
  }
  add.template operator()<0, true, true>(kept);
  add_kept_outputs<kVectors>(kept, strip.groups, weights, weights.order.first(weights.even), to);
  add_kept_outputs<kVectors>(kept + kKeptSums<kVectors> / 2, strip.groups, weights, weights.order.subspan(weights.even),
                             to);
}

template <std::size_t kVectors, class T, class Ahead>
void add_sample_strip(const SampleBlock<T>& strip, const Ahead& ahead, const SampleWeights& weights,
                      const ProjectionSums& to) {
  if constexpr (kVectors > 1)  // for the last columns of a row, groups of one row need no code of their own
    if (weights.row_group == 1) return add_sample_strip<kVectors, true>(strip, ahead, weights, to);
  add_sample_strip<kVectors, false>(strip, ahead, weights, to);
}

// The first row of the mirror images of a block.
template <class T>
const T* first_mirrored(const SampleBlock<T>& block, const SampleWeights& weights) {
  return block.mirrored - static_cast<std::ptrdiff_t>(block.groups - 1) * weights.row_group * block.row_stride;
}

// The last columns, fewer than a vector, in padded copies.
template <class T>
void add_last_columns(const SampleBlock<T>& block, const SampleWeights& weights, const ProjectionSums& to) {
  constexpr std::size_t kLanes = hn::MaxLanes(d64);
  const std::size_t rows = block.groups * static_cast<std::size_t>(weights.row_group), outputs = weights.order.size();
  const auto back = static_cast<std::ptrdiff_t>(rows) - weights.row_group;  // from the last group to the first
  std::array<T, kSampleRows * kLanes> near{}, far{};
  const auto copy = [&](const T* from, std::array<T, kSampleRows * kLanes>& copies) {
    for (std::size_t r = 0; r < rows; ++r)
      std::copy_n(from + static_cast<std::ptrdiff_t>(r) * block.row_stride, block.columns, copies.data() + r * kLanes);
  };
  copy(block.pixels, near);
  if (block.mirrored) copy(first_mirrored(block, weights), far);
  std::vector<double> sums((outputs + 3) * kLanes);
  double* moments = sums.data() + outputs * kLanes;
  const auto row_of = [&](std::size_t o) {
    if (o < outputs) return to.sums + o * to.stride;
    return std::array{to.totals, to.squares, to.maximum}[o - outputs];
  };
  for (std::size_t o = 0; o < outputs + 3; ++o) std::copy_n(row_of(o), block.columns, sums.data() + o * kLanes);
  const T* mirrored = block.mirrored ? far.data() + static_cast<std::size_t>(back) * kLanes : nullptr;
  add_sample_strip<1>(SampleBlock<T>{near.data(), mirrored, kLanes, block.groups, block.columns, 0, block.light},
                      StripAhead<T, false>(), weights,
                      {sums.data(), kLanes, moments, moments + kLanes, moments + 2 * kLanes});
  for (std::size_t o = 0; o < outputs + 3; ++o) std::copy_n(sums.data() + o * kLanes, block.columns, row_of(o));
}

template <bool kAsk, class T>
void project_strips(const SampleBlock<T>& block, const SampleWeights& weights, const ProjectionSums& to) {
  const auto from = [&](std::size_t c) {
    const T* mirrored = block.mirrored ? block.mirrored + c : nullptr;
    return SampleBlock<T>{block.pixels + c,  mirrored, block.row_stride, block.groups,
                          block.columns - c, 0,        block.light};
  };
  const auto sums = [&](std::size_t c) {
    return ProjectionSums{to.sums + c, to.stride, to.totals + c, to.squares + c, to.maximum + c};
  };
  const std::size_t strip = kSampleVectors * hn::Lanes(d64), lanes = hn::Lanes(d64);
  std::size_t c = 0;
  for (; c + strip <= block.columns; c += strip) {
    StripAhead<T, kAsk> ahead;
    for (std::size_t n = 0; n < ahead.near.size(); ++n) {
      const auto offset = static_cast<std::ptrdiff_t>(kSampleStripsAhead<T>[n] * strip);
      const auto columns = static_cast<std::ptrdiff_t>(block.columns);
      const bool past = static_cast<std::ptrdiff_t>(c) + offset >= columns;
      ahead.near[n] = offset + (past ? block.to_next - columns : 0);
      ahead.far[n] = offset + (past ? -block.to_next - columns : 0);
    }
    add_sample_strip<kSampleVectors>(from(c), ahead, weights, sums(c));
  }
  for (; c + lanes <= block.columns; c += lanes) add_sample_strip<1>(from(c), StripAhead<T, false>(), weights, sums(c));
  if (c < block.columns) add_last_columns(from(c), weights, sums(c));
}

void ProjectSamples(const AnySampleBlock& any, const SampleWeights& weights, const ProjectionSums& to) {
  std::visit(
      [&]<class T>(const SampleBlock<T>& block) HWY_ATTR {
        const auto project = block.to_next == 0 ? project_strips<false, T> : project_strips<true, T>;
        project(block, weights, to);
      },
      any);
}

bool TakesLightOfBytes() { return HWY_TARGET == HWY_AVX2; }

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(ProjectSamples);
HWY_EXPORT(TakesLightOfBytes);

void project_samples(const AnySampleBlock& block, const SampleWeights& weights, const ProjectionSums& to) {
  HWY_DYNAMIC_DISPATCH(ProjectSamples)(block, weights, to);
}

bool takes_light_of_bytes() { return HWY_DYNAMIC_DISPATCH(TakesLightOfBytes)(); }

}  // namespace ocisac::kernels
#endif
