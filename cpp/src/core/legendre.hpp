#pragma once

#include <span>

namespace ocisac {

// Legendre polynomials of degree 0, 1, … at x.
void legendre(double x, std::span<double> values);

}  // namespace ocisac
