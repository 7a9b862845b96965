#include "chips/sequence_kernels.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "chips/sequence_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// A trellis has at least two of its vectors in half of its states.
const hn::CappedTag<float, kTrellisGroup> d;
using Floats = hn::Vec<decltype(d)>;

void FillPatterns(const std::array<const float*, 2>& tables, std::size_t counts, float* HWY_RESTRICT patterns) {
  const hn::RebindToSigned<decltype(d)> di;
  const auto within = hn::IndicesFromVec(d, hn::LoadU(di, kBits.data()));  // those of the lanes of a vector
  for (std::size_t m = 0; m < counts; ++m)
    for (const float* table : tables)
      for (std::size_t i = 0; i < kTrellisGroup; i += hn::Lanes(d), patterns += hn::Lanes(d))
        hn::StoreU(hn::TableLookupLanes(hn::LoadU(d, table + m + kBits[i]), within), d, patterns);
}

// The costs of a group of histories: the sum of as many parts.
template <std::size_t kParts>
struct Group {
  std::array<const float*, kParts> parts;
  [[nodiscard]] HWY_INLINE Floats at(std::size_t i) const {
    Floats sum = hn::LoadU(d, parts[0] + i);
    for (std::size_t k = 1; k < kParts; ++k) sum = hn::Add(sum, hn::LoadU(d, parts[k] + i));
    return sum;
  }
};

// The costs of histories with a new chip.
template <std::size_t kSummed>
class Costs {
 public:
  Costs(const HistoryCosts& from, std::size_t states, std::size_t newest) : all_(from.all + newest * states) {
    for (std::size_t k = 0; k < kSummed; ++k) {
      patterns_[k] = from.grouped[k].patterns[newest];
      of_group_[k] = from.grouped[k].of_group;
    }
  }
  // The group that starts at a state.
  [[nodiscard]] HWY_INLINE auto from(std::size_t state) const {
    Group<std::max<std::size_t>(kSummed, 1)> group{{all_ + state}};
    for (std::size_t k = 0; k < kSummed; ++k)
      group.parts[k] = patterns_[k] + kTrellisGroup * of_group_[k][state / kTrellisGroup];
    return group;
  }

 private:
  const float* all_;
  std::array<const float*, kMostSummed> patterns_;
  std::array<const std::uint8_t*, kMostSummed> of_group_;
};

void AddCosts(const GroupedCosts& from, std::size_t states, float* HWY_RESTRICT costs) {
  for (std::size_t newest = 0; newest < 2; ++newest) {
    const Costs<1> own({{&from, 1}, costs}, states, newest);
    for (std::size_t s = 0; s < states; s += kTrellisGroup) {
      const auto group = own.from(s);
      for (std::size_t i = 0; i < kTrellisGroup; i += hn::Lanes(d), costs += hn::Lanes(d))
        hn::StoreU(hn::Add(hn::LoadU(d, costs), group.at(i)), d, costs);
    }
  }
}

// A plain loop, which the compiler turns into vectors.
void AddSlowRow(const SlowRow& row, std::size_t histories, float* HWY_RESTRICT costs) {
  const SlowRow r = row;  // costs may not change it
  const float rise_at_end = r.at_end[1] - r.at_end[0], rise_at_begin = r.at_begin[1] - r.at_begin[0];
  for (std::size_t h = 0; h < histories; ++h) {
    const float last = r.newest.target[h], first = r.oldest.target[h];
    const float last_share = r.at_end[0] + last * rise_at_end;
    const float first_share = r.at_begin[0] + first * rise_at_begin;
    // Subtracts the part of the oldest chip before the exposure; newer chips count entirely.
    const float area = r.whole * r.oldest.sum[h] + last * r.end + r.newest.lack[h] * last_share - first * r.begin -
                       r.oldest.lack[h] * first_share;
    const float off = r.value - area * r.per_chip;
    costs[h] += r.scale * off * off;
  }
}

HWY_INLINE float least_of(Floats values) { return hn::GetLane(hn::MinOfLanes(d, values)); }

template <std::size_t kSummed>
float step_forward(const float* HWY_RESTRICT from, float less, const HistoryCosts& costs, std::size_t states,
                   float* HWY_RESTRICT to) {
  const std::size_t half = states / 2;  // states whose leaving chip is dark, then those whose leaving chip is bright
  const Costs<kSummed> costs_dark(costs, states, 0), costs_bright(costs, states, 1);
  const Floats taken_off = hn::Set(d, less);
  Floats lowest = hn::Set(d, std::numeric_limits<float>::infinity());
  for (std::size_t s = 0; s < half; s += kTrellisGroup) {
    const auto dark = costs_dark.from(s), dark_other = costs_dark.from(half + s);
    const auto bright = costs_bright.from(s), bright_other = costs_bright.from(half + s);
    for (std::size_t i = 0; i < kTrellisGroup; i += hn::Lanes(d)) {
      const Floats one = hn::LoadU(d, from + s + i), other = hn::LoadU(d, from + half + s + i);
      const auto least = [&](const auto& of, const auto& of_other) {
        return hn::Sub(hn::Min(hn::Add(one, of.at(i)), hn::Add(other, of_other.at(i))), taken_off);
      };
      const Floats to_dark = least(dark, dark_other), to_bright = least(bright, bright_other);
      lowest = hn::Min(lowest, hn::Min(to_dark, to_bright));
      hn::StoreInterleaved2(to_dark, to_bright, d, to + 2 * (s + i));
    }
  }
  return least_of(lowest);
}

