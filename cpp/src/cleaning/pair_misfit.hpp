// Sums of the misfit of pairs of rows.
#pragma once

#include <cmath>
#include <cstddef>
#include <span>

namespace ocisac {

// Sum of logarithms of numbers above 0. Products of them take one logarithm together.
class LogSum {
 public:
  void add(double value) {
    product_ *= value;
    if (product_ < largest && product_ > 1 / largest) return;
    sum_ += std::log(product_ / value) + std::log(value);
    product_ = 1;
  }
  [[nodiscard]] double value() const { return sum_ + std::log(product_); }

 private:
  static constexpr double largest = 1e140;
  double sum_ = 0, product_ = 1;
};

struct PairMisfit {
  double sum = 0;
  std::size_t pairs = 0;

  [[nodiscard]] double mean() const { return pairs > 0 ? sum / static_cast<double>(pairs) : 0; }
  void operator+=(const PairMisfit& other) {
    sum += other.sum;
    pairs += other.pairs;
  }
};

// Adds the misfit of the pairs of one frame (rows × columns), for each column.
void add_misfit(std::span<const double> light, std::span<const double> variance, std::size_t lag,
                std::span<PairMisfit> of_columns);

}  // namespace ocisac
