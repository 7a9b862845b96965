// Weighted sums over the rows of a frame, for all columns in one pass: the common operation of all linear estimates.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "ocisac/core/views.hpp"

namespace ocisac {

namespace kernels {
struct ByteWeights;
}

inline constexpr int kMostLimbs = 3;  // parts of a weight

// Row weights in the layout of the kernels. Immutable after construction; may be shared by threads.
//
// D neighbouring rows are summed before weighting (D = 1: none); rows of an incomplete group are ignored. Bytes are
// multiplied as integers, exactly: a weight is a sum of `limbs` parts of 13 signed bits, or up to 16 for few rows (15
// for a tone in 1080). The error relative to an output's largest weight is at most 1.3·10⁻⁴ for 1 part, 2·10⁻⁸ for 2
// and 2·10⁻¹² for 3. Other samples, and bytes by a tone curve, are multiplied in float64.
class RowWeights {
 public:
  // weights: (outputs × (rows / row_group)), dense, finite. row_group: 1, 2, 4 or 8. limbs: 1, 2 or 3.
  RowWeights(std::span<const double> weights, std::size_t outputs, std::size_t rows, int row_group, int limbs);

  [[nodiscard]] std::size_t rows() const { return rows_; }
  [[nodiscard]] std::size_t groups() const { return groups_; }
  [[nodiscard]] std::size_t outputs() const { return outputs_; }
  [[nodiscard]] int row_group() const { return row_group_; }
  [[nodiscard]] std::span<const double> weights() const { return weights_; }
  // The rounded weights used for bytes.
  [[nodiscard]] std::vector<double> byte_weights() const;

  [[nodiscard]] std::size_t limbs() const { return outputs_ > 0 ? units_.size() / outputs_ : 1; }
  // Integer weights of the groups from `group` on, as kernels take them. Folded, of the first half of the groups, if
  // folds(): the weights of a fit are symmetric in this sense, which halves the products.
  [[nodiscard]] kernels::ByteWeights integers(bool folded, std::size_t group) const;
  // True if every output is symmetric or antisymmetric about the middle and the number of groups is even. Then the
  // order has symmetric outputs first; else it is that of the outputs.
  [[nodiscard]] bool folds() const { return folds_; }
  [[nodiscard]] std::span<const std::size_t> output_order() const { return output_order_; }
  [[nodiscard]] std::size_t even_outputs() const { return even_outputs_; }

 private:
  std::size_t rows_, groups_, outputs_;
  int row_group_;
  std::vector<double> weights_;
  [[nodiscard]] std::size_t pair_count() const { return (groups_ + 1) / 2; }
  void fold_exactly(std::span<const double> largest);
  std::vector<double> units_;        // value of one unit of each part: the limbs of output 0, those of output 1, …
  std::vector<std::size_t> order_;   // index of each part, in the order of the outputs
  std::vector<std::int32_t> pairs_;  // (parts × pairs of groups), in that order
  bool folds_ = false;
  std::vector<std::size_t> output_order_;
  std::size_t even_outputs_ = 0;
};

// Result of a pass over columns [first, first + count) of one frame, dense.
struct Projection {
  std::vector<double> sums;     // (outputs × count): Σ_j weight(output, j)·s(j, column), s: sum of a group of rows
  std::vector<double> totals;   // (count,): Σ_j s(j, column)
  std::vector<double> squares;  // (count,): Σ_j s(j, column)²
  std::vector<double> maximum;  // (count,): largest sample of a column
};

// One streaming pass along rows in memory order. The result is bit-identical for every split of the columns. `light`:
// empty, or for integer samples what each value counts for (LightTable::rounded).
Projection project(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                   const RowWeights& weights, std::span<const float> light = {});
// The same into `result`, whose memory is reused.
void project(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
             const RowWeights& weights, std::span<const float> light, Projection& result);

// Sum of all bytes with the current SIMD target, to measure the time of reading a frame.
std::uint64_t read_bytes(std::span<const std::uint8_t> bytes, int threads = 1);

// SIMD targets of this build that this processor supports, best first, and the current one.
std::vector<std::string> simd_targets();
std::string simd_target();
// Selects one of simd_targets(); an empty name restores the best. Not thread-safe during computations. Throws
// std::invalid_argument for an unknown name.
void force_simd_target(const std::string& name);

}  // namespace ocisac