// The least of interleaved values that two vectors hold: of those at even and of those at odd places.
HWY_INLINE std::array<float, 2> least_of_each(Floats first, Floats second) {
  HWY_ALIGN float values[2 * kTrellisGroup];
  hn::StoreU(first, d, values);
  hn::StoreU(second, d, values + hn::Lanes(d));
  hn::LoadInterleaved2(d, values, first, second);
  return {least_of(first), least_of(second)};
}

template <std::size_t kSummed>
BackwardStep step_backward(const float* HWY_RESTRICT until, const HistoryCosts& costs, const float* HWY_RESTRICT after,
                           float less, std::size_t states, float* HWY_RESTRICT before) {
  const std::size_t half = states / 2;
  const Costs<kSummed> costs_dark(costs, states, 0), costs_bright(costs, states, 1);
  const Floats never = hn::Set(d, std::numeric_limits<float>::infinity()), taken_off = hn::Set(d, less);
  Floats best_first = never, best_second = never, lowest = never;
  for (std::size_t s = 0; s < half; s += kTrellisGroup) {
    const auto dark = costs_dark.from(s), dark_other = costs_dark.from(half + s);
    const auto bright = costs_bright.from(s), bright_other = costs_bright.from(half + s);
    for (std::size_t i = 0; i < kTrellisGroup; i += hn::Lanes(d)) {
      const auto best_with = [&](Floats best, std::size_t state) {
        return hn::Min(best, hn::Add(hn::LoadU(d, until + state), hn::LoadU(d, after + state)));
      };
      best_first = best_with(best_first, 2 * (s + i));
      best_second = best_with(best_second, 2 * (s + i) + hn::Lanes(d));
      Floats after_dark, after_bright;
      hn::LoadInterleaved2(d, after + 2 * (s + i), after_dark, after_bright);
      const auto step = [&](std::size_t state, const auto& of_dark, const auto& of_bright) {
        const Floats least = hn::Min(hn::Add(of_dark.at(i), after_dark), hn::Add(of_bright.at(i), after_bright));
        hn::StoreU(hn::Sub(least, taken_off), d, before + state);
        lowest = hn::Min(lowest, least);
      };
      step(s + i, dark, bright);
      step(half + s + i, dark_other, bright_other);
    }
  }
  return {least_of_each(best_first, best_second), least_of(hn::Sub(lowest, taken_off))};
}

// Calls step<number of summed costs>().
template <class Step>
HWY_INLINE auto for_summed(const HistoryCosts& costs, Step step) {
  switch (costs.grouped.size()) {
    case 1: return step.template operator()<1>();
    case 2: return step.template operator()<2>();
    case 3: return step.template operator()<3>();
    default: return step.template operator()<0>();
  }
}

float StepForward(const float* from, float less, const HistoryCosts& costs, std::size_t states, float* to) {
  return for_summed(costs, [&]<std::size_t kSummed>() { return step_forward<kSummed>(from, less, costs, states, to); });
}

BackwardStep StepBackward(const float* until, const HistoryCosts& costs, const float* after, float less,
                          std::size_t states, float* before) {
  return for_summed(
      costs, [&]<std::size_t kSummed>() { return step_backward<kSummed>(until, costs, after, less, states, before); });
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(FillPatterns);
HWY_EXPORT(AddCosts);
HWY_EXPORT(AddSlowRow);
HWY_EXPORT(StepForward);
HWY_EXPORT(StepBackward);

void fill_patterns(const std::array<const float*, 2>& tables, std::size_t counts, float* patterns) {
  HWY_DYNAMIC_DISPATCH(FillPatterns)(tables, counts, patterns);
}

void add_costs(const GroupedCosts& from, std::size_t states, float* costs) {
  HWY_DYNAMIC_DISPATCH(AddCosts)(from, states, costs);
}

void add_slow_row(const SlowRow& row, std::size_t histories, float* costs) {
  HWY_DYNAMIC_DISPATCH(AddSlowRow)(row, histories, costs);
}

float step_forward(const float* from, float less, const HistoryCosts& costs, std::size_t states, float* to) {
  return HWY_DYNAMIC_DISPATCH(StepForward)(from, less, costs, states, to);
}

BackwardStep step_backward(const float* until, const HistoryCosts& costs, const float* after, float less,
                           std::size_t states, float* before) {
  return HWY_DYNAMIC_DISPATCH(StepBackward)(until, costs, after, less, states, before);
}

}  // namespace ocisac::kernels
#endif
