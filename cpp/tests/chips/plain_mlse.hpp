// Reference maximum-likelihood sequence detection over all states.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "ocisac/chips/refine_channel.hpp"

inline std::vector<double> plain_mlse(const ocisac::ChipQuestion& question) {
  const double length = question.clock.exposure_rows / question.clock.rows_per_chip;
  const auto memory = static_cast<int>(std::ceil(length));
  const std::uint32_t states = 1U << memory, mask = states - 1;
  std::vector<double> cost(states, 0.0), next(states);
  std::vector<std::vector<std::uint8_t>> oldest;  // chip shifted out of the state on the best path
  std::size_t row = 0;
  for (std::size_t chip = 0; chip < question.count; ++chip) {
    struct Seen {
      double value, end, begin;
      int back;
    };
    std::vector<Seen> rows;
    for (; row < question.rows.size(); ++row) {
      const double end = (static_cast<double>(row) + 0.5 * question.clock.exposure_rows - question.clock.phase) /
                             question.clock.rows_per_chip -
                         static_cast<double>(question.first) - static_cast<double>(chip);
      if (end >= 1) break;
      const double begin = end - length, whole = std::floor(begin);
      rows.push_back({question.rows[row], end, 1 - (begin - whole), static_cast<int>(-whole)});
    }
    next.assign(states, std::numeric_limits<double>::infinity());
    oldest.emplace_back(states);
    for (std::uint32_t history = 0; history < 2 * states; ++history) {  // bit j: chip − j
      const std::uint32_t from = (history >> 1) & mask, to = history & mask;
      double squares = cost[from];
      for (const Seen& seen : rows) {
        const double bright = static_cast<double>(history & 1);
        double area = seen.back == 0 ? bright * length : bright * seen.end;
        if (seen.back > 0) {
          const std::uint32_t between = (history >> 1) & ((1U << (seen.back - 1)) - 1);
          area += static_cast<double>(std::popcount(between)) +
                  seen.begin * static_cast<double>((history >> seen.back) & 1);
        }
        const double off = seen.value - area / length;
        squares += off * off;
      }
      if (squares < next[to]) {
        next[to] = squares;
        oldest.back()[to] = static_cast<std::uint8_t>((history >> memory) & 1);
      }
    }
    cost.swap(next);
  }
  std::uint32_t state = 0;
  for (std::uint32_t s = 1; s < states; ++s)
    if (cost[s] < cost[state]) state = s;
  std::vector<double> chips(question.count);
  for (std::size_t chip = question.count; chip-- > 0;) {
    chips[chip] = static_cast<double>(state & 1);
    state = (state >> 1) | (static_cast<std::uint32_t>(oldest[chip][state]) << (memory - 1));
  }
  return chips;
}
