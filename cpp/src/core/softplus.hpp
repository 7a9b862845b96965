// ln(1 + eˣ): −ln of a probability whose logit is −x.
#pragma once

#include <algorithm>
#include <cmath>

namespace ocisac {

// Without overflow.
inline double softplus(double x) { return std::max(x, 0.0) + std::log1p(std::exp(-std::abs(x))); }

}  // namespace ocisac
