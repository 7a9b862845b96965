#include "light/instants.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace ocisac {

namespace {

constexpr std::size_t kMostKept = std::size_t{1} << 20;  // counts in all tables, 16 MiB

}  // namespace

Instants::Instants(std::span<const double> x) : x_(x), first_(x.front()), last_(x.back()) {
  const double step = x.size() > 1 ? x[1] - x[0] : 0;
  int others = step < 0 ? 1 : 0;
  for (std::size_t i = 1; i < x.size(); ++i) others |= x[i] - x[i - 1] != step ? 1 : 0;
  even_ = others == 0;
  if (even_) return;
  const auto [least, most] = std::ranges::minmax(x);
  first_ = least;
  last_ = most;
}

kernels::Cycles Instants::counted(bool fractions, DoubleDouble step, std::size_t first, std::size_t count) {
  const auto is_asked = [&](const Table& table) { return table.fractions == fractions && table.step == step; };
  if (const auto known = std::ranges::find_if(tables_, is_asked); known != tables_.end()) return known->from(first);
  if ((tables_.size() + 1) * x_.size() <= kMostKept) {
    Table table{fractions, step, {}, {}};
    count_all(x_, table);
    return tables_.emplace_back(std::move(table)).from(first);
  }
  block_.fractions = fractions;
  block_.step = step;
  count_all(x_.subspan(first, count), block_);
  return block_.from(0);
}

void Instants::count_all(std::span<const double> x, Table& table) const {
  const double far = std::max(std::abs(first_), std::abs(last_)) * std::abs(table.step.high);
  const double grid = std::ldexp(1.0, std::ilogb(table.fractions ? 0.5 : far + 2) - 50);
  const std::size_t length = x.size() + kernels::kMaxReadAhead;
  double *const coarse = table.memory.at_least(2 * length), *const fine = coarse + length;
  std::fill(coarse + x.size(), fine, 0.0);
  std::fill(fine + x.size(), fine + length, 0.0);
  kernels::count_cycles(table.step, grid, table.fractions, x, coarse, fine);
  table.cycles = {coarse, fine, {}, grid};
}

}  // namespace ocisac
