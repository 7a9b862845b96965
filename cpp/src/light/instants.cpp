#include "light/instants.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "light/waveform_kernels.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kMostKept = std::size_t{1} << 20;  // counts in all tables, 16 MiB

}  // namespace

Instants::Instants(std::span<const double> x) : x_(x) {
  const auto [first, last] = std::ranges::minmax(x);
  first_ = first;
  last_ = last;
  const double step = x.size() > 1 ? x[1] - x[0] : 0;
  even_ = step >= 0 && std::ranges::adjacent_find(x, [=](double a, double b) { return b - a != step; }) == x.end();
}

CountedCycles Instants::cycles(DoubleDouble step, std::size_t first, std::size_t count) {
  const auto has_step = [&](const Table& table) { return table.step.high == step.high && table.step.low == step.low; };
  if (const auto known = std::ranges::find_if(tables_, has_step); known != tables_.end()) return known->from(first);
  if ((tables_.size() + 1) * x_.size() <= kMostKept) {
    Table table{step, 0, {}, {}};
    count_in(table, x_);
    return tables_.emplace_back(std::move(table)).from(first);
  }
  block_.step = step;
  count_in(block_, x_.subspan(first, count));
  return block_.from(0);
}

void Instants::count_in(Table& table, std::span<const double> x) const {
  const double most = std::max(std::abs(first_), std::abs(last_)) * std::abs(table.step.high) + 2;
  table.grid = std::ldexp(1.0, std::ilogb(most) - 50);
  table.coarse.resize(x.size() + kernels::kMaxReadAhead);
  table.fine.resize(x.size() + kernels::kMaxReadAhead);
  kernels::count_cycles(table.step, table.grid, x, table.coarse.data(), table.fine.data());
}

}  // namespace ocisac
