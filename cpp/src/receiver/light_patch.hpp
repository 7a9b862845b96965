// Part of a frame around a light, for its refinement: groups of columns, their logarithm, and the local swing.
#pragma once

#include <complex>
#include <cstddef>
#include <vector>

#include "ocisac/views.hpp"

namespace ocisac {

struct Box {
  std::size_t column, row, width, height;  // pixels
};

Box widened(const Box& box, std::size_t by);

// Rows and groups of a patch, [begin, end).
struct PatchRange {
  std::size_t first_row, end_row, first_group, end_group;

  [[nodiscard]] std::size_t size() const { return (end_row - first_row) * (end_group - first_group); }
};

// Light above dark, mean of each group of columns, and ln(light + floor): (rows × stride), zeros beyond the groups.
struct Patch {
  std::size_t first_column, first_row, rows, groups, group, stride;
  std::vector<double> light, logs;

  // What of the patch lies in the box; groups that it cuts included.
  [[nodiscard]] PatchRange range(const Box& box) const;
};

// The box and `margin` more on each side, as far as the frame goes. As many columns a group as keep their number
// bounded, and small lights sharp.
Patch patch_of(const AnyFramesView& frames, std::size_t frame, double dark, const Box& box, std::size_t margin,
               double floor);

// z of every element: (rows × stride).
struct SwingMap {
  std::vector<double> real, imaginary;

  [[nodiscard]] std::complex<double> operator[](std::size_t i) const { return {real[i], imaginary[i]}; }
};

// Rows of a Hann window of two cycles of `frequency`, cycles per row: an odd number.
std::size_t hann_length(double frequency);

// e^{−j2πx}
std::complex<double> turned(double cycles);

// Means under a Hann window of two cycles that goes down the rows of a patch.
class Demodulator {
 public:
  Demodulator(double frequency, std::size_t rows);

  // Local mean of x·e^{−j2πfn}, n the patch's row and x less its mean in the group, of light or its logarithm.
  [[nodiscard]] SwingMap swing(const Patch& patch, const std::vector<double>& values) const;

  // Log light less its local mean, which holds nothing of the tone.
  [[nodiscard]] std::vector<double> fast(const Patch& patch) const;

 private:
  struct Rows {
    std::vector<double> real, imaginary;
  };
  static Rows carrier(double frequency, std::size_t rows, std::size_t reach);
  static Rows product(const Rows& a, const Rows& b, double sign);

  std::size_t length_;
  Rows step_, tone_, below_, above_, turns_;
};

}  // namespace ocisac
