// Steps of the equaliser for blocks of columns, with one column in each lane; compiled once for each SIMD target.
// T: float or double. A block is (rows × width) dense, width a multiple of kBlockAlignment.
#pragma once

#include <cstddef>

namespace ocisac::kernels {

constexpr std::size_t kBlockAlignment = 16;  // columns: a vector of float of any target

// The least-squares line of each column, (width,) each: value at row n: mean + slope·(n − (rows − 1)/2).
// reach: maximum of |x(n) − x(0)|.
struct ColumnLines {
  double *mean, *slope, *reach;
};

// The loops of the target whose code runs.
template <class T>
struct EqualizerLoops {
  void (*column_lines)(const T* block, std::size_t rows, std::size_t width, const ColumnLines& lines);
  // block = block·scale + line(n + later)
  void (*add_lines)(T* block, std::size_t rows, std::size_t width, const ColumnLines& lines, const double* scale,
                    double later);
  // out (outputs × width) = matrix (outputs × inputs, dense)·in (inputs × width); rows are a stride apart.
  void (*matrix_times_rows)(const T* matrix, std::size_t outputs, std::size_t inputs, const T* in,
                            std::ptrdiff_t stride, T* out, std::ptrdiff_t out_stride, std::size_t width);
};
template <class T>
EqualizerLoops<T> equalizer_loops();

}  // namespace ocisac::kernels
