// Changes along the rows that are too slow to be told apart from those of the picture.
#pragma once

#include <cstddef>
#include <span>

namespace ocisac {

constexpr std::size_t slowest_rows = 128;  // per cycle
constexpr double slow_cycles = 2.5;        // in the picture, up to which bands of any length are like its shades

// A tone, cycles per row, that is slower than that in one of the two.
constexpr bool is_slow(double frequency, std::size_t rows) {
  return frequency * static_cast<double>(slowest_rows) < 1 || frequency * static_cast<double>(rows) < slow_cycles;
}

// Number of cosines of the longer periods, with a constant.
std::size_t slow_terms(std::size_t rows);

// The cosine of an order: cos(π·order·(n + 1/2)/rows). They are orthogonal (a discrete cosine transform).
void slow_term(std::size_t order, std::span<double> values);

// Removes what these terms explain, the mean included.
void remove_slow_changes(std::span<double> values);

}  // namespace ocisac
