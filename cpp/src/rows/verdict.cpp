#include "rows/verdict.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/statistics.hpp"

namespace ocisac {

double noise_of_differences(std::span<const double> signal) {
  double squares = 0;
  for (std::size_t n = 2; n < signal.size(); ++n) {
    const double difference = signal[n - 2] - 2 * signal[n - 1] + signal[n];  // power gain 6 for white noise
    squares += difference * difference;
  }
  return squares / (6 * static_cast<double>(signal.size() - 2));
}

double noise_floor(std::span<const double> power) {
  const auto upper = power.subspan(power.size() / 2);
  return median({upper.begin(), upper.end()}) / std::numbers::ln2;
}

bool is_white(std::span<const double> residual) {
  constexpr double kCorrelated = 6;  // standard errors
  const auto correlation = [&](std::size_t lag) { return std::abs(product_at_lag(residual, lag)); };
  return std::max(correlation(1), correlation(2)) <=
         kCorrelated / std::sqrt(static_cast<double>(residual.size())) * correlation(0);
}

double chance_of_share(double share, std::size_t tones, double spare) {
  const double half = 0.5 * std::max(spare, 0.0);
  double sum = 0, term = std::pow(1 - share, half);
  for (std::size_t k = 0; k < tones; ++k) {
    sum += term;
    term *= share * (half + static_cast<double>(k)) / static_cast<double>(k + 1);
  }
  return std::min(sum, 1.0);
}

double chance_energy(std::size_t count) {
  const auto freedom = static_cast<double>(count);
  const double spread = 2 / (9 * freedom);
  return freedom * std::pow(1 - spread + 4.8 * std::sqrt(spread), 3);
}

double schwarz_criterion(double residual_energy, std::size_t rows, std::size_t parameters) {
  const auto n = static_cast<double>(rows);
  return n * std::log(residual_energy) + static_cast<double>(parameters) * std::log(n);
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + std::ssize(values) / 2;
  std::ranges::nth_element(values, middle);
  return *middle;
}

}  // namespace ocisac
