// Inner loops of the refinement of light sources, compiled once for each SIMD target.
#pragma once

#include <complex>
#include <cstddef>
#include <vector>

namespace ocisac::kernels {

constexpr std::size_t kPatchPadding = 8;  // groups of a patch are padded to a multiple of this

// Complex values, such as z of each element of a patch: (rows × stride).
struct ComplexValues {
  std::vector<double> real, imaginary;

  [[nodiscard]] std::complex<double> operator[](std::size_t i) const { return {real[i], imaginary[i]}; }
};

// A Hann window of `length` rows (odd), sum 1, on a tone: three running sums with carriers f − 1/length, f and f +
// 1/length, e^{−j2πfm} for m from −reach to rows + reach − 1; `turns`: e^{−j2πn/length} of the rows.
struct HannWindow {
  ComplexValues below, middle, above, turns;
  std::size_t length;
};

// A patch of light: (rows × stride), stride a multiple of kPatchPadding.
struct PatchView {
  const double* values;
  std::size_t rows, stride;
};

// z(n) = Σ_m window(m − n)·(x(m) − mean)·e^{−j2πfm} of each group; the first and the last row are repeated beyond the
// ends. `mean`: of each group. real, imaginary: layout of the patch.
void hann_demodulate(const PatchView& x, const double* mean, const HannWindow& window, double* real, double* imaginary);

// out[i] = ln(max(light[i], 0) + floor), floor > 0: of floats to 1e-5; of doubles to 1e-15, a multiple of
// kPatchPadding.
void logarithms(const float* light, std::size_t count, float floor, float* out);
void logarithms(const double* light, std::size_t count, double floor, double* out);

}  // namespace ocisac::kernels
