#include "cleaning/slow_changes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

namespace ocisac {

std::size_t slow_terms(std::size_t rows) { return 1 + 2 * rows / slowest_rows; }

void slow_term(std::size_t order, std::span<double> values) {
  const double step = std::numbers::pi * static_cast<double>(order) / static_cast<double>(values.size());
  for (std::size_t n = 0; n < values.size(); ++n) values[n] = std::cos(step * (static_cast<double>(n) + 0.5));
}

void remove_slow_changes(std::span<double> values) {
  std::vector<double> term(values.size());
  const auto rows = static_cast<double>(values.size());
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / rows;
  for (double& value : values) value -= mean;  // exactly 0 for even values
  for (std::size_t order = 1; order < slow_terms(values.size()); ++order) {
    slow_term(order, term);
    const double part = 2 / rows * std::inner_product(term.begin(), term.end(), values.begin(), 0.0);
    for (std::size_t n = 0; n < values.size(); ++n) values[n] -= part * term[n];
  }
}

}  // namespace ocisac
