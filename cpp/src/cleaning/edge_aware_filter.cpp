#include "cleaning/edge_aware_filter.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <type_traits>

namespace ocisac {

namespace {

constexpr std::size_t kTogether = 8;  // rows: independent chains hide the latency of the products

// Both directions along `count` rows; `back`: (columns × count), sums from the right.
template <std::size_t count>
void along_rows(const double* across, std::size_t columns, double* values, double* back) {
  std::array<double, count> sum{};
  for (std::size_t column = columns; column-- > 0; back += count)
    for (std::size_t row = 0; row < count; ++row) {
      back[row] = sum[row];
      const std::size_t i = row * columns + column;
      if (column > 0) sum[row] = across[i - 1] * (values[i] + sum[row]);
    }
  sum.fill(0);
  for (std::size_t column = 0; column < columns; ++column) {
    back -= count;
    for (std::size_t row = 0; row < count; ++row) {
      const std::size_t i = row * columns + column;
      const double here = values[i] + sum[row];
      values[i] = here + back[row];
      sum[row] = across[i] * here;
    }
  }
}

}  // namespace

EdgeAwareFilter::EdgeAwareFilter(std::size_t rows, std::size_t columns)
    : rows_(rows), columns_(columns), back_(rows * columns), lines_(kTogether * columns) {}

void EdgeAwareFilter::along_columns(const std::vector<double>& down, std::vector<double>& values) {
  sum_from_below(down, values);
  for (std::size_t row = 0; row < rows_; ++row) add_columns(down, row, values);
}

void EdgeAwareFilter::all_around(const std::vector<double>& down, const std::vector<double>& across,
                                 std::vector<double>& values) {
  sum_from_below(down, values);
  for (std::size_t first = 0; first < rows_; first += kTogether) {
    const std::size_t end = std::min(first + kTogether, rows_);
    for (std::size_t row = first; row < end; ++row) add_columns(down, row, values);
    along_rows_twice(across, first, end, values);
    for (std::size_t row = first; row < end; ++row) sum_from_above(down, row, values);
  }
  add_from_below(down, values);
}

// Writes the sums from below into `back_`, without the pixel itself.
void EdgeAwareFilter::sum_from_below(const std::vector<double>& down, const std::vector<double>& values) {
  std::fill(back_.end() - static_cast<std::ptrdiff_t>(columns_), back_.end(), 0);
  for (std::size_t row = rows_ - 1; row-- > 0;) {
    const double* next = &values[(row + 1) * columns_];
    const double* beyond = &back_[(row + 1) * columns_];
    const double* passage = &down[row * columns_];
    double* sum = &back_[row * columns_];
    for (std::size_t i = 0; i < columns_; ++i) sum[i] = passage[i] * (next[i] + beyond[i]);
  }
}

// Adds the sum from above to the next row, and the stored sum from below.
void EdgeAwareFilter::add_columns(const std::vector<double>& down, std::size_t row, std::vector<double>& values) const {
  if (row + 1 == rows_) return;
  const double* passage = &down[row * columns_];
  const double* back = &back_[row * columns_];
  double* here = &values[row * columns_];
  double* next = here + columns_;
  for (std::size_t i = 0; i < columns_; ++i) {
    next[i] += passage[i] * here[i];
    here[i] += back[i];
  }
}

// Writes the sum from above into `back_`, without the pixel itself; needs that of the row above.
void EdgeAwareFilter::sum_from_above(const std::vector<double>& down, std::size_t row,
                                     const std::vector<double>& values) {
  double* sum = &back_[row * columns_];
  if (row == 0) {
    std::fill(sum, sum + columns_, 0);
    return;
  }
  const double* passage = &down[(row - 1) * columns_];
  const double* last = &values[(row - 1) * columns_];
  const double* before = sum - columns_;
  for (std::size_t i = 0; i < columns_; ++i) sum[i] = passage[i] * (last[i] + before[i]);
}

void EdgeAwareFilter::add_from_below(const std::vector<double>& down, std::vector<double>& values) {
  std::fill(lines_.begin(), lines_.begin() + static_cast<std::ptrdiff_t>(columns_), 0);
  for (std::size_t row = rows_; row-- > 0;) {
    const double* passage = &down[row * columns_];
    const double* back = &back_[row * columns_];
    double* below = lines_.data();
    double* here = &values[row * columns_];
    for (std::size_t i = 0; i < columns_; ++i) {
      below[i] = here[i] + passage[i] * below[i];
      here[i] = below[i] + back[i];
    }
  }
}

void EdgeAwareFilter::along_rows_twice(const std::vector<double>& across, std::size_t first, std::size_t end,
                                       std::vector<double>& values) {
  const auto filter = [&](auto rows, std::size_t row) {
    for (int time = 0; time < 2; ++time)
      along_rows<decltype(rows)::value>(&across[row * columns_], columns_, &values[row * columns_], lines_.data());
  };
  if (end - first == kTogether) {
    filter(std::integral_constant<std::size_t, kTogether>{}, first);
    return;
  }
  for (std::size_t row = first; row < end; ++row) filter(std::integral_constant<std::size_t, 1>{}, row);
}

}  // namespace ocisac
