// Changes along the rows that are too slow to be told apart from those of the picture.
#pragma once

#include <cstddef>
#include <span>

namespace ocisac {

constexpr std::size_t slowest_rows = 128;  // per cycle

// Number of cosines of the longer periods, with a constant.
std::size_t slow_terms(std::size_t rows);

// The cosine of an order: cos(π·order·(n + 1/2)/rows). They are orthogonal (a discrete cosine transform).
void slow_term(std::size_t order, std::span<double> values);

// Removes what these terms explain, the mean included.
void remove_slow_changes(std::span<double> values);

}  // namespace ocisac
