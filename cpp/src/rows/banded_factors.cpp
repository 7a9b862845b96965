#include "rows/banded_factors.hpp"

#include <algorithm>
#include <cmath>

namespace ocisac {

void BandedFactors::factor() {
  for (std::size_t row = 0; row < size_; ++row)
    for (std::size_t back = std::min(band_, row) + 1; back-- > 0;) {
      const std::size_t column = row - back;
      double sum = at(row, back);
      for (std::size_t further = back + 1; further <= std::min(band_, row); ++further)
        sum -= at(row, further) * at(column, further - back);
      at(row, back) = back > 0 ? sum / at(column, 0) : std::sqrt(sum);
    }
}

void BandedFactors::forward(std::span<double> x, std::size_t first) const {
  for (std::size_t k = 0; k < x.size(); ++k) {
    for (std::size_t back = 1; back <= std::min(band_, k); ++back) x[k] -= at(first + k, back) * x[k - back];
    x[k] /= at(first + k, 0);
  }
}

void BandedFactors::backward(std::span<double> x) const {
  for (std::size_t k = x.size(); k-- > 0;) {
    x[k] /= at(k, 0);
    for (std::size_t back = 1; back <= std::min(band_, k); ++back) x[k - back] -= at(k, back) * x[k];
  }
}

}  // namespace ocisac
