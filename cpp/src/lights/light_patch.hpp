// Part of a frame around a light, for refinement: groups of columns, their logarithm, and the local swing.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <complex>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "lights/refinement_kernels.hpp"
#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/region.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

constexpr std::size_t kWidestGroup = 8;  // columns in a group of a small light

using PatchArray =
    Eigen::Map<const Eigen::Array<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>, 0, Eigen::OuterStride<>>;

// Light above dark, mean of each group of columns, and ln(light + floor): (rows × stride), zeros beyond the groups.
struct Patch {
  std::size_t first_column, first_row, rows, groups, group, stride;
  std::vector<double> light, logs;

  // A part of values (rows × stride) of the patch, as (rows × groups).
  [[nodiscard]] PatchArray part_of(const std::vector<double>& values, const Region& part) const {
    return {values.data() + part.y * stride + part.x, static_cast<Eigen::Index>(part.height),
            static_cast<Eigen::Index>(part.width), Eigen::OuterStride<>(static_cast<Eigen::Index>(stride))};
  }
  [[nodiscard]] PatchArray array_of(const std::vector<double>& values) const {
    return part_of(values, {0, 0, groups, rows});
  }

  // Groups (x) and rows (y) of the patch in the box, including groups that it cuts.
  [[nodiscard]] Region range(const Region& box) const;
};

// A frame for light detection. `dark`: DN without light; `floor`: of the logarithm, DN; `min_amplitude`: one stored
// step, as smaller swings are often compression artefacts.
struct LitFrame {
  AnyFramesView frames;
  std::size_t index;
  double dark, floor, min_amplitude;
};

// Stored values above the curve's dark level: a memoryless curve preserves every period, and stored values resolve
// darkness best. The floor is 1/64 of full light, which suppresses dark areas.
LitFrame lit_frame(const AnyFramesView& frames, std::size_t index, const ToneCurve& curve);

// The box with margins on each side, clipped to the frame. The columns per group bound the number of groups and keep
// small lights sharp.
Patch patch_of(const LitFrame& frame, const Region& box, std::size_t columns_beside, std::size_t rows_beyond);

// Means of values (rows × stride) along the rows under a Hann window of `length` rows, an odd number; the first and the
// last row are repeated beyond the ends. stride: a multiple of 8.
std::vector<double> local_means(const std::vector<double>& values, std::size_t rows, std::size_t stride,
                                std::size_t length);

std::vector<double> local_means(std::span<const double> signal, std::size_t length);

// Logarithm of the mean light of columns (at most 32 of them, evenly spaced) in each of the rows, less its local mean.
std::vector<double> mean_swing(const LitFrame& frame, const IndexRange& columns, const IndexRange& rows,
                               std::size_t length);

using kernels::ComplexValues;

// Noise variance of an element of log light, from the median of mixed differences over neighbouring rows and groups,
// which is robust against edges and strokes; of rows alone in a single group.
double noise_variance(const Patch& patch, const Region& core);

// Variance of a normal distribution of mean 0 by the median of magnitudes, one or more.
double variance_by_median(std::vector<double> magnitudes);

// Rows of a Hann window of two cycles of `frequency`, cycles per row: an odd number.
std::size_t hann_length(double frequency);

// e^{−j2πx}
std::complex<double> turned(double cycles);

// Complex product without the special cases for infinities of the standard's.
inline std::complex<double> product(std::complex<double> a, std::complex<double> b) {
  return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

// e^{−j2πfn} for n from −reach to rows + reach − 1.
ComplexValues turns_of(double frequency, std::size_t rows, std::size_t reach = 0);

// Log light minus its local mean under a window of `length` rows; that of two cycles has no component at the tone.
std::vector<double> fast_logs(const Patch& patch, std::size_t length);

// Window of `length` rows for sliding means of a tone over `rows` rows.
kernels::HannWindow hann_window(double frequency, std::size_t rows, std::size_t length);

// Local mean of x·e^{−j2πfn}, n: row of the patch, x: light or its logarithm, minus its mean in the group.
ComplexValues swing_of(const Patch& patch, const std::vector<double>& values, const kernels::HannWindow& window);

// Visits the places of (rows × stride) that are connected to `start`, corners included, and open, by index and place,
// and closes them. joined(a, b): whether the neighbours a and b belong together.
template <class Joined, class Visit>
void visit_connected(std::size_t start, std::size_t stride, std::vector<std::uint8_t>& open, Joined joined,
                     Visit visit) {
  std::vector<std::size_t> stack{start};
  open[start] = 0;
  while (!stack.empty()) {
    const std::size_t at = stack.back(), n = at / stride, g = at % stride;
    stack.pop_back();
    visit(at, Region{g, n, 1, 1});
    for (std::size_t m = n - (n > 0); m <= std::min(n + 1, open.size() / stride - 1); ++m)
      for (std::size_t h = g - (g > 0); h <= std::min(g + 1, stride - 1); ++h) {
        const std::size_t next = m * stride + h;
        if (!open[next] || !joined(at, next)) continue;
        open[next] = 0;
        stack.push_back(next);
      }
  }
}

}  // namespace ocisac
