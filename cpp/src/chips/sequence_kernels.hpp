// Steps of the trellis of the sequence detector; compiled once for each SIMD target, with the same values on all.
// States are words of the last chips, the newest in bit 0. A history is a state and the chip that follows it; arrays of
// (2, states) hold histories whose new chip is dark, then those whose new chip is bright.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace ocisac::kernels {

// States whose words differ in the lowest 4 bits alone; a trellis has two groups or more, a power of two.
constexpr std::size_t kTrellisGroup = 16;
constexpr std::size_t kFewestStates = 2 * kTrellisGroup;
// Bright chips in the words of a group.
constexpr std::array<std::int32_t, kTrellisGroup> kBits{0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4};

// Costs that repeat: those of group g are patterns[kTrellisGroup·of_group[g]] …
struct GroupedCosts {
  std::array<const float*, 2> patterns;  // of histories with a dark, with a bright new chip
  const std::uint8_t* of_group;          // (states/kTrellisGroup)
};

// patterns (2·counts × kTrellisGroup): [2·m + o][i] = tables[o][m + kBits[i]]. Reads counts + kTrellisGroup
// values of each table.
void fill_patterns(const std::array<const float*, 2>& tables, std::size_t counts, float* patterns);

// costs (2, states) += the costs of all histories.
void add_costs(const GroupedCosts& from, std::size_t states, float* costs);

// Light of a chip of each history (2·states): its target, the deviation of its integral from that of the settled light,
// and its integral over the whole chip and all newer ones except the newest.
struct ChipLights {
  const float *target, *lack, *sum;
};

// A row whose light has not settled: it ends in the newest chip and begins in the oldest one.
struct SlowRow {
  ChipLights newest, oldest;
  float end, begin;                       // chips
  std::array<float, 2> at_end, at_begin;  // settled share of the lack, of chips that fall and that rise
  float whole;                            // 1 where chips between count, 0 for an exposure within one chip
  float value, per_chip, scale;           // area·per_chip is the expected value; 1/(2σ²)
};

// costs (histories) += the row's squared residual over 2σ².
void add_slow_row(const SlowRow& row, std::size_t histories, float* costs);

constexpr std::size_t kMostSummed = 3;

// Costs of all histories: the sum of grouped ones, at most kMostSummed, or if there are none (2, states) of `all`.
struct HistoryCosts {
  std::span<const GroupedCosts> grouped;
  const float* all;
};

// to (states): the least of from + costs over the chip that leaves, less `less`; the least of `from` there keeps the
// numbers small. Returns the least of `to`.
float step_forward(const float* from, float less, const HistoryCosts& costs, std::size_t states, float* to);

struct BackwardStep {
  std::array<float, 2> best;  // the least of until + after over the states whose newest chip is dark, is bright
  float lowest;               // the least of before
};

// before (states): the least of costs + after over the new chip, less `less`. `until`: of step_forward, the new chip
// included.
BackwardStep step_backward(const float* until, const HistoryCosts& costs, const float* after, float less,
                           std::size_t states, float* before);

}  // namespace ocisac::kernels
