#include "rows/normal_factors.hpp"

#include <algorithm>
#include <cmath>

namespace ocisac {

NormalFactors::NormalFactors(const NormalProducts& products, std::size_t size) {
  const auto without_earlier = [&](double sum, const Row& row, std::size_t j) {
    for (std::size_t k = 0; k < j; ++k) sum -= row[k] * factor_[j][k];
    return sum;
  };
  for (std::size_t i = 0; i < size; ++i) {
    if (!(products.normal(i, i) > 0)) return;
    scale_[i] = 1 / std::sqrt(std::max(products.normal(i, i), 1e-300));
    Row& row = factor_[i];
    for (std::size_t j = 0; j < i; ++j)
      row[j] = without_earlier(products.normal(i, j) * scale_[i] * scale_[j], row, j) * factor_[j][j];
    double pivot = products.normal(i, i) * scale_[i] * scale_[i];
    for (std::size_t k = 0; k < i; ++k) pivot -= row[k] * row[k];
    if (!(pivot > kMinPivot) || !std::isfinite(pivot)) return;
    row[i] = 1 / std::sqrt(pivot);
    explained_[i] = without_earlier(products.right(i) * scale_[i], explained_, i) * row[i];
    solvable_ = i + 1;
  }
}

void NormalFactors::solve(std::span<double> values) const {
  for (std::size_t i = values.size(); i-- > 0;) {
    double sum = explained_[i];
    for (std::size_t k = i + 1; k < values.size(); ++k) sum -= factor_[k][i] * values[k];
    values[i] = sum * factor_[i][i];
  }
  for (std::size_t i = 0; i < values.size(); ++i) values[i] *= scale_[i];
}

LastInverse NormalFactors::inverse_from(std::size_t first) const {
  LastInverse inverted{}, result{};  // of the factor; of the matrix
  const std::size_t count = solvable_ - first;
  for (std::size_t i = 0; i < count; ++i) {
    const double* const row = &factor_[first + i][first];
    inverted[i][i] = row[i];
    for (std::size_t j = 0; j < i; ++j) {
      double sum = 0;
      for (std::size_t k = j; k < i; ++k) sum -= row[k] * inverted[k][j];
      inverted[i][j] = sum * row[i];
    }
  }
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t j = 0; j < count; ++j) {
      for (std::size_t k = std::max(i, j); k < count; ++k) result[i][j] += inverted[k][i] * inverted[k][j];
      result[i][j] *= scale_[first + i] * scale_[first + j];
    }
  return result;
}

}  // namespace ocisac
