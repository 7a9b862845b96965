#include "cleaning/edge_aware_filter.hpp"

#include <algorithm>
#include <array>
#include <type_traits>
#include <utility>

namespace ocisac {

namespace {

constexpr std::size_t kTogether = 8;  // rows: independent chains hide the latency of the products

// Both directions along neighbouring lines of `length` pixels, `apart` each from the next; the lines are `beside`.
// `sum`: zeros, one a line.
template <class Apart, class Beside, class Sum>
void sum_both_ways(const double* passage, double* values, std::size_t length, Apart apart, Beside beside, Sum sum) {
  const std::size_t lines = sum.size();
  std::vector<double> back(length * lines);  // from beyond, without the pixel itself
  for (std::size_t k = length; k-- > 0;)
    for (std::size_t line = 0; line < lines; ++line) {
      const std::size_t i = k * apart + line * beside;
      back[k * lines + line] = sum[line];
      if (k > 0) sum[line] = passage[i - apart] * (values[i] + sum[line]);
    }
  std::ranges::fill(sum, 0.0);
  for (std::size_t k = 0; k < length; ++k)
    for (std::size_t line = 0; line < lines; ++line) {
      const std::size_t i = k * apart + line * beside;
      const double here = values[i] + sum[line];
      values[i] = here + back[k * lines + line];
      sum[line] = passage[i] * here;
    }
}

using One = std::integral_constant<std::size_t, 1>;

}  // namespace

void sum_along_columns(const std::vector<double>& down, std::size_t columns, std::vector<double>& values) {
  sum_both_ways(down.data(), values.data(), values.size() / columns, columns, One{}, std::vector<double>(columns));
}

void sum_along_rows(const std::vector<double>& across, std::size_t columns, std::vector<double>& values) {
  const std::size_t rows = values.size() / columns;
  const auto sum_rows = [&](std::size_t row, auto sum) {
    sum_both_ways(&across[row * columns], &values[row * columns], columns, One{}, columns, std::move(sum));
  };
  std::size_t row = 0;
  for (; row + kTogether <= rows; row += kTogether) sum_rows(row, std::array<double, kTogether>{});
  if (row < rows) sum_rows(row, std::vector<double>(rows - row));
}

}  // namespace ocisac
