#include "chips/sequence_kernels.hpp"

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
  [[nodiscard]] HWY_INLINE Floats at(std::size_t state) const {
    if (kSummed == 0) return hn::LoadU(d, all_ + state);
    Floats sum = of_group(0, state);
    for (std::size_t k = 1; k < kSummed; ++k) sum = hn::Add(sum, of_group(k, state));
    return sum;
  }

 private:
  [[nodiscard]] HWY_INLINE Floats of_group(std::size_t k, std::size_t state) const {
    const std::size_t pattern = of_group_[k][state / kTrellisGroup];
    return hn::LoadU(d, patterns_[k] + kTrellisGroup * pattern + state % kTrellisGroup);
  }

  const float* all_;
  std::array<const float*, kMostSummed> patterns_;
  std::array<const std::uint8_t*, kMostSummed> of_group_;
};

void AddCosts(const GroupedCosts& from, std::size_t states, float* HWY_RESTRICT costs) {
  for (std::size_t newest = 0; newest < 2; ++newest) {
    const Costs<1> own({{&from, 1}, costs}, states, newest);
    for (std::size_t s = 0; s < states; s += hn::Lanes(d), costs += hn::Lanes(d))
      hn::StoreU(hn::Add(hn::LoadU(d, costs), own.at(s)), d, costs);
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

HWY_INLINE void take_off(Floats lowest, std::size_t states, float* values) {
  for (std::size_t s = 0; s < states; s += hn::Lanes(d))
    hn::StoreU(hn::Sub(hn::LoadU(d, values + s), lowest), d, values + s);
}

template <std::size_t kSummed>
void step_forward(const float* HWY_RESTRICT from, const HistoryCosts& costs, std::size_t states,
                  float* HWY_RESTRICT to) {
  const std::size_t half = states / 2;  // states whose leaving chip is dark, then those whose leaving chip is bright
  const Costs<kSummed> dark(costs, states, 0), bright(costs, states, 1);
  Floats lowest = hn::Set(d, std::numeric_limits<float>::infinity());
  for (std::size_t s = 0; s < half; s += hn::Lanes(d)) {
    const Floats one = hn::LoadU(d, from + s), other = hn::LoadU(d, from + half + s);
    const auto least = [&](const Costs<kSummed>& of) {
      return hn::Min(hn::Add(one, of.at(s)), hn::Add(other, of.at(half + s)));
    };
    const Floats to_dark = least(dark), to_bright = least(bright);
    lowest = hn::Min(lowest, hn::Min(to_dark, to_bright));
    hn::StoreInterleaved2(to_dark, to_bright, d, to + 2 * s);
  }
  take_off(hn::MinOfLanes(d, lowest), states, to);
}

template <std::size_t kSummed>
std::array<float, 2> step_backward(const float* HWY_RESTRICT from, const HistoryCosts& costs,
                                   const float* HWY_RESTRICT after, std::size_t states, float* HWY_RESTRICT before) {
  const std::size_t half = states / 2;
  const Costs<kSummed> costs_dark(costs, states, 0), costs_bright(costs, states, 1);
  const Floats never = hn::Set(d, std::numeric_limits<float>::infinity());
  Floats best_dark = never, best_bright = never, lowest = never;
  for (std::size_t s = 0; s < half; s += hn::Lanes(d)) {
    Floats after_dark, after_bright;
    hn::LoadInterleaved2(d, after + 2 * s, after_dark, after_bright);
    for (const std::size_t state : {s, half + s}) {
      const Floats dark = hn::Add(costs_dark.at(state), after_dark);
      const Floats bright = hn::Add(costs_bright.at(state), after_bright);
      const Floats until = hn::LoadU(d, from + state), least = hn::Min(dark, bright);
      best_dark = hn::Min(best_dark, hn::Add(until, dark));
      best_bright = hn::Min(best_bright, hn::Add(until, bright));
      lowest = hn::Min(lowest, least);
      hn::StoreU(least, d, before + state);
    }
  }
  take_off(hn::MinOfLanes(d, lowest), states, before);
  return {hn::GetLane(hn::MinOfLanes(d, best_dark)), hn::GetLane(hn::MinOfLanes(d, best_bright))};
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

void StepForward(const float* from, const HistoryCosts& costs, std::size_t states, float* to) {
  for_summed(costs, [&]<std::size_t kSummed>() { step_forward<kSummed>(from, costs, states, to); });
}

std::array<float, 2> StepBackward(const float* from, const HistoryCosts& costs, const float* after, std::size_t states,
                                  float* before) {
  return for_summed(costs,
                    [&]<std::size_t kSummed>() { return step_backward<kSummed>(from, costs, after, states, before); });
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

void step_forward(const float* from, const HistoryCosts& costs, std::size_t states, float* to) {
  HWY_DYNAMIC_DISPATCH(StepForward)(from, costs, states, to);
}

std::array<float, 2> step_backward(const float* from, const HistoryCosts& costs, const float* after, std::size_t states,
                                   float* before) {
  return HWY_DYNAMIC_DISPATCH(StepBackward)(from, costs, after, states, before);
}

}  // namespace ocisac::kernels
#endif
