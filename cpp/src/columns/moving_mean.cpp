#include "columns/moving_mean.hpp"

#include <algorithm>

namespace ocisac {

std::vector<double> moving_mean(std::span<const double> signal, std::size_t reach) {
  std::vector<double> total(signal.size() + 1, 0.0), mean(signal.size());
  for (std::size_t n = 0; n < signal.size(); ++n) total[n + 1] = total[n] + signal[n];
  for (std::size_t n = 0; n < signal.size(); ++n) {
    const std::size_t low = n < reach ? 0 : n - reach, high = std::min(n + reach + 1, signal.size());
    mean[n] = (total[high] - total[low]) / static_cast<double>(high - low);
  }
  return mean;
}

}  // namespace ocisac
