#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

// Mean over rows n − reach … n + reach, clipped at the ends.
std::vector<double> moving_mean(std::span<const double> signal, std::size_t reach);

}  // namespace ocisac
