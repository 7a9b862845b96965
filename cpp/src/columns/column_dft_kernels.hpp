// Steps of a DFT along many columns at once, with one pair of columns in each lane: nothing is transposed. Compiled
// once for each SIMD target. T: float or double.
#pragma once

#include <cstddef>

namespace ocisac::kernels {

// Complex numbers of a row: kColumnPairs real parts (the first columns), then as many imaginary parts: two lines of the
// cache, a vector of any target each.
template <class T>
constexpr std::size_t kColumnPairs = 64 / sizeof(T);

// A step of a mixed-radix DFT, in place, on blocks of `length` rows: decimation in frequency,
//   X(j + q·length/radix) = w^{jq}·Σ_p x(j + p·length/radix)·e^{−j2πpq/radix}, w = e^{−j2π/length}.
// turns: w^{jq} for j = 0 … length/radix − 1 and q = 1 … radix − 1, (real, imaginary) each. radix: 2, 3, 4 or 5.
template <class T>
struct DftStep {
  std::size_t radix, length;
  const T* turns;
};

// The loops of the target whose code runs. rows: (blocks·length × 2·kColumnPairs); of each row the first `pairs` count,
// the others may change.
template <class T>
struct DftLoops {
  void (*step)(const DftStep<T>& step, T* rows, std::size_t blocks, std::size_t pairs);
  void (*inverse_step)(const DftStep<T>& step, T* rows, std::size_t blocks, std::size_t pairs);  // not scaled: x from X
  // rows (count × 2·kColumnPairs) = gain·rows; gain: (count × 2), real and imaginary part.
  void (*multiply_rows)(T* rows, const T* gain, std::size_t count, std::size_t pairs);
};
template <class T>
DftLoops<T> dft_loops();

}  // namespace ocisac::kernels
