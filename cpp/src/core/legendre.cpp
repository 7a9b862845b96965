#include "core/legendre.hpp"

namespace ocisac {

// d·L_d = (2d − 1)·x·L_{d−1} − (d − 1)·L_{d−2}
void legendre(double x, std::span<double> values) {
  for (std::size_t d = 0; d < values.size(); ++d) {
    const auto degree = static_cast<double>(d);
    values[d] = d == 0   ? 1
                : d == 1 ? x
                         : ((2 * degree - 1) * x * values[d - 1] - (degree - 1) * values[d - 2]) / degree;
  }
}

}  // namespace ocisac
