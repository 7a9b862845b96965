// Part of a frame around a light, for its refinement: groups of columns, their logarithm, and the local swing.
#pragma once

#include <complex>
#include <cstddef>
#include <vector>

#include "ocisac/core/views.hpp"

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

// A frame as lights are looked for in it. `dark`: DN of no light; `floor`: of the logarithm, DN.
struct LitFrame {
  const AnyFramesView& frames;
  std::size_t index;
  double dark, floor;
};

// The box and margins more on each side, as far as the frame goes. As many columns a group as keep their number
// bounded, and small lights sharp.
struct Margins {
  std::size_t columns, rows;
};
Patch patch_of(const LitFrame& frame, const Box& box, const Margins& margins);

// Mean of at most 32 columns evenly spaced over [begin, end), in rows [first, last): light above dark.
std::vector<double> mean_light(const LitFrame& frame, std::size_t begin, std::size_t end, std::size_t first,
                               std::size_t last);

// Means of values (rows × stride) down the rows under a Hann window of `length` rows, an odd number; rows before and
// after repeat the first and the last. stride: a multiple of 8.
std::vector<double> local_means(const std::vector<double>& values, std::size_t rows, std::size_t stride,
                                std::size_t length);

// z of every element: (rows × stride).
struct SwingMap {
  std::vector<double> real, imaginary;

  [[nodiscard]] std::complex<double> operator[](std::size_t i) const { return {real[i], imaginary[i]}; }
};

// Of an element of log light, from the median of mixed differences over neighbouring rows and groups: edges and strokes
// are few enough not to count.
double noise_variance(const Patch& patch, const PatchRange& core);

// Rows of a Hann window of two cycles of `frequency`, cycles per row: an odd number.
std::size_t hann_length(double frequency);

// e^{−j2πx}
std::complex<double> turned(double cycles);

// Without the detour that infinities take in the standard's.
inline std::complex<double> product(std::complex<double> a, std::complex<double> b) {
  return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

// e^{−j2πfn} for n from −reach to rows + reach − 1: sixteen and those of every sixteenth give all.
struct Turns {
  std::vector<double> real, imaginary;
};
Turns turns_of(double frequency, std::size_t rows, std::size_t reach = 0);

// Log light less its local mean over two cycles, which holds nothing of the tone.
std::vector<double> fast_logs(const Patch& patch, double frequency);

// Means under a Hann window of two cycles that goes down the rows of a patch.
class Demodulator {
 public:
  Demodulator(double frequency, std::size_t rows);

  // Local mean of x·e^{−j2πfn}, n the patch's row and x less its mean in the group, of light or its logarithm.
  [[nodiscard]] SwingMap swing(const Patch& patch, const std::vector<double>& values) const;

 private:
  std::size_t length_;
  Turns step_, tone_, below_, above_, turns_;
};

}  // namespace ocisac
