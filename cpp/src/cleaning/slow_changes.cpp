#include "cleaning/slow_changes.hpp"

#include <numeric>
#include <vector>

#include "core/check_interrupt.hpp"
#include "core/statistics.hpp"
#include "ocisac/rows/basis.hpp"

namespace ocisac {

std::size_t slow_terms(std::size_t rows) { return 1 + 2 * rows / slowest_rows; }

void slow_term(std::size_t order, std::span<double> values) {
  std::vector<double> from_edge(values.size()), sine(values.size());
  std::iota(from_edge.begin(), from_edge.end(), 0.5);
  fill_wave(from_edge, 0.5 * static_cast<double>(order) / static_cast<double>(values.size()), values, sine);
}

void remove_slow_changes(std::span<double> values) {
  std::vector<double> term(values.size());
  const auto rows = static_cast<double>(values.size());
  const double mean = mean_of(values);
  for (double& value : values) value -= mean;  // exactly 0 for even values
  for (std::size_t order = 1; order < slow_terms(values.size()); ++order) {
    check_interrupt();
    slow_term(order, term);
    const double part = 2 / rows * std::inner_product(term.begin(), term.end(), values.begin(), 0.0);
    for (std::size_t n = 0; n < values.size(); ++n) values[n] -= part * term[n];
  }
}

}  // namespace ocisac
